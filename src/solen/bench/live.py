"""Live readings of a rig's receivers without a run: each input with each emitter on and off.

Before a run the wiring may differ from the rig file; all inputs are therefore read with every emitter. The emitter
phases in the samples of a DAQ device are determined as after a run.

Public names: `sampler_of`, `LiveReadings`, `InputReadings` and `stage_of`.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from solen.analysis.demodulation import Demodulated, slots_of, subtract
from solen.arrays import BoolArray, FloatArray
from solen.bench.clock import Clock
from solen.bench.daq import Samples, limits_of, volts_of
from solen.bench.drivers import DRIVERS
from solen.bench.frames import INVALID, Periods
from solen.bench.interrupts import uninterrupted
from solen.bench.phases import clock_channels, clock_of, states
from solen.bench.protocol import Protocol, Step
from solen.bench.readings import BoardAdc, demodulated
from solen.bench.rig import Rig
from solen.bench.roles import Daq, EmitterBoard, Stage
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError

TRACED_RANGE = {"deg": 3.0, "mm": 2.0}
"""Largest distance from zero, by unit, to which a simulated rig without a protocol is traced."""
TRACED_DEPTH_MM = 0.1
"""Largest depth of a finger to which that rig is traced; the finger does not press during live readings."""
MIN_PERIODS = 3.0
"""Smallest number of switching periods in which the clock is determined: they contain two rising edges of a sync, and a
falling edge after the first.
"""


@dataclass(frozen=True, eq=False)
class InputReadings:
    """Readings of each input with each emitter, as in a run: on minus the mean of the off phases before and after.

    Attributes
    ----------
    time_s
        Times by the instrument's clock, (N,).
    signal, off
        Drop that each emitter causes at each input, and the level with the emitter off, in V, (N, emitters, inputs).
    clipped
        Whether a sample of the reading was at a limit of the range, (N, emitters, inputs).
    low_V, high_V
        Limits of the ADC range.
    """

    time_s: FloatArray
    signal: FloatArray
    off: FloatArray
    clipped: BoolArray
    low_V: float
    high_V: float

    @property
    def on(self) -> FloatArray:
        """Levels with each emitter on, in V: (N, emitters, inputs)."""
        return self.off - self.signal

    @classmethod
    def of(cls, by_emitter: Sequence[Sequence[Demodulated]], range_V: tuple[float, float]) -> "InputReadings | None":
        """Combine the readings of groups of inputs, listed for each emitter; None if there are none."""
        indices = [
            [np.flatnonzero(group.of(emitter) & ~group.one_sided) for group in groups]
            for emitter, groups in enumerate(by_emitter, 1)
        ]
        n = min(len(index) for row in indices for index in row)
        if n == 0:
            return None

        def combined(name: str) -> NDArray[Any]:
            columns = [
                [getattr(group, name)[index[:n]] for group, index in zip(groups, row, strict=True)]
                for groups, row in zip(by_emitter, indices, strict=True)
            ]
            return np.stack([np.concatenate(column, axis=1) for column in columns], axis=1)

        time_s = by_emitter[0][0].time_s[indices[0][0][:n]]
        return cls(time_s, -combined("signal"), combined("ambient"), combined("clipped"), *range_V)

    @classmethod
    def joined(cls, parts: Sequence["InputReadings"]) -> "InputReadings":
        """Concatenate readings."""
        time_s, signal, off, clipped = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("time_s", "signal", "off", "clipped")
        )
        return cls(time_s, signal, off, clipped, parts[0].low_V, parts[0].high_V)


class LiveReadings:
    """Live readings from a sampler that has been started."""

    def __init__(self, sampler: EmitterBoard | Daq, rig: Rig) -> None:
        self._sampler, self._rig = sampler, rig
        self._samples: Samples | None = None
        self._periods: Periods | None = None

    def read(self) -> InputReadings | None:
        """Return the readings since the last call; None if there are none."""
        return self._of_samples(self._sampler) if isinstance(self._sampler, Daq) else self._of_periods(self._sampler)

    def _of_periods(self, board: EmitterBoard) -> InputReadings | None:
        """Return the readings of the valid periods; the last period of the previous call supplies its off phases."""
        new = board.read()
        periods = new if self._periods is None else Periods.joined([self._periods, new], board.layout)
        self._periods = periods[-1:]
        periods = periods[periods.flags & INVALID == 0]
        if len(periods) < 2:
            return None
        max_count = 2**self._rig.board.bits - 1
        adc = BoardAdc(board.period_s, board.volts_per_count, max_count)
        inputs, time_s = range(board.layout.receivers), 1e-6 * periods.board_us.astype(np.float64)
        by_emitter = [
            [demodulated(periods.counts, time_s, emitter, inputs, adc)]
            for emitter in range(1, board.layout.emitters + 1)
        ]
        return InputReadings.of(by_emitter, (0.0, max_count * board.volts_per_count))

    def _of_samples(self, daq: Daq) -> InputReadings | None:
        samples, setup = self._with_previous(daq.read()), daq.setup
        if len(samples.counts) < MIN_PERIODS * daq.rate_hz / daq.switch_hz:
            self._samples = samples
            return None
        sample_s = (samples.first + np.arange(len(samples.counts))) / daq.rate_hz
        volts = volts_of(samples.counts, daq.coefficients)
        channels, reference = clock_channels(setup, range(setup.inputs))
        clock = clock_of(sample_s, volts[:, channels], setup, daq.switch_hz)
        low, high = limits_of(daq.coefficients, getattr(daq, "limits_V", None))
        readings = []
        for channel in range(setup.inputs):
            state = states(clock, (channel - reference) * daq.convert_s, 1e-6 * setup.settle_us, setup.emitters)
            column = slice(channel, channel + 1)
            limits = low[column], high[column]
            readings.append(subtract(slots_of(sample_s, volts[:, column], state, limits=limits)))
        return InputReadings.of([readings] * setup.emitters, (float(low.max()), float(high.min())))

    def _with_previous(self, samples: Samples) -> Samples:
        """Return the samples joined to a previous block that was too short, unless there is a gap between them."""
        previous, self._samples = self._samples, None
        if previous is None or previous.segment != samples.segment:
            return samples
        if previous.first + len(previous.counts) != samples.first:
            return samples
        return Samples(previous.segment, previous.first, np.concatenate([previous.counts, samples.counts]))


@contextmanager
def sampler_of(rig: Rig, folder: Path, clock: Clock) -> Iterator[EmitterBoard | Daq]:
    """Yield the board or the DAQ device of a rig, started; on exit its emitters are off and it is closed."""
    if rig.meter is not None:
        limit = "has a meter, which does not switch emitters: its wiring cannot be checked"
        raise BenchError(f"rig {rig.name}", limit=limit, remedy="read the display of the meter")
    if rig.sampler.driver == "simulated":
        from solen.bench.simulated.instruments import simulated_instruments  # the tracer is loaded only if needed

        unit = rig.motion_unit
        farthest = rig.stage.zero + TRACED_DEPTH_MM if rig.stage.drives == "depth" else TRACED_RANGE[unit]
        target = {motion: axis.zero for motion, axis in rig.stages.items()} or farthest
        step = Step.model_validate({f"to_{unit}": target, f"velocity_{unit}_per_s": 1.0})
        noise = np.random.default_rng([rig.seed, 2])
        protocol = Protocol(name="no motion", step=(step,))
        _, sampler, _ = simulated_instruments(rig, protocol, folder, clock, noise)
    else:
        sampler = cast("EmitterBoard | Daq", DRIVERS[rig.sampler.driver].open(rig, clock))
    try:
        sampler.start()
        yield sampler
    finally:
        with uninterrupted():
            sampler.close()


@contextmanager
def stage_of(rig: Rig, clock: Clock) -> Iterator[Stage]:
    """Yield the stage of a rig, which is stopped and closed on exit."""
    stage: Stage
    if rig.stage.driver == "simulated":
        stage = SimulatedStage(clock, rig.stage.motion_unit)
    else:
        stage = cast("Stage", DRIVERS[rig.stage.driver].open(rig, clock))
    try:
        yield stage
    finally:
        with uninterrupted():
            stage.close()

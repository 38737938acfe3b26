"""Live readings of a rig's receivers without a run: each input with each emitter on and off.

Before a run the wiring may differ from the rig file; all inputs therefore are read with every emitter. Phases of a data
acquisition are determined as after a run.

Public names: `sampler_of`, `LiveReadings`, `InputReadings` and `stage_of`.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from solen.analysis.demodulation import Demodulated, slots_of, subtract
from solen.arrays import BoolArray, FloatArray
from solen.bench.clock import Clock
from solen.bench.daq import Samples, ends_of, volts_of
from solen.bench.drivers import DRIVERS
from solen.bench.frames import UNSOUND, Periods
from solen.bench.interrupts import uninterrupted
from solen.bench.phases import clock_of, seen_by, states
from solen.bench.protocol import Protocol, Step
from solen.bench.readings import Converter, subtracted
from solen.bench.rig import Rig
from solen.bench.roles import Daq, EmitterBoard, Stage
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError

REACH = {"deg": 3.0, "mm": 2.0}
"""Largest distance from zero to which a simulated rig is traced if no protocol states one."""
SHALLOW_MM = 0.1
"""The same distance for the depth of a finger: nothing presses on the sensor during live readings."""
MIN_PERIODS = 3.0
"""Number of switching periods from which the clock is determined: they contain two rises of a sync, and a fall after
the first.
"""


@dataclass(frozen=True, eq=False)
class InputReadings:
    """Readings of each input with each emitter, computed as in a run: on minus the off phases before and after it.

    Attributes
    ----------
    time_s
        Times by the instrument's clock, (N,).
    signal, off
        Drop of each input caused by each emitter, and the level without it, in V: (N, emitters, inputs).
    clipped
        Readings with a sample at a limit of the range, (N, emitters, inputs).
    low_V, high_V
        Limits of the converter's range.
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
    def of(cls, rows: Sequence[Sequence[Demodulated]], ends_V: tuple[float, float]) -> "InputReadings | None":
        """Combine the readings of each emitter, one group of inputs after the other; None if there are none."""
        chosen = [
            [np.flatnonzero(one.of(emitter) & ~one.one_sided) for one in row] for emitter, row in enumerate(rows, 1)
        ]
        n = min(len(places) for row in chosen for places in row)
        signal, off, clipped = (
            np.stack(
                [
                    np.concatenate([getattr(one, name)[at[:n]] for one, at in zip(row, places, strict=True)], axis=1)
                    for row, places in zip(rows, chosen, strict=True)
                ],
                axis=1,
            )
            for name in ("signal", "ambient", "clipped")
        )
        return cls(rows[0][0].time_s[chosen[0][0][:n]], -signal, off, clipped, *ends_V) if n else None

    @classmethod
    def joined(cls, parts: Sequence["InputReadings"]) -> "InputReadings":
        """Concatenate live readings."""
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
        """Return the readings since the last call; None if there are none, or if they show no switching."""
        return self._of_samples(self._sampler) if isinstance(self._sampler, Daq) else self._of_periods(self._sampler)

    def _of_periods(self, board: EmitterBoard) -> InputReadings | None:
        """Return the readings of sound periods; the last period of the previous call supplies its off phases."""
        came = board.read()
        periods = came if self._periods is None else Periods.joined([self._periods, came], board.layout)
        self._periods = periods[-1:]
        periods = periods[periods.flags & UNSOUND == 0]
        if len(periods) < 2:
            return None
        top = 2**self._rig.board.bits - 1
        converter = Converter(board.period_s, board.volts_per_count, top)
        inputs, time_s = range(board.layout.receivers), 1e-6 * periods.board_us.astype(np.float64)
        rows = [
            [subtracted(periods.counts, time_s, one + 1, inputs, converter)] for one in range(board.layout.emitters)
        ]
        return InputReadings.of(rows, (0.0, top * board.volts_per_count))

    def _of_samples(self, daq: Daq) -> InputReadings | None:
        samples, setup = self._with_kept(daq.read()), daq.setup
        if len(samples.counts) < MIN_PERIODS * daq.rate_hz / daq.switch_hz:
            self._samples = samples
            return None
        taken_s = (samples.first + np.arange(len(samples.counts))) / daq.rate_hz
        volts = volts_of(samples.counts, daq.coefficients)
        seen, place = seen_by(setup, range(setup.inputs))
        clock = clock_of(taken_s, volts[:, seen], setup, daq.switch_hz)
        low, high = ends_of(daq.coefficients, getattr(daq, "limits_V", None))
        readings = []
        for channel in range(setup.inputs):
            state = states(clock, (channel - place) * daq.convert_s, 1e-6 * setup.settle_us, setup.emitters)
            one = slice(channel, channel + 1)
            readings.append(subtract(slots_of(taken_s, volts[:, one], state, limits=(low[one], high[one]))))
        return InputReadings.of([readings] * setup.emitters, (float(low.max()), float(high.min())))

    def _with_kept(self, samples: Samples) -> Samples:
        """Return the samples joined to a previous block that was too short, unless some are missing in between."""
        kept, self._samples = self._samples, None
        if kept is None or kept.stretch != samples.stretch or kept.first + len(kept.counts) != samples.first:
            return samples
        return Samples(kept.stretch, kept.first, np.concatenate([kept.counts, samples.counts]))


@contextmanager
def sampler_of(rig: Rig, folder: Path, clock: Clock) -> Iterator[EmitterBoard | Daq]:
    """Board or data acquisition of a rig with alternating emitters; its emitters are off and it is closed on exit."""
    if rig.meter is not None:
        limit = "has a meter, which switches no emitter: its wires cannot be checked"
        raise BenchError(f"rig {rig.name}", limit=limit, remedy="look at the display of the meter")
    if rig.sampler.driver == "simulated":
        from solen.bench.simulated.instruments import simulated_instruments  # the tracer is loaded only if needed

        unit = rig.moves_in
        reach = rig.stage.zero + SHALLOW_MM if rig.stage.drives == "depth" else REACH[unit]
        to = {motion: axis.zero for motion, axis in rig.stages.items()} or reach
        far = {f"to_{unit}": to, f"velocity_{unit}_per_s": 1.0}
        noise = np.random.default_rng([rig.seed, 2])
        protocol = Protocol(name="no motion", step=(Step.model_validate(far),))
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
    """Stage of a rig; stopped and closed on exit."""
    stage: Stage
    if rig.stage.driver == "simulated":
        stage = SimulatedStage(clock, rig.stage.moves_in)
    else:
        stage = cast("Stage", DRIVERS[rig.stage.driver].open(rig, clock))
    try:
        yield stage
    finally:
        with uninterrupted():
            stage.close()

"""What a rig's receivers read now, without a run: each input with each emitter on, and off.

The idea: before a run nobody knows yet whether every wire is where the rig file has it, so that nothing is left out:
all inputs are read with every emitter. Of a data acquisition the phases are found as after a run.

The interface: `sampler_of` a rig, started; `Glances`, of which `read` gives a `Glance`; `stage_of` a rig.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from solen.arrays import FloatArray
from solen.bench.clock import Clock
from solen.bench.daq import Samples
from solen.bench.drivers import DRIVERS
from solen.bench.frames import UNSOUND
from solen.bench.interrupts import uninterrupted
from solen.bench.phases import clock_of, states
from solen.bench.protocol import Protocol, Step
from solen.bench.rig import Rig
from solen.bench.roles import Daq, EmitterBoard, Stage
from solen.bench.simulated.stage import SimulatedStage

REACH = {"deg": 3.0, "mm": 2.0}
"""How far from zero a simulated rig is traced where no protocol says so."""
GROUP_S = 0.05
"""Samples of a data acquisition are averaged over so long, or over a period of its switching if that is longer."""
LEAST_PERIODS = 3.0
"""Periods of the switching in which its clock is sought: they hold two rises of a sync, and a fall after the first."""


@dataclass(frozen=True, eq=False)
class Glance:
    """Volts of each input.

    Attributes
    ----------
    on, off
        With each emitter on, and after it off again: (N, emitters, inputs).
    low_V, high_V
        Ends of the converter's range.
    """

    on: FloatArray
    off: FloatArray
    low_V: float
    high_V: float

    @property
    def signal(self) -> FloatArray:
        """By how much each emitter pulls each input down, in V: (N, emitters, inputs)."""
        return self.off - self.on


class Glances:
    """Glances at a sampler that has been started."""

    def __init__(self, sampler: EmitterBoard | Daq, rig: Rig) -> None:
        self._sampler, self._rig = sampler, rig
        self._kept: Samples | None = None

    def read(self) -> Glance | None:
        """What came since the last call; None where that is nothing, or shows no switching."""
        if isinstance(self._sampler, Daq):
            return self._of_samples(self._sampler)
        periods = self._sampler.read()
        volts = periods.counts[periods.flags & UNSOUND == 0] * self._sampler.volts_per_count
        if len(volts) == 0:
            return None
        top = 2**self._rig.board.bits - 1
        return Glance(volts[:, :, 0], volts[:, :, 1], 0.0, top * self._sampler.volts_per_count)

    def _of_samples(self, daq: Daq) -> Glance | None:
        samples, setup = self._with_kept(daq.read()), daq.setup
        period = daq.rate_hz / daq.switch_hz
        group = math.ceil(max(GROUP_S * daq.rate_hz, period))
        if len(samples.counts) < max(group, LEAST_PERIODS * period):
            self._kept = samples
            return None
        number = samples.first + np.arange(len(samples.counts))
        volts = np.column_stack(
            [np.polyval(line[::-1], column) for line, column in zip(daq.coefficients, samples.counts.T, strict=True)]
        )
        clock = clock_of(number / daq.rate_hz, volts, setup, daq.switch_hz)
        rows = len(volts) // group
        means = np.full((2, rows, setup.emitters, setup.inputs), np.nan)
        for channel in range(setup.inputs):
            lit = states(clock, channel * daq.convert_s, 1e-6 * setup.settle_us, setup.emitters)
            for emitter in range(setup.emitters):
                for phase, state in enumerate((emitter + 1, 0)):
                    means[phase, :, emitter, channel] = _means(volts[:, channel], lit == state, rows, group)
        means = means[:, np.isfinite(means).all(axis=(0, 2, 3))]
        return Glance(means[0], means[1], -setup.range_v, setup.range_v) if means.shape[1] else None

    def _with_kept(self, samples: Samples) -> Samples:
        """Samples after those that were too few by themselves, unless some are missing between them."""
        kept, self._kept = self._kept, None
        if kept is None or kept.stretch != samples.stretch or kept.first + len(kept.counts) != samples.first:
            return samples
        return Samples(kept.stretch, kept.first, np.concatenate([kept.counts, samples.counts]))


def _means(volts: FloatArray, chosen: FloatArray, rows: int, group: int) -> FloatArray:
    """Mean of what is chosen in each group; NaN where that is nothing."""
    weight = chosen[: rows * group].reshape(rows, group).astype(float)
    total, count = (volts[: rows * group].reshape(rows, group) * weight).sum(axis=1), weight.sum(axis=1)
    return np.asarray(np.divide(total, count, out=np.full(rows, np.nan), where=count > 0.0))


@contextmanager
def sampler_of(rig: Rig, folder: Path, clock: Clock) -> Iterator[EmitterBoard | Daq]:
    """Board or data acquisition of a rig, its emitters taking turns; dark and closed in the end."""
    if rig.sampler.driver == "simulated":
        from solen.bench.simulated.instruments import simulated_instruments  # the tracer is loaded where it is needed

        unit = rig.stage.moves_in
        far = {f"to_{unit}": REACH[unit], f"velocity_{unit}_per_s": 1.0}
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
    """Stage of a rig; stopped and closed in the end."""
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

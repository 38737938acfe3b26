"""Calibration input: the rising and falling sweeps of each cycle, and their samples.

Public names: `training_of` and `Training`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from solen.analysis.calibration.force_smoothing import EXTENSION, smoothed
from solen.analysis.motion import Motion
from solen.analysis.response import Passes, common_range, passes
from solen.analysis.sensor_response import SensorResponse
from solen.arrays import BoolArray, FloatArray, IndexArray, flag_runs, rows_of
from solen.errors import DataError
from solen.recording.column_roles import left_right

_MAX_MISSED = 0.25  # fraction of a step by which a grid may miss the ends
_MIN_STEP = 5.0  # step, relative to the extension at a noisy end: a sweep need not reach the last quarter of a step
_MIN_POINTS = 7
_MIN_COMMON_POINTS = 5
MIN_CYCLES = 2
"""Smallest number of cycles; a single cycle does not show the repeatability."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the used cycles, including holds.

    Attributes
    ----------
    angle_deg, volts
        Angles (n,), and voltages (n, 2): left, right.
    cycle, direction
        Cycle index, and direction: 0 in a rising sweep or the hold after it, 1 in a falling sweep or the hold after it,
        (n,).
    follows
        Whether the sample immediately follows the previous one, (n,).
    """

    angle_deg: FloatArray
    volts: FloatArray
    cycle: IndexArray
    direction: IndexArray
    follows: BoolArray


@dataclass(frozen=True, eq=False)
class Training:
    """Sweeps and samples of a sensor.

    Attributes
    ----------
    label
        Sensor label.
    angle_deg
        Evenly spaced angles at which both receivers have a reading, (g,).
    cycles_V
        Voltages (cycles, 2, g, 2); axis 1 is rising, falling and the last axis left, right. NaN if a sweep has no
        reading.
    samples
        Samples between the first and the last angle.
    rails_V
        Lowest and highest voltage at which samples of the left and of the right receiver were clipped, (2, 2); NaN if
        none were clipped, or if the recorder itself marks clipped readings.
    """

    label: str
    angle_deg: FloatArray
    cycles_V: FloatArray
    samples: Samples
    rails_V: FloatArray

    @property
    def cycles(self) -> int:
        """Number of cycles."""
        return int(self.cycles_V.shape[0])

    def selected(self, kept: BoolArray) -> "Training":
        """Return the training data of the cycles selected by a mask (cycles,)."""
        number = np.cumsum(kept) - 1
        samples = rows_of(self.samples, kept[self.samples.cycle])
        samples = replace(samples, cycle=number[samples.cycle])
        return replace(self, cycles_V=self.cycles_V[kept], samples=samples)

    def curves_V(self) -> FloatArray:
        """Return the mean of the rising and of the falling sweeps over the cycles, (2, g, 2)."""
        return mean_curves(self.cycles_V)


def mean_curves(cycles_V: FloatArray) -> FloatArray:
    """Return the mean over the cycles, ignoring NaN; a missing value is replaced by that of the other direction."""
    finite = np.isfinite(cycles_V)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(finite, cycles_V, 0.0).sum(axis=0) / finite.sum(axis=0)
    return np.asarray(np.where(np.isfinite(mean), mean, mean[::-1]))


def training_of(sensor: SensorResponse, *, full_range: bool = False) -> Training:
    """Collect the sweeps and samples of an analysed sensor.

    With ``full_range``, the range extends to the ends of the motion, which a grid of round numbers may not reach. The
    grid is then specific to the sensor, which cannot be pooled with others.

    Raises
    ------
    DataError
        If there is no left or no right receiver, or a single cycle, or no range in which both receivers have readings.
    """
    sides = left_right(tuple(sensor.receivers))
    if sides is None:
        limit = f"has no pair of a left and a right receiver: {', '.join(sensor.receivers)}"
        remedy = "name them with --channel left=COLUMN right=COLUMN"
        raise DataError(f"sensor {sensor.label}", limit=limit, remedy=remedy)
    cycles = sensor.passes.cycles
    if cycles < MIN_CYCLES:
        limit = f"has {cycles} usable cycle{'s' * (cycles != 1)}, but a calibration requires at least {MIN_CYCLES}"
        raise DataError(
            f"sensor {sensor.label}", limit=limit, remedy="record more cycles, or include the first cycle with --drop 0"
        )
    sensor, u_end = smoothed(sensor)
    sweeps = _over_full_range(sensor, u_end) if full_range else sensor.passes
    volts = sweeps.volts[..., list(sides)]
    known = np.asarray(np.isfinite(mean_curves(volts)).all(axis=(0, 2)))
    first, last = max(flag_runs(known), key=lambda bounds: bounds[1] - bounds[0], default=(0, 0))
    if last - first < _MIN_COMMON_POINTS:
        limit = f"has no range of {sensor.stimulus.plural} in which both receivers have readings"
        remedy = "inspect the curves with solen bench analyse --figure"
        raise DataError(f"sensor {sensor.label}", limit=limit, remedy=remedy)
    angle = sweeps.angle_deg[first:last]
    samples, rails = _samples(sensor, sides, (float(angle[0]) - u_end, float(angle[-1]) + u_end))
    return Training(sensor.label, angle, volts[:, :, first:last], samples, rails)


def _over_full_range(sensor: SensorResponse, u_end: float) -> Passes:
    """Interpolate the sweeps on a grid over their common range, if the grid of the analysis does not reach its ends.

    If the ends are means of noisy readings, with standard uncertainty ``u_end``, the range is extended by 3 ``u_end``.
    """
    grid = sensor.passes.angle_deg
    max_missed = _MAX_MISSED * (grid[1] - grid[0])
    ranges = [common_range(run.signals.angle_deg, run.motion, run.used) for run in sensor.runs]
    extension = EXTENSION * u_end
    low, high = max(low for low, _ in ranges) - extension, min(high for _, high in ranges) + extension
    first = float(grid[0]) if grid[0] - low < max_missed else low
    last = float(grid[-1]) if high - grid[-1] < max_missed else high
    if not u_end and (first, last) == (grid[0], grid[-1]):
        return sensor.passes
    size = min(grid.size, int((last - first) / (_MIN_STEP * extension))) if u_end else grid.size
    full_grid = np.linspace(first, last, max(size, _MIN_POINTS))
    parts = [
        passes(run.signals.angle_deg, run.signals.volts, run.motion, run.used, full_grid, run.clipped)
        for run in sensor.runs
    ]
    return Passes.joined(parts)


def _samples(sensor: SensorResponse, sides: tuple[int, int], ends: tuple[float, float]) -> tuple[Samples, FloatArray]:
    """Return the samples of all runs between two angles that are not clipped, and the rails (2, 2)."""
    parts: list[tuple[FloatArray, FloatArray, IndexArray, IndexArray, BoolArray]] = []
    rails = np.full((2, 2), math.nan)
    for run in sensor.runs:
        volts, clipped = run.signals.volts[:, list(sides)], run.clipped[:, list(sides)]
        if run.signals.clipped is None:  # a mean of several samples that is marked as clipped is not at a rail
            rails = _narrowed(rails, volts, clipped)
        angle, direction = run.signals.angle_deg, _directions(run.motion, volts.shape[0])
        valid = (angle >= ends[0]) & (angle <= ends[1]) & ~clipped.any(axis=1) & (direction >= 0)
        for cycle in (run.motion.cycles[index] for index in run.used):
            kept = cycle.start + np.flatnonzero(valid[cycle.start : cycle.stop])
            follows = np.diff(kept, prepend=-2) == 1
            parts.append((angle[kept], volts[kept], np.full(kept.size, len(parts)), direction[kept], follows))
    return Samples(*(np.concatenate(column) for column in zip(*parts, strict=True))), rails


def _directions(motion: Motion, size: int) -> IndexArray:
    """Return 0 for samples from a rising ramp to the next ramp, 1 from a falling ramp, −1 before the first ramp."""
    directions = np.full(size, -1, dtype=np.intp)
    starts = [ramp.start for ramp in motion.ramps]
    for ramp, stop in zip(motion.ramps, [*starts[1:], size], strict=True):
        directions[ramp.start : stop] = 0 if ramp.direction > 0 else 1
    return directions


def _narrowed(rails: FloatArray, volts: FloatArray, clipped: BoolArray) -> FloatArray:
    """Return the rails of each receiver, (2, 2), narrowed to the voltages of the samples clipped at either rail."""
    narrowed = rails.copy()
    for receiver, (column, flags) in enumerate(zip(volts.T, clipped.T, strict=True)):
        if not flags.any() or flags.all():
            continue
        middle = float(np.median(column[~flags]))
        low, high = column[flags & (column < middle)], column[flags & (column >= middle)]
        if low.size:
            narrowed[receiver, 0] = np.fmax(narrowed[receiver, 0], low.max())
        if high.size:
            narrowed[receiver, 1] = np.fmin(narrowed[receiver, 1], high.min())
    return narrowed

"""Calibration input: the rising and falling sweeps of each cycle, and their samples.

Public names: `training_of` and `Training`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from solen.analysis.calibration.force_smoothing import OUT, smoothed
from solen.analysis.motion import Motion
from solen.analysis.response import DIRECTIONS, Passes, common_range, passes
from solen.analysis.run import Run
from solen.analysis.sensor_response import SensorResponse
from solen.arrays import BoolArray, FloatArray, IndexArray, flag_runs, rows_of
from solen.errors import DataError
from solen.recording.column_roles import left_right

_NEAR = 0.25  # fraction of a step by which a grid may miss the ends
_WIDE = 5.0  # step in units of the extension of a noisy end; a sweep need not reach the last quarter of a step
_MIN_POINTS = 7  # points
MIN_CYCLES = 2
"""Smallest number of cycles; a single cycle does not show how well cycles repeat."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the used cycles, including holds.

    Attributes
    ----------
    angle_deg, volts
        Angles (n,), and voltages (n, 2): left, right.
    cycle, way
        Cycle index, and the direction: 0 in a rising sweep or the following hold, 1 in a falling sweep or the following
        hold, (n,).
    follows
        Whether the sample immediately follows the previous one, (n,).
    """

    angle_deg: FloatArray
    volts: FloatArray
    cycle: IndexArray
    way: IndexArray
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
        Lowest and highest left and right voltages at which samples were clipped, (2, 2); NaN if none were clipped, or
        if the recorder itself marks clipped readings.
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

    def only(self, kept: BoolArray) -> "Training":
        """Return the training data of the cycles selected by a mask (cycles,)."""
        number = np.cumsum(kept) - 1
        samples = rows_of(self.samples, kept[self.samples.cycle])
        samples = replace(samples, cycle=number[samples.cycle])
        return replace(self, cycles_V=self.cycles_V[kept], samples=samples)

    def curves_V(self) -> FloatArray:
        """Return the mean of the rising and of the falling sweeps over the cycles, (2, g, 2)."""
        return mean_curves(self.cycles_V)


def mean_curves(cycles_V: FloatArray) -> FloatArray:
    """Return the mean over the first axis, ignoring NaN; a direction without readings is replaced by the opposite direction."""
    held = np.isfinite(cycles_V)
    count = held.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(held, cycles_V, 0.0).sum(axis=0) / count
    other = mean[::-1]
    return np.asarray(np.where(np.isfinite(mean), mean, other))


def training_of(sensor: SensorResponse, *, whole: bool = False) -> Training:
    """Collect the sweeps and samples of an analysed sensor.

    With ``whole``, the range extends to the ends of the motion, which a grid of round numbers may not reach. Such a
    sensor has a separate grid and cannot be pooled.

    Raises
    ------
    DataError
        If there is no left or no right receiver, or a single cycle, or the receivers have no angles in common.
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
    ways = _to_the_ends(sensor, u_end) if whole else sensor.passes
    volts = ways.volts[..., list(sides)]
    first, last = _stretch(np.asarray(np.isfinite(mean_curves(volts)).all(axis=(0, 2))))
    if last - first < len(DIRECTIONS) + 3:
        limit = "has no range of angles in which both receivers have readings"
        raise DataError(f"sensor {sensor.label}", limit=limit, remedy="inspect it with solen bench analyse --figure")
    angle = ways.angle_deg[first:last]
    samples, rails = _samples(sensor, sides, (float(angle[0]) - u_end, float(angle[-1]) + u_end))
    return Training(sensor.label, angle, volts[:, :, first:last], samples, rails)


def _to_the_ends(sensor: SensorResponse, u_end: float) -> Passes:
    """Interpolate the sweeps on a grid over their common range, if the grid of the analysis does not reach its ends.

    If the ends are means of noisy readings, with standard uncertainty ``u_end``, the range is extended by 3 ``u_end``.
    """
    grid = sensor.passes.angle_deg
    near = _NEAR * (grid[1] - grid[0])
    ranges = [common_range(run.signals.angle_deg, run.motion, run.used) for run in sensor.runs]
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if u_end:
        low, high = low - OUT * u_end, high + OUT * u_end
    first, last = (
        (float(grid[0]) if grid[0] - low < near else low),
        (float(grid[-1]) if high - grid[-1] < near else high),
    )
    if not u_end and (first, last) == (grid[0], grid[-1]):
        return sensor.passes
    size = min(grid.size, int((last - first) / (_WIDE * OUT * u_end))) if u_end else grid.size
    own = np.linspace(first, last, max(size, _MIN_POINTS))
    parts = [
        passes(run.signals.angle_deg, run.signals.volts, run.motion, run.used, own, run.clipped) for run in sensor.runs
    ]
    return Passes.joined(parts)


def _stretch(good: BoolArray) -> tuple[int, int]:
    """Return the slice bounds of the longest run."""
    return max(stretches(good), key=lambda bounds: bounds[1] - bounds[0], default=(0, 0))


def _samples(sensor: SensorResponse, sides: tuple[int, int], ends: tuple[float, float]) -> tuple[Samples, FloatArray]:
    """Return the samples of all runs between two angles, excluding clipped samples, and the voltages of the clipped samples."""
    parts: list[tuple[FloatArray, FloatArray, IndexArray, IndexArray, BoolArray]] = []
    rails = np.full((2, 2), math.nan)
    cycle = 0
    for run in sensor.runs:
        volts, clipped = run.signals.volts[:, list(sides)], run.clipped[:, list(sides)]
        if run.signals.clipped is None:  # if readings average several samples, the mark of a recorder is not a voltage
            rails = _wider(rails, volts, clipped)
        angle, ways = run.signals.angle_deg, _ways(run.motion, volts.shape[0])
        near = (angle >= ends[0]) & (angle <= ends[1]) & ~clipped.any(axis=1) & (ways >= 0)
        for place in _used(run):
            kept = place[near[place]]
            follows = np.diff(kept, prepend=-2) == 1
            parts.append((angle[kept], volts[kept], np.full(kept.size, cycle), ways[kept], follows))
            cycle += 1
    return Samples(*(np.concatenate(column) for column in zip(*parts, strict=True))), rails


def _used(run: Run) -> list[IndexArray]:
    """Return the indices of the samples of each used cycle."""
    cycles = [run.motion.cycles[number] for number in run.used]
    return [np.arange(cycle.start, cycle.stop, dtype=np.intp) for cycle in cycles]


def _ways(motion: Motion, size: int) -> IndexArray:
    """Return the direction of each sample: 0 from a rising ramp to the next, 1 from a falling ramp, −1 before the first ramp."""
    ways = np.full(size, -1, dtype=np.intp)
    starts = [ramp.start for ramp in motion.ramps]
    for ramp, stop in zip(motion.ramps, [*starts[1:], size], strict=True):
        ways[ramp.start : stop] = 0 if ramp.direction > 0 else 1
    return ways


def _wider(rails: FloatArray, volts: FloatArray, clipped: BoolArray) -> FloatArray:
    """Return the rails of each receiver, (2, 2), including those inferred from samples clipped below or above the others."""
    found = rails.copy()
    for place in range(2):
        flags = clipped[:, place]
        if not flags.any() or flags.all():
            continue
        middle = float(np.median(volts[~flags, place]))
        low, high = (volts[flags & side, place] for side in (volts[:, place] < middle, volts[:, place] >= middle))
        if low.size:
            found[place, 0] = np.fmax(found[place, 0], low.max())
        if high.size:
            found[place, 1] = np.fmin(found[place, 1], high.min())
    return found

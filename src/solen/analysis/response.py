"""Voltage against angle: half-cycles on a common angle grid, their mean and standard deviation.

The samples of a half-cycle (all rising or all falling ramps of a cycle) are connected by straight lines in order of
angle. The value at a grid point is the mean of this polyline over the cell, i.e. half a step to either side. With many
samples in a cell, this is nearly their mean; with few, it is an interpolation. Samples affect only cells next to them,
and nothing is filtered. A cell without nearby samples is empty, and a cell with a clipped sample is marked.

`grid_deg` makes a grid, `passes` computes the half-cycles on it, and `Passes.joined` joins half-cycles from several
recordings of a sensor; `mean_curve` computes their mean and standard deviation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solen.analysis.motion import Motion
from solen.arrays import BoolArray, FloatArray, IndexArray, IntArray
from solen.errors import DataError
from solen.results import Result

_CELLS = 60  # approximate number of cells in the range
_MAX_GRID_POINTS = 20_000
_MAX_INTERVAL = 5.0  # largest interval between samples that is interpolated, relative to the median interval
_MAX_OUTSIDE = 0.25  # fraction of a step by which a grid point may be outside the samples


@dataclass(frozen=True, eq=False)
class Passes:
    """Voltages in the rising and the falling half of each cycle, interpolated at the angles of a grid.

    Attributes
    ----------
    angle_deg
        The grid, (g,).
    volts
        Voltages (cycles, 2, g, receivers): rising, then falling; NaN if there is no sample.
    clipped
        Whether each voltage contains a clipped sample, of the same shape.
    middle_s
        Midpoint time of each cycle, (cycles,).
    """

    angle_deg: FloatArray
    volts: FloatArray
    clipped: BoolArray
    middle_s: FloatArray

    @property
    def cycles(self) -> int:
        """Number of cycles."""
        return int(self.volts.shape[0])

    @classmethod
    def joined(cls, parts: "Sequence[Passes]") -> "Passes":
        """Join the half-cycles of several recordings on the same grid."""
        columns = ([getattr(part, name) for part in parts] for name in ("volts", "clipped", "middle_s"))
        return cls(parts[0].angle_deg, *(np.concatenate(column) for column in columns))

    def rows(self, which: BoolArray) -> "Passes":
        """Return the half-cycles of selected cycles."""
        return Passes(self.angle_deg, self.volts[which], self.clipped[which], self.middle_s[which])

    def of(self, receiver: int) -> "Passes":
        """Return the half-cycles of one receiver, with a last axis of length 1."""
        part = slice(receiver, receiver + 1)
        return Passes(self.angle_deg, self.volts[..., part], self.clipped[..., part], self.middle_s)


class Curve(Result):
    """Mean and standard deviation of half-cycles at each angle, NaN without any, and the number of half-cycles."""

    mean_V: FloatArray
    sd_V: FloatArray
    ways: IntArray


def nice_step(reach_deg: float) -> float:
    """Return a step of 1, 2 or 5 times a power of ten that divides a range into about sixty cells."""
    ideal = reach_deg / _CELLS
    power = 10.0 ** np.floor(np.log10(ideal))
    steps = [step * power for step in (1.0, 2.0, 5.0, 10.0)]
    return float(min(steps, key=lambda step: abs(np.log(step / ideal))))


def common_range(angle_deg: FloatArray, motion: Motion, used: Sequence[int]) -> tuple[float, float]:
    """Return the range of angles that every half-cycle of the used cycles covers."""
    ranges = [
        (float(angle_deg[samples].min()), float(angle_deg[samples].max()))
        for half_cycles in _half_cycles(motion, used)
        for samples in half_cycles
        if samples.size
    ]
    if not ranges:
        raise DataError("motion", limit="has no ramp in the cycles used", remedy="use more cycles")
    return max(low for low, _ in ranges), min(high for _, high in ranges)


def grid_deg(low: float, high: float, step: float, sign: str = "°") -> FloatArray:
    """Return the multiples of a step in a range extended by a quarter of a step; ``sign`` is the unit in messages."""
    between = f"between {low:.3g}{sign} and {high:.3g}{sign}"
    first, last = np.ceil(low / step - _MAX_OUTSIDE), np.floor(high / step + _MAX_OUTSIDE)
    if last - first < 4:
        limit = f"has fewer than five points {between} with a step of {step:.3g}{sign}"
        raise DataError("response grid", limit=limit, remedy="choose a smaller --step-deg")
    if last - first > _MAX_GRID_POINTS:
        limit = f"has more than {_MAX_GRID_POINTS:,} points {between} with a step of {step:.3g}{sign}"
        raise DataError("response grid", limit=limit, remedy="choose a larger --step-deg")
    return np.round(np.arange(first, last + 1) * step, 9) + 0.0  # avoids -0


def passes(
    angle_deg: FloatArray,
    volts: FloatArray,
    motion: Motion,
    used: Sequence[int],
    grid: FloatArray,
    clipped: BoolArray | None = None,
) -> Passes:
    """Compute the half-cycles of the used cycles on a grid.

    Parameters
    ----------
    angle_deg
        Angles, (n,).
    volts, clipped
        Voltages and clipping flags, (n, receivers).
    motion, used
        Motion with its cycles, and the indices of the used cycles.
    grid
        Evenly spaced angles, (g,).
    """
    shape = (len(used), 2, grid.size, volts.shape[1])
    means, marked = np.full(shape, np.nan), np.zeros(shape, dtype=bool)
    for cycle, half_cycles in enumerate(_half_cycles(motion, used)):
        for direction, samples in enumerate(half_cycles):
            if samples.size < 2:
                continue
            means[cycle, direction] = on_grid(angle_deg[samples], volts[samples], grid)
            if clipped is not None and clipped[samples].any():
                flags = on_grid(angle_deg[samples], clipped[samples].astype(np.float64), grid)
                marked[cycle, direction] = np.nan_to_num(flags) > 1e-9
    middle = np.array([0.5 * (motion.cycles[n].start_s + motion.cycles[n].end_s) for n in used])
    return Passes(grid, means, marked, middle)


def _half_cycles(motion: Motion, used: Sequence[int]) -> list[list[IndexArray]]:
    """Return the sample indices of the rising and falling ramps of each used cycle, without the holds between them.

    The samples at which a ramp begins and ends are included.
    """
    starts = np.array([ramp.start for ramp in motion.ramps])
    stops = np.array([ramp.stop for ramp in motion.ramps])
    by_cycle = []
    for number in used:
        cycle = motion.cycles[number]
        ramps = motion.ramps[int(np.searchsorted(stops, cycle.start)) : int(np.searchsorted(starts, cycle.stop))]
        half_cycles: list[list[IndexArray]] = [[], []]
        for ramp in ramps:
            samples = np.arange(max(ramp.start, cycle.start), min(ramp.stop, cycle.stop), dtype=np.intp)
            if samples.size > 1:
                half_cycles[0 if ramp.direction > 0 else 1].append(samples)
        by_cycle.append([np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp) for parts in half_cycles])
    return by_cycle


def on_grid(angle_deg: FloatArray, volts: FloatArray, grid: FloatArray) -> FloatArray:
    """Return the mean of the polyline through the samples over each cell, (g, receivers).

    Samples at the same angle are averaged first. A cell at either end of the samples is narrowed so that it remains
    centred on its grid point; the value at a point slightly outside the samples is extrapolated linearly from the
    samples near it.
    """
    angles, values = _merged(angle_deg, volts)
    if angles.size < 2:
        return np.full((grid.size, volts.shape[1]), np.nan)
    step = float(grid[1] - grid[0])
    low, high = angles[0], angles[-1]
    points = np.clip(grid, low, high)
    half = np.minimum(0.5 * step, np.minimum(points - low, high - points))
    mean = _cell_means(angles, values, points, half) + _extrapolated(angles, values, grid - points, step)
    widths = np.diff(angles)
    allowed = max(2.0 * step, _MAX_INTERVAL * float(np.median(widths)))
    interval = np.clip(np.searchsorted(angles, points) - 1, 0, widths.size - 1)
    missing = (widths[interval] > allowed) | (np.abs(grid - points) > _MAX_OUTSIDE * step * 1.001)
    mean[missing] = np.nan
    return mean


def _extrapolated(angles: FloatArray, values: FloatArray, outside_deg: FloatArray, step: float) -> FloatArray:
    """Return the changes (g, receivers) from the first or last sample to points at signed distances beyond it."""
    change = np.zeros((outside_deg.size, values.shape[1]))
    ends = ((outside_deg < 0.0, angles <= angles[0] + step), (outside_deg > 0.0, angles >= angles[-1] - step))
    for outside, near in ends:
        if outside.any() and near.sum() > 1:
            centred = angles[near] - angles[near].mean()
            slope = centred @ values[near] / (centred @ centred)
            change[outside] = outside_deg[outside, None] * slope
    return change


def _merged(angle_deg: FloatArray, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the samples in order of angle, averaged if their angles are equal."""
    order = np.argsort(angle_deg, kind="stable")
    angles, values = angle_deg[order], volts[order]
    first = np.flatnonzero(np.append(True, np.diff(angles) > 0.0))
    counts = np.diff(np.append(first, angles.size))
    return angles[first], np.add.reduceat(values, first, axis=0) / counts[:, None]


def _cell_means(angles: FloatArray, values: FloatArray, points: FloatArray, half: FloatArray) -> FloatArray:
    """Return the mean of the polyline over [point − half, point + half], or the value at the point if half is 0."""
    widths = np.diff(angles)[:, None]
    total = np.vstack([np.zeros(values.shape[1]), np.cumsum(0.5 * (values[1:] + values[:-1]) * widths, axis=0)])

    def integral_and_value(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        index = np.clip(np.searchsorted(angles, x, side="right") - 1, 0, angles.size - 2)
        dx = (x - angles[index])[:, None]
        slope = (values[index + 1] - values[index]) / widths[index]
        return total[index] + values[index] * dx + 0.5 * slope * dx**2, values[index] + slope * dx

    narrow = half < 1e-9
    integrals, polyline = integral_and_value(np.concatenate([points + half, points - half, points]))
    upper, lower, _ = np.split(integrals, 3)
    value = polyline[2 * points.size :]
    mean = (upper - lower) / np.where(narrow, 1.0, 2.0 * half)[:, None]
    return np.where(narrow[:, None], value, mean)


def mean_curve(passes: Passes, direction: int | None = None) -> Curve:
    """Return the mean and standard deviation (n − 1) of a receiver's rising (0) or falling (1) half-cycles, or of both.

    There is no mean at angles where a half-cycle is clipped, because omitting this half-cycle would bias the mean.
    """
    directions = slice(None) if direction is None else slice(direction, direction + 1)
    size = passes.angle_deg.size
    volts, clipped = (array[:, directions, :, 0].reshape(-1, size) for array in (passes.volts, passes.clipped))
    valid = np.isfinite(volts)
    count = valid.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(valid, volts, 0.0).sum(axis=0) / count
        sd = np.sqrt((np.where(valid, volts - mean, 0.0) ** 2).sum(axis=0) / (count - 1))
    hidden = clipped.any(axis=0) | (count == 0)
    return Curve(np.where(hidden, np.nan, mean), np.where(hidden | (count < 2), np.nan, sd), count)

"""Detection of ramps, holds and cycles in an angle, for any protocol.

A protocol consists of levels and ramps between them. In a ramp the angle changes steadily over at least a tenth of the
total range; otherwise there is a hold. A cycle begins when the angle leaves its rest level towards the side visited
first, and ends when it is back at rest after visiting the same sides as the other cycles: 0, +3, 0, −3, 0 is one cycle,
and so is 0, +3, 0, or −3, +3, −3. The tolerances follow from the noise and the encoder step, which are estimated first.
The angle is averaged over a few samples only to *detect* edges; all results use the samples as recorded.

`find_motion` returns a `Motion` with its ramps and cycles.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NoReturn

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from solen.analysis.timebase import MAX_GAP_STEPS
from solen.arrays import FloatArray, IndexArray
from solen.errors import DataError
from solen.ranks import Caution, warning
from solen.recording.stimulus import ANGLE, Stimulus
from solen.results import HIDDEN, Result

_MIN_EXCURSION = 0.1
"""Smallest change in a ramp or an excursion, as a fraction of the range; with a smaller change there is a hold."""
_MIN_SPEED = 0.1  # smallest speed of a ramp, relative to the fastest
_MAX_GRID_POINTS = 4_000_000  # of the uniform grid for detecting edges
_SIGMAS = 4.0
_NOISE_RANGE = 5.0  # range of the noise after a median over five samples, in standard deviations
_MIN_RATIO = 150.0  # with a smaller ratio of range to noise, the noise hides edges and is averaged
_MAX_ENCODER_STEP = 1.0 / 8.0  # largest step of an encoder, as a fraction of the range; larger steps are set points


@dataclass(frozen=True)
class Ramp:
    """A ramp from one level to another.

    Attributes
    ----------
    start, stop
        Slice bounds of the samples; the first and last sample belong to the levels that the ramp connects.
    direction
        1 if the angle rises, −1 if it falls.
    start_deg, end_deg
        The levels.
    """

    start: int
    stop: int
    direction: int
    start_deg: float
    end_deg: float


@dataclass(frozen=True)
class Cycle:
    """A cycle, from the departure from rest to the return: times, and slice bounds of its samples."""

    start_s: float
    end_s: float
    start: int
    stop: int


_Span = tuple[int, int, bool]
"""Slice bounds of the samples of a cycle, and whether the angle returned to rest."""


class Motion(Result):
    """Motion of an angle.

    Attributes
    ----------
    ramps, cycles
        Ramps and complete cycles in time order.
    holds
        Slice bounds of the samples of each hold, (k, 2).
    rest_deg
        Angle at which cycles begin.
    low_deg, high_deg
        Limits of the range.
    noise_deg, step_deg
        Noise of the angle (standard deviation) and its encoder step; 0 if not detectable.
    speed_deg_per_s
        Median ramp speed.
    warnings
        Warnings about omitted parts.
    stopped
        Whether samples were recorded only at stops, as with a stage turned by hand.
    """

    ramps: tuple[Ramp, ...] = field(metadata=HIDDEN)
    cycles: tuple[Cycle, ...]
    holds: IndexArray = field(metadata=HIDDEN)
    rest_deg: float
    low_deg: float
    high_deg: float
    noise_deg: float
    step_deg: float
    speed_deg_per_s: float
    warnings: tuple[Caution, ...] = field(metadata=HIDDEN)
    stopped: bool = False


def find_motion(time_s: FloatArray, angle_deg: FloatArray, stimulus: Stimulus = ANGLE) -> Motion:
    """Detect the ramps, holds and cycles of an angle.

    Parameters
    ----------
    time_s
        Non-decreasing times, (n,).
    angle_deg
        Angles in degrees, or another ``stimulus`` in its unit, without gaps, (n,).

    Raises
    ------
    DataError
        If the angle does not move, jumps between levels, or contains no complete cycle.
    """
    name, sign = stimulus.name, stimulus.sign
    stops = _at_stops(time_s, angle_deg)
    times, clean = (time_s, median_filter(angle_deg, 5, mode="nearest")) if stops is None else stops
    low, high = float(clean.min()), float(clean.max())
    noise, step = _noise(angle_deg), _encoder_step(angle_deg)
    if stops is None and step > _MAX_ENCODER_STEP * (high - low):
        _reject_jumps(0.0, name)
    if high - low <= max(20.0 * noise, 1e-9):
        limit = f"moves by only {high - low:.3g}{sign} with a noise of {noise:.2g}{sign}, so no cycle can be detected"
        raise DataError(name, limit=limit, remedy=f"name the {name} column with --{stimulus.column}")
    edges = _Edges(times, clean, noise, step if stops is None else 0.0, high - low)
    smooth, smooth_noise = _smoothed(angle_deg, noise, high - low, edges.half_samples)
    tolerance = max(3.0 * smooth_noise, 0.51 * step, 0.002 * (high - low))
    ramps = _ramps(smooth, edges.runs(), edges.half_samples, tolerance)
    if not ramps:
        raise DataError(name, limit="has no ramp between two levels", remedy=f"check the {name} column")
    _check_sampled(ramps, name)
    rest, first = _rest(smooth, ramps, (low, high))
    cycles, warnings = _cycles(time_s, smooth, ramps, rest, first, max(tolerance, 0.02 * (high - low)), name)
    return Motion(
        ramps=ramps,
        cycles=cycles,
        holds=_holds(ramps, angle_deg.size),
        rest_deg=rest,
        low_deg=low,
        high_deg=high,
        noise_deg=noise,
        step_deg=step,
        speed_deg_per_s=_speed(time_s, ramps),
        warnings=warnings,
        stopped=stops is not None,
    )


def _at_stops(time_s: FloatArray, angle_deg: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return time and angle of a stage turned by hand; None unless the angle changes only in gaps of the recording.

    The gaps are removed from the time, and the angle is interpolated linearly between the midpoints of the stops;
    stops at which the direction reverses remain stops.
    """
    steps, changes = np.diff(time_s), np.diff(angle_deg) != 0.0
    step_s = float(np.median(steps))
    gaps = steps > MAX_GAP_STEPS * step_s
    if changes[~gaps].any() or not changes.any():
        return None
    time = np.asarray(time_s[0] + np.concatenate([[0.0], np.cumsum(np.where(gaps, step_s, steps))]))
    edges = np.flatnonzero(changes) + 1
    first, last = np.append(0, edges), np.append(edges, time.size) - 1
    reversals = np.concatenate([[True], np.diff(np.sign(np.diff(angle_deg[first]))) != 0.0, [True]])
    ends = np.stack([time[first], time[last]])
    knots = np.where(reversals, ends, ends.mean(axis=0))
    return time, np.interp(time, knots.T.ravel(), np.repeat(angle_deg[first], 2))


def _smoothed(angle_deg: FloatArray, noise: float, reach: float, max_count: int) -> tuple[FloatArray, float]:
    """Return an angle, averaged over a few samples if its noise would hide edges, and the remaining noise."""
    ideal = (_MIN_RATIO * noise / reach) ** 2
    count = min(math.ceil(ideal), max_count) | 1 if ideal > 1.0 and max_count > 2 else 1
    smooth = angle_deg if count == 1 else np.asarray(uniform_filter1d(angle_deg, count, mode="nearest"))
    return smooth, noise / math.sqrt(count)


def _noise(angle_deg: FloatArray) -> float:
    """Return the standard deviation of white noise on a piecewise straight line, from second differences."""
    second = np.abs(np.diff(angle_deg, 2))
    return float(1.4826 * np.median(second) / math.sqrt(6.0))


def _encoder_step(angle_deg: FloatArray) -> float:
    """Return the smallest difference between values, or 0 if they are too rarely equal to come from an encoder."""
    levels = np.unique(angle_deg)
    if levels.size < 2 or levels.size > 0.2 * angle_deg.size:
        return 0.0
    steps = np.diff(levels)
    return float(np.min(steps[steps > 1e-9 * np.ptp(levels)], initial=np.ptp(levels)))


class _Edges:
    """Mask of times at which the angle moves, detected on a uniform time grid."""

    def __init__(self, time_s: FloatArray, clean: FloatArray, noise: float, step: float, reach: float) -> None:
        steps = np.diff(time_s)
        self._time_s = time_s
        step_s = max(float(np.median(steps[steps > 0.0])), float(np.ptp(time_s)) / _MAX_GRID_POINTS)
        grid = np.arange(time_s[0], time_s[-1] + 0.5 * step_s, step_s)
        self._angle = np.interp(grid, time_s, clean)
        self._grid = grid
        self.half_samples = self._half(reach, noise)
        smooth = uniform_filter1d(self._angle, self.half_samples, mode="nearest")
        self._change = np.zeros(grid.size)
        half = self.half_samples
        self._change[half:-half] = smooth[2 * half :] - smooth[: -2 * half]
        floor = _SIGMAS * noise * (2.0 / half) ** 0.5
        self._min_change = max(_MIN_SPEED * _MIN_EXCURSION * reach, floor, 1.01 * step)

    def _half(self, reach: float, noise: float) -> int:
        """Return half the number of samples in which the angle, at its fastest, moves by a tenth of its range."""
        lag = 1
        while lag < self._angle.size // 4:
            moved = float(np.max(np.abs(self._angle[lag:] - self._angle[:-lag]))) - _NOISE_RANGE * noise
            if moved >= 2.0 * _MIN_EXCURSION * reach:
                return max(1, round(0.5 * lag * _MIN_EXCURSION * reach / moved))
            lag *= 2
        return max(1, lag // 4)

    def runs(self) -> list[tuple[int, int, int]]:
        """Return the slice bounds and the direction of each run of samples that move in one direction."""
        sign = np.where(np.abs(self._change) > self._min_change, np.sign(self._change), 0.0).astype(np.int8)
        bounds = np.flatnonzero(np.diff(sign)) + 1
        starts, stops = np.append(0, bounds), np.append(bounds, sign.size)
        moving = sign[starts] != 0
        runs = []
        for start, stop in zip(starts[moving], stops[moving], strict=True):
            moved = abs(self._angle[stop - 1] - self._angle[start])
            if moved > 2.0 * self._min_change or stop - start > self.half_samples:
                first, last = np.searchsorted(self._time_s, self._grid[[start, stop - 1]]).tolist()
                runs.append((first, last + 1, int(sign[start])))
        return _joined(runs, self.half_samples)


def _joined(runs: list[tuple[int, int, int]], max_gap: int) -> list[tuple[int, int, int]]:
    """Merge runs of the same direction with at most ``max_gap`` samples between them."""
    joined: list[tuple[int, int, int]] = []
    for run in runs:
        if joined and joined[-1][2] == run[2] and run[0] - joined[-1][1] <= max_gap:
            joined[-1] = (joined[-1][0], run[1], run[2])
        else:
            joined.append(run)
    return joined


def _ramps(angle_deg: FloatArray, runs: list[tuple[int, int, int]], half: int, tolerance: float) -> tuple[Ramp, ...]:
    """Return the ramps of runs, each from leaving the tolerance of a level to entering that of the next level."""
    size = angle_deg.size
    cuts = [0, *((before[1] + after[0]) // 2 for before, after in pairwise(runs)), size]
    ramps: list[Ramp] = []
    for index, (start, stop, direction) in enumerate(runs):
        middle = (start + stop) // 2
        before = _level(angle_deg, runs[index - 1][1] if index else 0, start, half)
        after = _level(angle_deg, stop, runs[index + 1][0] if index + 1 < len(runs) else size, half)
        # an edge may be detected slightly before or after a reversal
        low = max(cuts[index] - (half if before is None else 0), 0)
        high = min(cuts[index + 1] + (half if after is None else 0), size)
        first = _leaves(angle_deg, low, middle, before, tolerance, direction)
        last = _enters(angle_deg, middle, high, after, tolerance, direction)
        start_deg = float(angle_deg[first]) if before is None else before
        end_deg = float(angle_deg[last]) if after is None else after
        ramps.append(Ramp(first, last + 1, direction, start_deg, end_deg))
    return tuple(ramps)


def _level(angle_deg: FloatArray, start: int, stop: int, half: int) -> float | None:
    """Return the median of a hold between two runs, or None if the runs follow each other directly."""
    inner = angle_deg[start + half : stop - half] if stop - start > 2 * half + 2 else angle_deg[start:stop]
    return float(np.median(inner)) if stop - start > half + 2 else None


def _leaves(a: FloatArray, low: int, middle: int, level: float | None, tolerance: float, direction: int) -> int:
    """Return the index of the last sample at ``level`` before the middle of a ramp; for None, of the turning point."""
    part = a[low : middle + 1]
    if level is None:
        return middle - int(np.argmin(direction * part[::-1]))
    at_level = np.flatnonzero(direction * (part - level) <= tolerance)
    return low + int(at_level[-1]) if at_level.size else low


def _enters(a: FloatArray, middle: int, high: int, level: float | None, tolerance: float, direction: int) -> int:
    """Return the index of the first sample at ``level`` after the middle of a ramp; for None, of the turning point."""
    part = a[middle:high]
    if level is None:
        return middle + int(np.argmax(direction * part))
    at_level = np.flatnonzero(direction * (part - level) >= -tolerance)
    return middle + int(at_level[0]) if at_level.size else high - 1


def _check_sampled(ramps: tuple[Ramp, ...], name: str) -> None:
    """Raise `DataError` if the angle jumps, as in a list of set points without samples in between."""
    count = float(np.median([ramp.stop - ramp.start - 2 for ramp in ramps]))
    if count < 3.0:
        _reject_jumps(max(count, 0.0), name)


def _reject_jumps(count: float, name: str) -> NoReturn:
    limit = f"jumps from level to level, with {count:g} samples in a ramp"
    remedy = f"provide the measured {name} instead of the set points, sampled at least five times in a ramp"
    raise DataError(name, limit=limit, remedy=remedy)


def _holds(ramps: tuple[Ramp, ...], size: int) -> IndexArray:
    stops = [0, *(ramp.stop for ramp in ramps)]
    starts = [*(ramp.start for ramp in ramps), size - 1]
    pairs = [(start, stop + 1) for start, stop in zip(stops, starts, strict=True) if stop + 1 - start > 2]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def _speed(time_s: FloatArray, ramps: tuple[Ramp, ...]) -> float:
    durations = np.array([time_s[ramp.stop - 1] - time_s[ramp.start] for ramp in ramps])
    changes = np.array([abs(ramp.end_deg - ramp.start_deg) for ramp in ramps])
    positive = durations > 0.0
    return float(np.median(changes[positive] / durations[positive])) if positive.any() else 0.0


def _rest(angle_deg: FloatArray, ramps: tuple[Ramp, ...], ends: tuple[float, float]) -> tuple[float, int]:
    """Return the angle at which cycles begin, and the side towards which the first ramp leaves it.

    The angle is the level before the first ramp; if the recording begins during a ramp, the level after the last ramp;
    if it also ends during a ramp, 0, or the midpoint of a range that does not contain 0.
    """
    low, high = ends
    if ramps[0].start > 2:
        return ramps[0].start_deg, ramps[0].direction
    middle = 0.0 if low < 0.0 < high else 0.5 * (low + high)
    rest = ramps[-1].end_deg if angle_deg.size - ramps[-1].stop > 2 else middle
    margin = _MIN_EXCURSION * (high - low)
    if rest > high - margin:
        return rest, -1
    return rest, 1 if rest < low + margin else _side(ramps, rest, margin)


def _side(ramps: tuple[Ramp, ...], rest: float, margin: float) -> int:
    """Return the side towards which the first ramp leaves a rest level inside the range."""
    for ramp in ramps:
        if abs(ramp.start_deg - rest) <= margin:
            return ramp.direction
    return ramps[0].direction


def _cycles(
    time_s: FloatArray,
    angle_deg: FloatArray,
    ramps: tuple[Ramp, ...],
    rest: float,
    first: int,
    tolerance: float,
    name: str,
) -> tuple[tuple[Cycle, ...], tuple[Caution, ...]]:
    """Return the complete cycles, and warnings about omitted parts."""
    distance = first * (angle_deg - rest)
    margin = _MIN_EXCURSION * float(np.ptp([end for ramp in ramps for end in (ramp.start_deg, ramp.end_deg)]))
    starts = _starts(distance, ramps, rest, first, margin, tolerance)
    if not starts:
        limit = "contains no cycle that starts from rest"
        raise DataError(name, limit=limit, remedy="record at least one complete cycle")
    following = [*starts[1:], (None, tolerance)]
    spans = [_span(distance, start, stop, within) for (start, _), (stop, within) in zip(starts, following, strict=True)]
    if bool((distance > -margin).all()):
        spans = _with_complete_ramps(spans, ramps, first)
    complete = _complete(spans, [bool(np.min(distance[a:b]) < -margin) for a, b, _ in spans])
    cycles = tuple(
        Cycle(float(time_s[a]), float(time_s[b - 1]), a, b) for (a, b, _), ok in zip(spans, complete, strict=True) if ok
    )
    if not cycles:
        limit = "contains no complete cycle"
        raise DataError(name, limit=limit, remedy="record at least one complete cycle, from rest to rest")
    warnings = [
        warning(f"the cycle that begins at {time_s[a]:.6g} s is incomplete and is omitted")
        for (a, _, _), ok in zip(spans, complete, strict=True)
        if not ok
    ]
    if abs(ramps[0].start_deg - rest) > margin:
        text = f"the recording begins during a motion: data before {time_s[starts[0][0]]:.6g} s are omitted"
        warnings.insert(0, warning(text))
    return cycles, tuple(warnings)


def _complete(spans: list[_Span], two_sided: list[bool]) -> list[bool]:
    """Return whether each cycle returned to rest, and visited both sides if most cycles, apart from the last, do."""
    before_last = two_sided[:-1] or two_sided
    required = 2 * sum(before_last) >= len(before_last)
    return [returned and (two or not required) for (_, _, returned), two in zip(spans, two_sided, strict=True)]


def _starts(
    distance: FloatArray, ramps: tuple[Ramp, ...], rest: float, first: int, margin: float, tolerance: float
) -> list[tuple[int, float]]:
    """Return the last sample at rest before each excursion to the first side, and the tolerance for rest there.

    If a ramp only passes through the rest level, the tolerance is 0, so that no sample near this level is omitted.
    """
    starts: list[tuple[int, float]] = []
    for ramp in ramps:
        if ramp.direction == first and first * (ramp.start_deg - rest) <= margin < first * (ramp.end_deg - rest):
            low = starts[-1][0] + 1 if starts else 0
            within = 0.0 if first * (ramp.start_deg - rest) < -margin else tolerance
            at_rest = np.flatnonzero(distance[low : ramp.stop] <= within)
            starts.append((low + int(at_rest[-1]) if at_rest.size else ramp.start, within))
    return starts


def _with_complete_ramps(spans: list[_Span], ramps: tuple[Ramp, ...], first: int) -> list[_Span]:
    """Extend cycles from the beginning of their first ramp to the end of their last ramp.

    If the rest level is an end of the range (e.g. without load), values near it would otherwise not belong to any
    cycle.
    """
    outward, inward = ([ramp for ramp in ramps if ramp.direction == side] for side in (first, -first))
    begins = [next((ramp.start for ramp in outward if ramp.start <= a < ramp.stop), a) for a, _, _ in spans]
    ends = [next((ramp.stop for ramp in inward if ramp.start < b <= ramp.stop), b) for _, b, _ in spans]
    limits = [*(begin + 1 for begin in begins[1:]), ends[-1]]
    return [(a, min(b, limit), back) for a, b, limit, (_, _, back) in zip(begins, ends, limits, spans, strict=True)]


def _span(distance: FloatArray, start: int, following: int | None, tolerance: float) -> _Span:
    """Return the samples of the cycle that begins at ``start``; the next cycle, if any, begins at ``following``."""
    stop = distance.size if following is None else following + 1
    outside = np.flatnonzero(np.abs(distance[start:stop]) > tolerance)
    last = start + int(outside[-1]) + 1 if outside.size else stop - 1
    returned = last < stop or following is not None
    return start, min(last + 1, stop), returned

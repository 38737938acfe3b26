"""Detection of ramps, holds and cycles in an angle, for any protocol.

A protocol consists of levels and ramps between them. In a ramp the angle changes steadily over at least a tenth of the
total range; otherwise there is a hold. A cycle begins when the angle leaves its rest level towards the side visited
first, and ends when it returns to rest after all sides that the other cycles visit: 0, +3, 0, −3, 0 is one cycle, and
so is 0, +3, 0, or −3, +3, −3. The noise and the encoder steps are estimated first and set the tolerances. The angle is
averaged over a few samples only to *detect* edges; all results use the samples as recorded.

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

_TENTH = 0.1
"""Fraction of the range that an excursion must exceed, and over which a ramp differs from a hold."""
_MIN_SPEED = 0.1  # smallest speed of a ramp, relative to the fastest
_MAX_GRID_POINTS = 4_000_000  # largest number of points of the uniform grid for detecting edges
_SIGMAS = 4.0
_PEAKS = 5.0  # contribution of noise to the range of the angles after a median of five, in standard deviations
_HIDING = 150.0  # noise larger than this part (1/150) of the range hides an edge
_MAX_ENCODER_STEP = 1.0 / 8.0  # largest step of an encoder, as a fraction of the range; larger steps are set points


@dataclass(frozen=True)
class Ramp:
    """A ramp from one level to another.

    Attributes
    ----------
    start, stop
        First sample, and the sample after the last sample; the end samples belong to the levels that the ramp connects.
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
    """A cycle from the departure from rest to the return to rest: times, and the samples [start, stop)."""

    start_s: float
    end_s: float
    start: int
    stop: int


class Motion(Result):
    """Motion of an angle.

    Attributes
    ----------
    ramps, cycles
        Ramps and complete cycles in time order.
    holds
        First sample of each hold, and the first sample after it, (k, 2).
    rest_deg
        Angle at which cycles begin.
    low_deg, high_deg
        Limits of the range.
    noise_deg, step_deg
        Noise of the angle (standard deviation) and its resolution; 0 if not detectable.
    speed_deg_per_s
        Median ramp speed.
    warnings
        Omitted parts, with reasons.
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
    way = (time_s, median_filter(angle_deg, 5, mode="nearest")) if stops is None else stops
    clean = way[1]
    low, high = float(clean.min()), float(clean.max())
    noise, step = _noise(angle_deg), _finest(angle_deg)
    if stops is None and step > _MAX_ENCODER_STEP * (high - low):
        _refuse_jumps(0.0, name)
    if high - low <= max(20.0 * noise, 1e-9):
        limit = f"moves by only {high - low:.3g}{sign} with a noise of {noise:.2g}{sign}, so no cycle can be detected"
        raise DataError(name, limit=limit, remedy=f"name the {name} column with --{stimulus.column}")
    edges = _Edges(*way, noise, step if stops is None else 0.0, high - low)
    calm, left = _calmed(angle_deg, noise, high - low, edges.half_samples)
    tolerance = max(3.0 * left, 0.51 * step, 0.002 * (high - low))
    ramps = _ramps(calm, edges.runs(), edges.half_samples, tolerance)
    if not ramps:
        raise DataError(name, limit="has no ramp between two levels", remedy=f"check the {name} column")
    _check_sampled(ramps, name)
    rest, first = _rest(calm, ramps, (low, high))
    cycles, warnings = _cycles(time_s, calm, ramps, rest, first, max(tolerance, 0.02 * (high - low)), name)
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
    """Return the time and angle of a stage turned by hand, if the angle changes only in gaps of the recording; otherwise None.

    The gaps are removed from the time, and the angle is interpolated from one rotation to the next through the
    midpoints of the stops.
    """
    steps, changes = np.diff(time_s), np.diff(angle_deg) != 0.0
    usual = float(np.median(steps))
    gaps = steps > MAX_GAP_STEPS * usual
    if changes[~gaps].any() or not changes.any():
        return None
    time = np.asarray(time_s[0] + np.concatenate([[0.0], np.cumsum(np.where(gaps, usual, steps))]))
    edges = np.flatnonzero(changes) + 1
    first, last = np.append(0, edges), np.append(edges, time.size) - 1
    turns = np.concatenate([[True], np.diff(np.sign(np.diff(angle_deg[first]))) != 0.0, [True]])
    ends = np.stack([time[first], time[last]])
    knots = np.where(turns, ends, ends.mean(axis=0))
    return time, np.interp(time, knots.T.ravel(), np.repeat(angle_deg[first], 2))


def _calmed(angle_deg: FloatArray, noise: float, reach: float, most: int) -> tuple[FloatArray, float]:
    """Return an angle averaged over a few samples, if its noise would hide edges; and the standard deviation of the noise."""
    wanted = (_HIDING * noise / reach) ** 2
    count = min(math.ceil(wanted), most) | 1 if wanted > 1.0 and most > 2 else 1
    calm = angle_deg if count == 1 else np.asarray(uniform_filter1d(angle_deg, count, mode="nearest"))
    return calm, noise / math.sqrt(count)


def _noise(angle_deg: FloatArray) -> float:
    """Return the standard deviation of white noise on a piecewise straight line, from second differences."""
    second = np.abs(np.diff(angle_deg, 2))
    return float(1.4826 * np.median(second) / math.sqrt(6.0))


def _finest(angle_deg: FloatArray) -> float:
    """Return the smallest encoder step, or 0 if the angle has as many distinct values as samples."""
    levels = np.unique(angle_deg)
    if levels.size < 2 or levels.size > 0.2 * angle_deg.size:
        return 0.0
    steps = np.diff(levels)
    return float(np.min(steps[steps > 1e-9 * np.ptp(levels)], initial=np.ptp(levels)))


class _Edges:
    """Mask of times at which the angle moves, detected on a uniform time grid."""

    def __init__(self, time_s: FloatArray, clean: FloatArray, noise: float, step: float, reach: float) -> None:
        usual = np.diff(time_s)
        self._time_s = time_s
        self._even_s = max(float(np.median(usual[usual > 0.0])), float(np.ptp(time_s)) / _MAX_GRID_POINTS)
        grid = np.arange(time_s[0], time_s[-1] + 0.5 * self._even_s, self._even_s)
        self._angle = np.interp(grid, time_s, clean)
        self._grid = grid
        self.half_samples = self._half(reach, noise)
        smooth = uniform_filter1d(self._angle, self.half_samples, mode="nearest")
        self._change = np.zeros(grid.size)
        half = self.half_samples
        self._change[half:-half] = smooth[2 * half :] - smooth[: -2 * half]
        floor = _SIGMAS * noise * (2.0 / half) ** 0.5
        self._least = max(_MIN_SPEED * _TENTH * reach, floor, 1.01 * step)

    def _half(self, reach: float, noise: float) -> int:
        """Return the half the number of samples during which the angle, at its fastest, moves by a tenth of its range."""
        lag = 1
        while lag < self._angle.size // 4:
            moved = float(np.max(np.abs(self._angle[lag:] - self._angle[:-lag]))) - _PEAKS * noise
            if moved >= 2.0 * _TENTH * reach:
                return max(1, round(0.5 * lag * _TENTH * reach / moved))
            lag *= 2
        return max(1, lag // 4)

    def runs(self) -> list[tuple[int, int, int]]:
        """Return the first sample, the sample after the last sample, and direction of each run of motion in one direction."""
        sign = np.where(np.abs(self._change) > self._least, np.sign(self._change), 0.0).astype(np.int8)
        bounds = np.flatnonzero(np.diff(sign)) + 1
        starts, stops = np.append(0, bounds), np.append(bounds, sign.size)
        moving = sign[starts] != 0
        found = []
        for start, stop in zip(starts[moving], stops[moving], strict=True):
            if abs(self._angle[stop - 1] - self._angle[start]) > 2.0 * self._least or stop - start > self.half_samples:
                place = np.searchsorted(self._time_s, self._grid[[start, stop - 1]])
                found.append((int(place[0]), int(place[1]) + 1, int(sign[start])))
        return _joined(found, self.half_samples)


def _joined(runs: list[tuple[int, int, int]], reach: int) -> list[tuple[int, int, int]]:
    """Merge runs of the same direction that are less than a window apart."""
    joined: list[tuple[int, int, int]] = []
    for run in runs:
        if joined and joined[-1][2] == run[2] and run[0] - joined[-1][1] <= reach:
            joined[-1] = (joined[-1][0], run[1], run[2])
        else:
            joined.append(run)
    return joined


def _ramps(angle_deg: FloatArray, runs: list[tuple[int, int, int]], half: int, tolerance: float) -> tuple[Ramp, ...]:
    """Return the ramps from runs, each from where the angle leaves the tolerance of a level to where it enters the next one's."""
    size = angle_deg.size
    cuts = [0, *((before[1] + after[0]) // 2 for before, after in pairwise(runs)), size]
    ramps: list[Ramp] = []
    for number, (start, stop, direction) in enumerate(runs):
        middle = (start + stop) // 2
        before = _level(angle_deg, runs[number - 1][1] if number else 0, start, half)
        after = _level(angle_deg, stop, runs[number + 1][0] if number + 1 < len(runs) else size, half)
        # an edge may be detected slightly away from a reversal
        low = max(cuts[number] - (half if before is None else 0), 0)
        high = min(cuts[number + 1] + (half if after is None else 0), size)
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
    """Return the last sample at a level before the midpoint of a ramp; at a mere reversal, the last of the extreme samples."""
    part = a[low : middle + 1]
    if level is None:
        return middle - int(np.argmin(direction * part[::-1]))
    held = np.flatnonzero(direction * (part - level) <= tolerance)
    return low + int(held[-1]) if held.size else low


def _enters(a: FloatArray, middle: int, high: int, level: float | None, tolerance: float, direction: int) -> int:
    """Return the first sample at a level after the midpoint of a ramp; at a mere reversal, the first extreme sample."""
    part = a[middle:high]
    if level is None:
        return middle + int(np.argmax(direction * part))
    held = np.flatnonzero(direction * (part - level) >= -tolerance)
    return middle + int(held[0]) if held.size else high - 1


def _check_sampled(ramps: tuple[Ramp, ...], name: str) -> None:
    """Raise `DataError` if the angle jumps, as in a list of set points without samples in between."""
    inside = float(np.median([ramp.stop - ramp.start - 2 for ramp in ramps]))
    if inside < 3.0:
        _refuse_jumps(max(inside, 0.0), name)


def _refuse_jumps(inside: float, name: str) -> NoReturn:
    limit = f"jumps from level to level, with {inside:g} samples in a ramp"
    remedy = f"provide the measured {name} instead of the set points, sampled at least five times in a ramp"
    raise DataError(name, limit=limit, remedy=remedy)


def _holds(ramps: tuple[Ramp, ...], size: int) -> IndexArray:
    stops = [0, *(ramp.stop for ramp in ramps)]
    starts = [*(ramp.start for ramp in ramps), size - 1]
    pairs = [(start, stop + 1) for start, stop in zip(stops, starts, strict=True) if stop + 1 - start > 2]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def _speed(time_s: FloatArray, ramps: tuple[Ramp, ...]) -> float:
    took = np.array([time_s[ramp.stop - 1] - time_s[ramp.start] for ramp in ramps])
    way = np.array([abs(ramp.end_deg - ramp.start_deg) for ramp in ramps])
    return float(np.median(way[took > 0.0] / took[took > 0.0])) if (took > 0.0).any() else 0.0


def _rest(angle_deg: FloatArray, ramps: tuple[Ramp, ...], ends: tuple[float, float]) -> tuple[float, int]:
    """Return the angle at which cycles begin, and the side towards which the first ramp leaves it.

    This is the level before the first ramp. If the recording begins during a ramp, it is the level after the last ramp;
    otherwise 0 or the midpoint of the range.
    """
    low, high = ends
    if ramps[0].start > 2:
        return ramps[0].start_deg, ramps[0].direction
    middle = 0.0 if low < 0.0 < high else 0.5 * (low + high)
    rest = ramps[-1].end_deg if angle_deg.size - ramps[-1].stop > 2 else middle
    if rest > high - _TENTH * (high - low):
        return rest, -1
    return rest, 1 if rest < low + _TENTH * (high - low) else _side(ramps, rest, _TENTH * (high - low))


def _side(ramps: tuple[Ramp, ...], rest: float, far: float) -> int:
    """Return the side of the first ramp that leaves a rest level within the range."""
    for ramp in ramps:
        if abs(ramp.start_deg - rest) <= far:
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
    away = first * (angle_deg - rest)
    far = _TENTH * float(np.ptp([end for ramp in ramps for end in (ramp.start_deg, ramp.end_deg)]))
    starts = _starts(away, ramps, rest, first, far, tolerance)
    if not starts:
        raise DataError(
            name, limit="contains no cycle that starts from rest", remedy="record at least one complete cycle"
        )
    following = [*starts[1:], (None, tolerance)]
    spans = [_span(away, start, stop, within) for (start, _), (stop, within) in zip(starts, following, strict=True)]
    if bool((away > -far).all()):
        spans = _with_their_ramps(spans, ramps, first)
    both = [bool(np.min(away[a:b]) < -far) for a, b, _ in spans]
    wanted = 2 * sum(both[:-1]) >= len(both[:-1]) if len(both) > 1 else both[0]
    whole = [back and (two or not wanted) for (_, _, back), two in zip(spans, both, strict=True)]
    cycles = tuple(
        Cycle(float(time_s[a]), float(time_s[b - 1]), a, b) for (a, b, _), ok in zip(spans, whole, strict=True) if ok
    )
    if not cycles:
        raise DataError(
            name, limit="contains no complete cycle", remedy="record at least one complete cycle, from rest to rest"
        )
    warnings = [
        warning(f"the cycle that begins at {time_s[a]:.6g} s is incomplete and is omitted")
        for (a, _, _), ok in zip(spans, whole, strict=True)
        if not ok
    ]
    if abs(ramps[0].start_deg - rest) > far:
        begun = f"the recording begins during a motion: data before {time_s[starts[0][0]]:.6g} s are omitted"
        warnings.insert(0, warning(begun))
    return cycles, tuple(warnings)


def _starts(
    away: FloatArray, ramps: tuple[Ramp, ...], rest: float, first: int, far: float, tolerance: float
) -> list[tuple[int, float]]:
    """Return the last sample at rest before each excursion to the first side, and the tolerance for rest there.

    If a ramp only passes through the rest level, no sample near it may be omitted: only the crossing itself counts as
    rest.
    """
    found: list[tuple[int, float]] = []
    for ramp in ramps:
        if ramp.direction == first and first * (ramp.start_deg - rest) <= far < first * (ramp.end_deg - rest):
            low = found[-1][0] + 1 if found else 0
            within = 0.0 if first * (ramp.start_deg - rest) < -far else tolerance
            held = np.flatnonzero(away[low : ramp.stop] <= within)
            found.append((low + int(held[-1]) if held.size else ramp.start, within))
    return found


def _with_their_ramps(
    spans: list[tuple[int, int, bool]], ramps: tuple[Ramp, ...], first: int
) -> list[tuple[int, int, bool]]:
    """Extend cycles from the beginning of their first ramp to the end of their last ramp.

    Otherwise, if the rest level is an end of the range (e.g. without load), values near it would not belong to any
    cycle.
    """
    away, back = ([ramp for ramp in ramps if ramp.direction == side] for side in (first, -first))
    begins = [next((ramp.start for ramp in away if ramp.start <= a < ramp.stop), a) for a, _, _ in spans]
    ends = [next((ramp.stop for ramp in back if ramp.start < b <= ramp.stop), b) for _, b, _ in spans]
    limits = [*(begin + 1 for begin in begins[1:]), ends[-1]]
    return [(a, min(b, limit), whole) for a, b, limit, (_, _, whole) in zip(begins, ends, limits, spans, strict=True)]


def _span(away: FloatArray, start: int, following: int | None, tolerance: float) -> tuple[int, int, bool]:
    """Return the samples of a cycle, and whether it returned to rest."""
    stop = away.size if following is None else following + 1
    out = np.flatnonzero(np.abs(away[start:stop]) > tolerance)
    last = start + int(out[-1]) + 1 if out.size else stop - 1
    back = last < stop or following is not None
    return start, min(last + 1, stop), back

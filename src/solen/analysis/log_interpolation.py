"""The angle of a stage between its log entries: linear, except at the beginning and end of a ramp.

A straight line between the entries on either side of the end of a ramp cuts its corner. If the entries on one side are
on the line of the ramp and the entries on the other side at the level of the hold, the corner is at the intersection of
the two lines, which becomes a node. Otherwise the stage slowed down over several entries, and these are sufficient. In
both cases the angle is least certain there, and `LoggedAngle.on_corner` marks these times.

Public names: `logged_angle` and `LoggedAngle`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from solen.analysis.motion import Motion, Ramp
from solen.arrays import BoolArray, FloatArray, IndexArray

_NEAR = 4  # entries to which a line is fitted
_NOISES, _STEPS = 4.0, 1.0  # largest distance of an entry from its line, in units of noise and of steps


@dataclass(frozen=True, eq=False)
class LoggedAngle:
    """Angle of a stage as a function of log time.

    Attributes
    ----------
    time_s, angle_deg
        Nodes between which the angle is linear, (k,).
    corners_s
        Start and end of each interval that contains a corner, ascending, (c, 2).
    """

    time_s: FloatArray
    angle_deg: FloatArray
    corners_s: FloatArray

    def at(self, time_s: FloatArray, window_s: float = 0.0) -> FloatArray:
        """Angle (n,) at the specified times, or its mean over a window about each time; NaN outside the log."""
        if not window_s:
            return np.asarray(np.interp(time_s, self.time_s, self.angle_deg, left=np.nan, right=np.nan))
        upper, lower = self._integral(time_s + 0.5 * window_s), self._integral(time_s - 0.5 * window_s)
        return np.asarray((upper - lower) / window_s)

    def on_corner(self, time_s: FloatArray, window_s: float = 0.0) -> BoolArray:
        """Whether each time, or the window about it, contains the beginning or end of a ramp, (n,)."""
        starts, ends = self.corners_s[:, 0] - 0.5 * window_s, self.corners_s[:, 1] + 0.5 * window_s
        return np.asarray(np.searchsorted(starts, time_s) > np.searchsorted(np.maximum.accumulate(ends), time_s))

    def _integral(self, time_s: FloatArray) -> FloatArray:
        area = np.cumsum(0.5 * (self.angle_deg[1:] + self.angle_deg[:-1]) * np.diff(self.time_s))
        place = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, self.time_s.size - 2)
        value = self.at(time_s)
        return np.append(0.0, area)[place] + 0.5 * (self.angle_deg[place] + value) * (time_s - self.time_s[place])


def logged_angle(log_s: FloatArray, log_deg: FloatArray, motion: Motion) -> LoggedAngle:
    """Interpolate the logged angle, including the corners.

    Parameters
    ----------
    log_s, log_deg
        Entries, (k,), with non-decreasing times.
    motion
        Motion detected in these entries.
    """
    tolerance = max(_NOISES * motion.noise_deg, _STEPS * motion.step_deg, 1e-6 * (motion.high_deg - motion.low_deg))
    nodes, spans = [], []
    for before, after, place in _ends(motion, log_s, log_deg):
        found = _corner(log_s, log_deg, before, after, tolerance)
        if found is None:
            spans.append((log_s[max(place - 1, 0)], log_s[min(place + 2, log_s.size - 1)]))
            continue
        when, level, first, last = found
        spans.append((log_s[first], log_s[last]))
        if last == first + 1:
            nodes.append((when, level))
    more = np.array(nodes).reshape(-1, 2)
    times, angles = np.append(log_s, more[:, 0]), np.append(log_deg, more[:, 1])
    order = np.argsort(times, kind="stable")
    corners = np.array(sorted(spans), dtype=np.float64).reshape(-1, 2)
    return LoggedAngle(times[order], angles[order], corners)


_Line = tuple[float, float, float]
"""Time, angle at this time, and speed."""


def _ends(motion: Motion, log_s: FloatArray, log_deg: FloatArray) -> Iterator[tuple[_Line | None, _Line | None, int]]:
    """Lines before and after each end of each ramp, and the nearest log entry; None if there are too few entries."""
    ramps, final = motion.ramps, log_s.size - 1
    lines = [[_through(log_s, log_deg, part) for part in _ways(ramp)] for ramp in ramps]
    for number, ramp in enumerate(ramps):
        held = ramp.start - ramps[number - 1].stop if number else ramp.start
        if held > 0:
            yield _level(log_s, log_deg, ramp.start - held, ramp.start), lines[number][0], ramp.start
        last = number + 1 == len(ramps)
        held = (final if last else ramps[number + 1].start) - ramp.stop
        after = _level(log_s, log_deg, ramp.stop, ramp.stop + held) if last or held > 0 else lines[number + 1][0]
        yield lines[number][1], after, ramp.stop - 2


def _ways(ramp: Ramp) -> tuple[IndexArray, IndexArray]:
    """Log entries near the beginning and near the end of a ramp that are on its line."""
    inside = np.arange(ramp.start + 1, ramp.stop - 1, dtype=np.intp)
    steady = inside[1:-1] if inside.size > _NEAR else inside
    return steady[:_NEAR], steady[-_NEAR:]


def _level(log_s: FloatArray, log_deg: FloatArray, first: int, last: int) -> _Line | None:
    """Level of a hold, as a line with zero slope."""
    if last - first < 1:
        return None
    return float(log_s[first]), float(np.median(log_deg[first : last + 1])), 0.0


def _through(log_s: FloatArray, log_deg: FloatArray, places: IndexArray) -> _Line | None:
    """Least-squares line of a ramp."""
    times, angles = log_s[places], log_deg[places]
    if places.size < 2 or times[-1] <= times[0]:
        return None
    away = times - times.mean()
    return float(times.mean()), float(angles.mean()), float(away @ angles / (away @ away))


def _corner(
    log_s: FloatArray, log_deg: FloatArray, before: _Line | None, after: _Line | None, tolerance: float
) -> tuple[float, float, int, int] | None:
    """Intersection of two lines, and the entries on both sides beyond which all entries are on their line."""
    if before is None or after is None or before[2] == after[2]:
        return None
    (t0, a0, v0), (t1, a1, v1) = before, after
    when = (a1 - a0 + v0 * t0 - v1 * t1) / (v0 - v1)
    last = int(np.searchsorted(log_s, when))
    first = last - 1
    if not 0 < last < log_s.size:
        return None
    for _ in range(_NEAR):
        if first and abs(log_deg[first] - a0 - v0 * (log_s[first] - t0)) > tolerance:
            first -= 1
        if last < log_s.size - 1 and abs(log_deg[last] - a1 - v1 * (log_s[last] - t1)) > tolerance:
            last += 1
    return when, a0 + v0 * (when - t0), first, last

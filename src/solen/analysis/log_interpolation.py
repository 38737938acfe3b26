"""The angle of a stage between its log entries: linear, except at the beginning and end of a ramp.

A straight line between the last entry on a ramp and the first entry of the hold cuts the corner. If the entries on one
side are on the line of the ramp and those on the other side at the level of the hold, the corner is the intersection of
the two lines, and becomes a node. Otherwise the stage slowed down over several entries, which describe the corner
themselves. In both cases the angle is least certain near a corner, and `LoggedAngle.on_corner` marks these times.

Public names: `logged_angle` and `LoggedAngle`.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from solen.analysis.motion import Motion, Ramp
from solen.arrays import BoolArray, FloatArray, IndexArray

_MAX_ENTRIES = 4  # largest number of entries to which a line is fitted
_MAX_NOISES, _MAX_STEPS = 4.0, 1.0  # largest distance of an entry from its line, in units of noise and of steps


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
        """Return the angle (n,) at given times, or its mean over a window about each time; NaN outside the log."""
        if not window_s:
            return np.asarray(np.interp(time_s, self.time_s, self.angle_deg, left=np.nan, right=np.nan))
        upper, lower = self._integral(time_s + 0.5 * window_s), self._integral(time_s - 0.5 * window_s)
        return np.asarray((upper - lower) / window_s)

    def on_corner(self, time_s: FloatArray, window_s: float = 0.0) -> BoolArray:
        """Return whether each time, or the window about it, contains the beginning or end of a ramp, (n,)."""
        starts, ends = self.corners_s[:, 0] - 0.5 * window_s, self.corners_s[:, 1] + 0.5 * window_s
        return np.asarray(np.searchsorted(starts, time_s) > np.searchsorted(np.maximum.accumulate(ends), time_s))

    def _integral(self, time_s: FloatArray) -> FloatArray:
        area = np.cumsum(0.5 * (self.angle_deg[1:] + self.angle_deg[:-1]) * np.diff(self.time_s))
        node = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, self.time_s.size - 2)
        angle = self.at(time_s)
        return np.append(0.0, area)[node] + 0.5 * (self.angle_deg[node] + angle) * (time_s - self.time_s[node])


def logged_angle(log_s: FloatArray, log_deg: FloatArray, motion: Motion) -> LoggedAngle:
    """Interpolate the logged angle, including the corners.

    Parameters
    ----------
    log_s, log_deg
        Entries, (k,), with non-decreasing times.
    motion
        Motion detected in these entries.
    """
    reach_deg = motion.high_deg - motion.low_deg
    tolerance = max(_MAX_NOISES * motion.noise_deg, _MAX_STEPS * motion.step_deg, 1e-6 * reach_deg)
    nodes, spans = [], []
    for before, after, entry in _ends(motion, log_s, log_deg):
        corner = _corner(log_s, log_deg, before, after, tolerance)
        if corner is None:
            spans.append((log_s[max(entry - 1, 0)], log_s[min(entry + 2, log_s.size - 1)]))
            continue
        corner_s, corner_deg, first, last = corner
        spans.append((log_s[first], log_s[last]))
        if last == first + 1:
            nodes.append((corner_s, corner_deg))
    added = np.array(nodes).reshape(-1, 2)
    times, angles = np.append(log_s, added[:, 0]), np.append(log_deg, added[:, 1])
    order = np.argsort(times, kind="stable")
    corners = np.array(sorted(spans), dtype=np.float64).reshape(-1, 2)
    return LoggedAngle(times[order], angles[order], corners)


_Line = tuple[float, float, float]
"""Time, angle at this time, and speed."""


def _ends(motion: Motion, log_s: FloatArray, log_deg: FloatArray) -> Iterator[tuple[_Line | None, _Line | None, int]]:
    """Yield the lines before and after each end of a ramp (None with too few entries), and the nearest log entry."""
    ramps, final = motion.ramps, log_s.size - 1
    lines = [[_fitted_line(log_s, log_deg, entries) for entries in _end_entries(ramp)] for ramp in ramps]
    for index, ramp in enumerate(ramps):
        hold_start = ramps[index - 1].stop if index else 0
        if ramp.start > hold_start:
            yield _level(log_s, log_deg, hold_start, ramp.start), lines[index][0], ramp.start
        last = index + 1 == len(ramps)
        hold_stop = final if last else ramps[index + 1].start
        hold_follows = last or hold_stop > ramp.stop
        after = _level(log_s, log_deg, ramp.stop, hold_stop) if hold_follows else lines[index + 1][0]
        yield lines[index][1], after, ramp.stop - 2


def _end_entries(ramp: Ramp) -> tuple[IndexArray, IndexArray]:
    """Return the indices of log entries on the line of a ramp, near its beginning and near its end."""
    inside = np.arange(ramp.start + 1, ramp.stop - 1, dtype=np.intp)
    steady = inside[1:-1] if inside.size > _MAX_ENTRIES else inside
    return steady[:_MAX_ENTRIES], steady[-_MAX_ENTRIES:]


def _level(log_s: FloatArray, log_deg: FloatArray, first: int, last: int) -> _Line | None:
    """Return the level of a hold, as a line with zero slope."""
    if last - first < 1:
        return None
    return float(log_s[first]), float(np.median(log_deg[first : last + 1])), 0.0


def _fitted_line(log_s: FloatArray, log_deg: FloatArray, entries: IndexArray) -> _Line | None:
    """Return the least-squares line through some entries."""
    times, angles = log_s[entries], log_deg[entries]
    if entries.size < 2 or times[-1] <= times[0]:
        return None
    centred = times - times.mean()
    return float(times.mean()), float(angles.mean()), float(centred @ angles / (centred @ centred))


def _corner(
    log_s: FloatArray, log_deg: FloatArray, before: _Line | None, after: _Line | None, tolerance: float
) -> tuple[float, float, int, int] | None:
    """Return the intersection of two lines, and on either side the nearest entry that is on the line of that side."""
    if before is None or after is None or before[2] == after[2]:
        return None
    (t0, a0, v0), (t1, a1, v1) = before, after
    corner_s = (a1 - a0 + v0 * t0 - v1 * t1) / (v0 - v1)
    last = int(np.searchsorted(log_s, corner_s))
    first = last - 1
    if not 0 < last < log_s.size:
        return None
    for _ in range(_MAX_ENTRIES):
        if first and abs(log_deg[first] - a0 - v0 * (log_s[first] - t0)) > tolerance:
            first -= 1
        if last < log_s.size - 1 and abs(log_deg[last] - a1 - v1 * (log_s[last] - t1)) > tolerance:
            last += 1
    return corner_s, a0 + v0 * (corner_s - t0), first, last

"""Monotonic range: the range about a position over which a reading only rises or only falls.

It is bounded by two ranges: the longest over which no fall between any two angles is significant, and the range over
which the rise is significant. A reversal that is smaller than the uncertainty and shorter than a tenth of the motion is
not detected.

Public name: `monotone_deg`.
"""

import math

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray

COVERED = 3.0
"""Change between two angles that is significant, in units of the sum of their standard uncertainties: of a thousand
pairs of angles of a constant reading, hardly any differs by more.
"""
APART = 0.1
"""Distance, as a fraction of the motion, beyond which any two angles must differ significantly. Without it, the
range of significant change would vanish for small steps.
"""


def monotone_deg(angle: FloatArray, value: FloatArray, u: FloatArray, at_deg: float) -> tuple[float, float]:
    """Return the length of the range about a position over which a reading is monotonic, and its uncertainty.

    The length is the midpoint of the smallest and the largest possible length; the uncertainty is half their
    difference. A turning point may be one step beyond the angle at which it appears. Both results are NaN without a
    position, or if no two angles differ significantly, since a constant has no range.

    Parameters
    ----------
    angle, value, u
        (A,) ascending angles, the reading there, and its standard uncertainty.
    at_deg
        Position inside the range; if a turning point is within one step of it, the range on either side may be
        returned.
    """
    if math.isnan(at_deg):
        return math.nan, math.nan
    change = value - value[:, None]
    certain = COVERED * (u + u[:, None])
    if not (np.abs(change) > certain).any():
        return math.nan, math.nan
    near = min(max(int(np.searchsorted(angle, at_deg)) - 1, 0), angle.size - 2)
    steps = range(max(near - 1, 0), min(near + 2, angle.size - 1))
    rises, falls = np.triu(change > certain, 1), np.triu(-change > certain, 1)
    ways = [(_bounds(angle, rises, falls, step), _bounds(angle, falls, rises, step)) for step in steps]
    least = min(max(up[0], down[0]) for up, down in ways)
    most = max(max(up[1], down[1]) for up, down in ways)
    return (least + most) / 2.0, (most - least) / 2.0


def _bounds(angle: FloatArray, rises: BoolArray, falls: BoolArray, step: int) -> tuple[float, float]:
    """Return the smallest and largest possible length of the range about a step with a rising reading."""
    first_fall = np.where(falls.any(axis=1), falls.argmax(axis=1), angle.size)
    reach = np.minimum.accumulate(first_fall[::-1])[::-1] - 1
    starts: IntArray = np.flatnonzero(reach[: step + 1] > step)
    if not starts.size:
        return 0.0, 0.0
    first = int(starts[np.argmax(angle[reach[starts]] - angle[starts])])
    last = int(reach[first])
    most = angle[min(last + 1, angle.size - 1)] - angle[max(first - 1, 0)]
    begin, end = _certain(angle, rises[first : last + 1, first : last + 1], first, step)
    if end <= begin:
        return 0.0, float(most)
    missed = (angle[1] - angle[0]) * (begin > 0) + (angle[-1] - angle[-2]) * (end < angle.size - 1)
    return max(0.0, float(angle[end] - angle[begin] - missed)), float(most)


def _certain(angle: FloatArray, rises: BoolArray, first: int, step: int) -> tuple[int, int]:
    """Return the positions about a step between which the reading rises significantly; twice the same if none.

    The range ends at the first angle that may be the highest, or at which the change over `APART` becomes too small.
    """
    count, near = len(rises), step - first
    lowest, highest = (np.asarray(~rises.any(axis=axis)) for axis in (0, 1))  # may be the lowest, the highest
    begin = int(np.flatnonzero(lowest[: near + 1])[-1])
    end = near + 1 + int(np.flatnonzero(highest[near + 1 :])[0])
    own = angle[first : first + count]
    apart = APART * (angle[-1] - angle[0]) * (1.0 - 1e-9)
    for low in range(begin, end):
        high = max(low + 1, int(np.searchsorted(own, own[low] + apart)))
        if high > end or rises[low, high]:
            continue
        if low > near:
            end = low
            break
        if high > near:
            return step, step
        begin = high
    return (first + begin, first + end) if rises[begin, end] else (step, step)

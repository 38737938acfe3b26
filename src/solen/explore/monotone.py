"""Monotonic range: the range about a position over which a reading only rises or only falls.

The length of a rise lies between those of two ranges: the longest over which no fall between any two angles is
significant, and the one over which the rise is significant. A reversal that is smaller than the uncertainty and shorter
than a tenth of the motion is not detected.

Public name: `monotone_deg`.
"""

import math

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray

SIGNIFICANT_U = 3.0
"""Smallest significant change between two angles, in units of the sum of their standard uncertainties. A constant
reading exceeds it for about one in 40,000 pairs of angles with equal uncertainties.
"""
MIN_DISTANCE = 0.1
"""Distance, as a fraction of the motion, from which the readings at two angles must differ significantly. Without it,
the range of significant change would vanish for small steps.
"""


def monotone_deg(angle: FloatArray, value: FloatArray, u: FloatArray, at_deg: float) -> tuple[float, float]:
    """Return the length of the range about a position over which a reading is monotonic, and its uncertainty.

    The length is the midpoint of the smallest and the largest possible length; the uncertainty is half their
    difference. A turning point may be one step further than the angle at which it appears. Both results are NaN
    without a position, or if the readings at no two angles differ significantly, since a constant has no range.

    Parameters
    ----------
    angle, value, u
        (A,) ascending angles, the readings, and their standard uncertainties.
    at_deg
        Position inside the range; if a turning point is within one step of it, the range on either side of that point
        may be returned.
    """
    if math.isnan(at_deg):
        return math.nan, math.nan
    change = value - value[:, None]
    threshold = SIGNIFICANT_U * (u + u[:, None])
    if not (np.abs(change) > threshold).any():
        return math.nan, math.nan
    nearest = min(max(int(np.searchsorted(angle, at_deg)) - 1, 0), angle.size - 2)
    steps = range(max(nearest - 1, 0), min(nearest + 2, angle.size - 1))
    rises, falls = np.triu(change > threshold, 1), np.triu(-change > threshold, 1)
    bounds = [(_bounds(angle, rises, falls, step), _bounds(angle, falls, rises, step)) for step in steps]
    shortest = min(max(up[0], down[0]) for up, down in bounds)
    longest = max(max(up[1], down[1]) for up, down in bounds)
    return (shortest + longest) / 2.0, (longest - shortest) / 2.0


def _bounds(angle: FloatArray, rises: BoolArray, falls: BoolArray, step: int) -> tuple[float, float]:
    """Return the smallest and largest possible length of the range about a step with a rising reading."""
    first_fall = np.where(falls.any(axis=1), falls.argmax(axis=1), angle.size)
    reach = np.minimum.accumulate(first_fall[::-1])[::-1] - 1
    starts: IntArray = np.flatnonzero(reach[: step + 1] > step)
    if not starts.size:
        return 0.0, 0.0
    first = int(starts[np.argmax(angle[reach[starts]] - angle[starts])])
    last = int(reach[first])
    longest = angle[min(last + 1, angle.size - 1)] - angle[max(first - 1, 0)]
    begin, end = _significant_rise(angle, rises[first : last + 1, first : last + 1], first, step)
    if end <= begin:
        return 0.0, float(longest)
    margin = (angle[1] - angle[0]) * (begin > 0) + (angle[-1] - angle[-2]) * (end < angle.size - 1)
    return max(0.0, float(angle[end] - angle[begin] - margin)), float(longest)


def _significant_rise(angle: FloatArray, rises: BoolArray, first: int, step: int) -> tuple[int, int]:
    """Return the first and the last index of the significant rise about a step; two equal indices if there is none.

    The rise ends at the first angle at which the reading may be highest, or at which the change over `MIN_DISTANCE`
    becomes too small.
    """
    count, middle = len(rises), step - first
    lowest, highest = (np.asarray(~rises.any(axis=axis)) for axis in (0, 1))  # may be the lowest, the highest
    begin = int(np.flatnonzero(lowest[: middle + 1])[-1])
    end = middle + 1 + int(np.flatnonzero(highest[middle + 1 :])[0])
    part = angle[first : first + count]
    distance = MIN_DISTANCE * (angle[-1] - angle[0]) * (1.0 - 1e-9)
    for low in range(begin, end):
        high = max(low + 1, int(np.searchsorted(part, part[low] + distance)))
        if high > end or rises[low, high]:
            continue
        if low > middle:
            end = low
            break
        if high > middle:
            return step, step
        begin = high
    return (first + begin, first + end) if rises[begin, end] else (step, step)

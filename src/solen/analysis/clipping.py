"""Detection of samples clipped at the limits of a recorder.

A converter, amplifier or circuit at its rail repeats one value, the largest or the smallest of the entire recording,
while the angle continues to change. A hold or a coarse converter also repeats values. Therefore only runs of exactly
the same extreme value within ramps count, and only if no other value in the recording is repeated as many times. If the
rails are known, every sample at or beyond a rail counts instead.

`clipped` marks samples.
"""

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray, IntArray

_RUN = 3
"""Smallest number of successive samples at an extreme value during a motion that count as clipped."""
_TIMES = 2  # smallest ratio to the longest run of any other value


def clipped(volts: FloatArray, moving: BoolArray, rails: tuple[float, float] | None = None) -> BoolArray:
    """Return which samples of a receiver are clipped, (n,).

    Parameters
    ----------
    volts
        Voltages, (n,).
    moving
        Whether each sample belongs to a ramp, (n,).
    rails
        Lowest and highest voltage that can be recorded; None if unknown.
    """
    if rails is not None:
        return np.asarray((volts <= rails[0]) | (volts >= rails[1]))
    found = np.zeros(volts.size, dtype=bool)
    if not np.isfinite(volts).any():
        return found
    starts, stops = _runs(volts)
    counts = _moving_counts(moving, starts, stops)
    low, high = np.nanmin(volts), np.nanmax(volts)
    values = volts[starts]
    ends = (values == low) | (values == high)
    usual = int(counts[~ends].max(initial=0))
    for end in (low, high):
        ours = values == end
        if low < high and counts[ours].max(initial=0) >= max(_RUN, _TIMES * usual + 1):
            found |= volts == end
    return found


def _runs(volts: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Slice bounds of each run of equal values."""
    bounds = np.flatnonzero(np.diff(volts) != 0.0) + 1
    return np.append(0, bounds).astype(np.intp), np.append(bounds, volts.size).astype(np.intp)


def _moving_counts(moving: BoolArray, starts: IndexArray, stops: IndexArray) -> IntArray:
    """Number of moving samples in each run."""
    total = np.append(0, np.cumsum(moving))
    return np.asarray(total[stops] - total[starts], dtype=np.int64)

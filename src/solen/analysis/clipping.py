"""Detection of samples clipped at the limits of a recorder.

A saturated ADC, amplifier or circuit repeats one value, the largest or the smallest of the entire recording, while the
angle continues to change. Values also repeat in a hold, or with a coarse ADC. The samples at an extreme value are
therefore treated as clipped only if this exact value occurs in a run of successive samples within a ramp, and this run
is more than twice as long as any run of another value. If the rails are known, every sample at or outside a rail is
clipped instead.

`clipped` marks samples.
"""

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray, IntArray

_MIN_RUN = 3
"""Smallest number of successive samples at an extreme value, during a motion, that are considered clipped."""
_MIN_RATIO = 2  # such a run is longer than this multiple of the longest run of any other value


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
    marked = np.zeros(volts.size, dtype=bool)
    if not np.isfinite(volts).any():
        return marked
    starts, stops = _runs(volts)
    counts = _moving_counts(moving, starts, stops)
    low, high = np.nanmin(volts), np.nanmax(volts)
    values = volts[starts]
    inner = (values != low) & (values != high)
    longest_inner = int(counts[inner].max(initial=0))
    for extreme in (low, high):
        longest = counts[values == extreme].max(initial=0)
        if low < high and longest >= max(_MIN_RUN, _MIN_RATIO * longest_inner + 1):
            marked |= volts == extreme
    return marked


def _runs(volts: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Return the slice bounds of each run of equal values."""
    bounds = np.flatnonzero(np.diff(volts) != 0.0) + 1
    return np.append(0, bounds).astype(np.intp), np.append(bounds, volts.size).astype(np.intp)


def _moving_counts(moving: BoolArray, starts: IndexArray, stops: IndexArray) -> IntArray:
    """Return the number of moving samples in each run."""
    total = np.append(0, np.cumsum(moving))
    return np.asarray(total[stops] - total[starts], dtype=np.int64)

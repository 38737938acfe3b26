"""Recorded time stamps, which may be irregular, repeated or out of order, or have gaps between them.

Samples are used at their recorded times and never resampled, so an irregular clock needs no correction. Gaps, repeated
time stamps and samples out of order cause a warning that locates them. If more than a few samples are out of order, the
clock was reset or two recordings were joined; this is an error, because the true order is unknown.

Public names: `time_base` and `TimeBase`.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.errors import DataError
from solen.ranks import Caution, warning

MAX_GAP_STEPS = 5.0
"""A step longer than this many times the median step is a gap."""
_MAX_BACK_STEPS, _MAX_BACK_FRACTION = 10.0, 0.01  # largest jump back, and fraction of such samples, that are sorted
_MIN_SAMPLES = 16


@dataclass(frozen=True, eq=False)
class TimeBase:
    """Time order of the samples.

    Attributes
    ----------
    order
        Indices of the samples used, in time order, (n,).
    time_s
        Non-decreasing times of these samples, (n,).
    step_s
        Median step between two samples.
    gaps_s
        Start and end of each gap, (g, 2).
    warnings
        Warnings about irregularities of the clock.
    """

    order: IndexArray
    time_s: FloatArray
    step_s: float
    gaps_s: FloatArray
    warnings: tuple[Caution, ...]


def time_base(time_s: FloatArray, name: str = "time") -> TimeBase:
    """Determine the order of samples from their time stamps.

    Parameters
    ----------
    time_s
        Time stamps in s, NaN if missing, (n,).
    name
        Name for the time stamps in error messages.

    Raises
    ------
    DataError
        If there are too few time stamps, or the clock runs backward.
    """
    order = np.flatnonzero(np.isfinite(time_s))
    missing = time_s.size - order.size
    warnings = [warning(f"{missing} samples without a time are omitted")] if missing else []
    if order.size < _MIN_SAMPLES:
        limit = f"has {order.size} samples with a time, but at least {_MIN_SAMPLES} are required"
        raise DataError(name, limit=limit, remedy="name the time column with --time")
    steps = np.diff(time_s[order])
    if not (steps > 0.0).any():
        remedy = "name the time column with --time, or specify the rate with --rate-hz"
        raise DataError(name, limit="does not advance", remedy=remedy)
    step_s = float(np.median(steps[steps > 0.0]))
    if (steps < 0.0).any():
        warnings.append(_disorder_warning(time_s, order, steps, step_s, name))
        order = order[np.argsort(time_s[order], kind="stable")]
    ordered = time_s[order]
    warnings += _repetition_warnings(ordered)
    gaps = _gaps(ordered, step_s)
    warnings += _gap_warnings(gaps)
    return TimeBase(order, ordered, step_s, gaps, tuple(warnings))


def _disorder_warning(time_s: FloatArray, order: IndexArray, steps: FloatArray, step_s: float, name: str) -> Caution:
    """Return a warning about a few samples out of order; raise `DataError` if the clock was reset."""
    back = np.flatnonzero(steps < 0.0)
    worst = back[np.argmin(steps[back])]
    row = int(order[worst + 1]) + 1
    if -steps[worst] > _MAX_BACK_STEPS * step_s or back.size > _MAX_BACK_FRACTION * order.size:
        jump = f"jumps back {back.size} time{'s' * (back.size > 1)}, farthest at sample {row}"
        limit = f"{jump}: from {time_s[order[worst]]:.6g} s to {time_s[order[worst + 1]]:.6g} s"
        raise DataError(name, limit=limit, remedy="split the file at this jump, or export it with one continuous clock")
    return warning(
        f"{back.size} samples were out of order by up to {-steps[worst]:.3g} s (first at sample {row}) and are sorted"
    )


def _repetition_warnings(ordered: FloatArray) -> list[Caution]:
    repeats = np.flatnonzero(np.diff(ordered) == 0.0)
    if not repeats.size:
        return []
    first_s = ordered[repeats[0]]
    text = f"{repeats.size} samples have the same time as the previous sample (first at {first_s:.6g} s); all are kept"
    return [warning(text)]


def _gaps(ordered: FloatArray, step_s: float) -> FloatArray:
    wide = np.flatnonzero(np.diff(ordered) > MAX_GAP_STEPS * step_s)
    return np.column_stack([ordered[wide], ordered[wide + 1]])


def _gap_warnings(gaps: FloatArray) -> list[Caution]:
    if not len(gaps):
        return []
    longest = int(np.argmax(gaps[:, 1] - gaps[:, 0]))
    start, end = gaps[longest]
    count = f"{len(gaps)} gap{'s' * (len(gaps) > 1)} in the samples"
    return [warning(f"{count}, the longest {end - start:.3g} s from {start:.6g} s; they are not interpolated")]

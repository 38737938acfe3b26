"""Recorded time stamps, which may be irregular, repeated or out of order, or contain gaps.

Samples are used at their own times and never resampled, so an irregular clock needs no repair. Gaps, repeated stamps
and samples out of order cause a warning with their location. If the clock runs backward for more than a few samples, it
was reset or two recordings were joined; this is an error, because no order could be correct.

Public names: `time_base` and `TimeBase`.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.errors import DataError
from solen.ranks import Caution, warning

MAX_GAP_STEPS = 5.0
"""A step is a gap if it is at least this many times the usual step."""
_FEW_STEPS, _SHARE = 10.0, 0.01  # limits (in steps, and as a fraction of the samples) of disorder without a reset clock
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
        Usual step between two samples.
    gaps_s
        Start and end of each gap, (g, 2).
    warnings
        Irregularities of the clock.
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
        raise DataError(
            name,
            limit="does not advance",
            remedy="name the time column with --time, or specify the rate with --rate-hz",
        )
    usual = float(np.median(steps[steps > 0.0]))
    if (steps < 0.0).any():
        warnings.append(_disorder(time_s, order, steps, usual, name))
        order = order[np.argsort(time_s[order], kind="stable")]
    ordered = time_s[order]
    warnings += _repeated(ordered)
    gaps = _gaps(ordered, usual)
    warnings += _gap_words(gaps)
    return TimeBase(order, ordered, usual, gaps, tuple(warnings))


def _disorder(time_s: FloatArray, order: IndexArray, steps: FloatArray, usual: float, name: str) -> Caution:
    """Warning about a few samples out of order; `DataError` if the clock was reset."""
    back = np.flatnonzero(steps < 0.0)
    worst = back[np.argmin(steps[back])]
    row = int(order[worst + 1]) + 1
    if -steps[worst] > _FEW_STEPS * usual or back.size > _SHARE * order.size:
        jump = f"jumps back {back.size} time{'s' * (back.size > 1)}, farthest at sample {row}"
        limit = f"{jump}: from {time_s[order[worst]]:.6g} s to {time_s[order[worst + 1]]:.6g} s"
        raise DataError(name, limit=limit, remedy="split the file there, or export it with a single continuous clock")
    return warning(
        f"{back.size} samples were out of order by up to {-steps[worst]:.3g} s (first at sample {row}) and are sorted"
    )


def _repeated(ordered: FloatArray) -> list[Caution]:
    same = int(np.sum(np.diff(ordered) == 0.0))
    if not same:
        return []
    where = ordered[np.flatnonzero(np.diff(ordered) == 0.0)[0]]
    return [warning(f"{same} samples have the same time as the previous sample (first at {where:.6g} s); all are kept")]


def _gaps(ordered: FloatArray, usual: float) -> FloatArray:
    wide = np.flatnonzero(np.diff(ordered) > MAX_GAP_STEPS * usual)
    return np.column_stack([ordered[wide], ordered[wide + 1]])


def _gap_words(gaps: FloatArray) -> list[Caution]:
    if not len(gaps):
        return []
    longest = int(np.argmax(gaps[:, 1] - gaps[:, 0]))
    start, end = gaps[longest]
    count = f"{len(gaps)} gap{'s' * (len(gaps) > 1)} in the samples"
    return [warning(f"{count}, the longest {end - start:.3g} s from {start:.6g} s; they are not interpolated")]

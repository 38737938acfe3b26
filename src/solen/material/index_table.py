"""The table of index against wavelength in a resin file: its rows, and warnings about missing values."""

import math
from itertools import pairwise

from solen.ranks import Caution, warning

MAX_ROWS = 64
"""Maximum number of wavelengths in the table."""
MAX_GAP_NM, MAX_GAP_STEPS = 20.0, 5.0
"""A gap between known wavelengths causes a warning if it exceeds both this width and this multiple of the median
step.
"""

Row = tuple[float, float, float | None]
"""Wavelength in nm, index, and its standard uncertainty; None if unknown."""


def thinned(rows: list[Row]) -> list[Row]:
    """Return the means of wavelength and index over equal intervals of the range, one row per interval.

    The uncertainty of a mean is the RMS value of the uncertainties: it is not reduced by averaging, because errors
    common to the entire spectrum do not average out. The first and the last wavelength are kept. A mean has no
    uncertainty if any of its rows has none.
    """
    if len(rows) <= MAX_ROWS:
        return _unique(rows)
    first, last = rows[0][0], rows[-1][0]
    width = (last - first) / (MAX_ROWS - 2)
    intervals: dict[int, list[Row]] = {}
    for row in rows[1:-1]:
        intervals.setdefault(min(int((row[0] - first) / width), MAX_ROWS - 3), []).append(row)
    return _unique([rows[0], *(_mean(group) for _, group in sorted(intervals.items())), rows[-1]])


def _mean(rows: list[Row]) -> Row:
    squares = [u**2 for _, _, u in rows if u is not None]
    u = math.sqrt(math.fsum(squares) / len(rows)) if len(squares) == len(rows) else None
    return math.fsum(nm for nm, _, _ in rows) / len(rows), math.fsum(n for _, n, _ in rows) / len(rows), u


def _unique(rows: list[Row]) -> list[Row]:
    """Return the rows in ascending order of wavelength, with rows of equal wavelength averaged."""
    groups: dict[float, list[Row]] = {}
    for row in rows:
        groups.setdefault(row[0], []).append(row)
    return [(nm, *_mean(group)[1:]) for nm, group in sorted(groups.items())]


def missing_u(wavelengths_nm: list[float], total: int) -> tuple[Caution, ...]:
    """Return a warning if only some of the indices have no uncertainty, in which case the table has none.

    Parameters
    ----------
    wavelengths_nm
        Wavelengths at which the index has no uncertainty.
    total
        Number of wavelengths in the table.
    """
    if len(wavelengths_nm) in {0, total}:
        return ()
    return (
        warning(
            f"{len(wavelengths_nm)} of {total} indices have no uncertainty, the first at {wavelengths_nm[0]:g} "
            "nm: the resin's index is stored without uncertainty"
        ),
    )


def gaps(wavelengths_nm: list[float]) -> tuple[Caution, ...]:
    """Return warnings about wide gaps in which no index is known."""
    steps = sorted(high - low for low, high in pairwise(wavelengths_nm))
    max_gap_nm = max(MAX_GAP_NM, MAX_GAP_STEPS * steps[len(steps) // 2])
    return tuple(
        warning(f"no index is known from {low:g} to {high:g} nm: the index is interpolated linearly there")
        for low, high in pairwise(wavelengths_nm)
        if high - low > max_gap_nm
    )

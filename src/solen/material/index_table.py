"""The table of an index against wavelength in a resin file: its rows, and warnings about missing values."""

import math
from itertools import pairwise

from solen.ranks import Caution, warning

MAX_ROWS = 64
"""Largest number of wavelengths in a table of a resin."""
WIDE_NM, WIDE_STEPS = 20.0, 5.0
"""A gap between known wavelengths causes a warning if it exceeds both this width and this multiple of the median
step.
"""


def thinned(rows: list[tuple[float, float, float | None]]) -> list[tuple[float, float, float | None]]:
    """Return the means of wavelength, index and uncertainty over equal parts of the range, one row per part.

    Noise averages out; the uncertainty is not reduced, because errors shared by the entire spectrum would be lost. The
    first and the last wavelength are kept. A part has no uncertainty if any of its rows has none.
    """
    if len(rows) <= MAX_ROWS:
        return _unique(rows)
    first, last = rows[0][0], rows[-1][0]
    width = (last - first) / (MAX_ROWS - 2)
    parts: dict[int, list[tuple[float, float, float | None]]] = {}
    for row in rows[1:-1]:
        parts.setdefault(min(int((row[0] - first) / width), MAX_ROWS - 3), []).append(row)
    return _unique([rows[0], *(_mean(part) for _, part in sorted(parts.items())), rows[-1]])


def _mean(rows: list[tuple[float, float, float | None]]) -> tuple[float, float, float | None]:
    squares = [u**2 for _, _, u in rows if u is not None]
    u = math.sqrt(math.fsum(squares) / len(rows)) if len(squares) == len(rows) else None
    return math.fsum(nm for nm, _, _ in rows) / len(rows), math.fsum(n for _, n, _ in rows) / len(rows), u


def _unique(rows: list[tuple[float, float, float | None]]) -> list[tuple[float, float, float | None]]:
    """Return rows by ascending wavelength, with rows of equal wavelength merged."""
    together: dict[float, list[tuple[float, float, float | None]]] = {}
    for row in rows:
        together.setdefault(row[0], []).append(row)
    return [(nm, *_mean(same)[1:]) for nm, same in sorted(together.items())]


def without_u(wavelengths_nm: list[float], of: int) -> tuple[Caution, ...]:
    """Return a warning if some of the wavelengths have no uncertainty, in which case the table has none."""
    if len(wavelengths_nm) in {0, of}:
        return ()
    return (
        warning(
            f"{len(wavelengths_nm)} of {of} indices have no uncertainty, the first at {wavelengths_nm[0]:g} "
            "nm: the resin's index is stored without uncertainty"
        ),
    )


def gaps(wavelengths_nm: list[float]) -> tuple[Caution, ...]:
    """Return warnings about wide ranges in which no index is known."""
    steps = sorted(high - low for low, high in pairwise(wavelengths_nm))
    wide = max(WIDE_NM, WIDE_STEPS * steps[len(steps) // 2])
    return tuple(
        warning(f"no index is known from {low:g} to {high:g} nm: it is interpolated linearly there")
        for low, high in pairwise(wavelengths_nm)
        if high - low > wide
    )

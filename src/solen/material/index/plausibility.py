"""Probable mistakes in a table of spectra, detected by the indices that result from them.

If the names of R and T are swapped, or fractions have a header in %, the index is impossible or undefined. If it
becomes plausible when the names are swapped, or when the values are treated as fractions, `check_plausibility` reports
the mistake instead of the impossible index.
"""

from collections.abc import Mapping

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.inversion import invert

_PLAUSIBLE = (1.2, 2.5)  # range of plausible indices of layers
_MAX_INDEX = 5.0  # larger than the index of silicon
_MAX_FRACTION = 0.0105  # largest T with a header in % that may be a fraction: 1 % with noise


def check_plausibility(rows: Mapping[str, FloatArray], names: Mapping[str, tuple[str, ...]]) -> None:
    """Raise an error if T and R are plausible only when swapped, or only as fractions instead of percentages.

    Parameters
    ----------
    rows, names
        Spectra as fractions, and their names, as in `solen.recording.optical.OpticalSpectra`.

    Raises
    ------
    DataError
        If a mistake is detected; the message contains the index with and without the correction.
    """
    if "T" not in rows:
        return
    t = rows["T"].mean(axis=0)
    r = rows["R"].mean(axis=0) if "R" in rows else 1.0 - t
    n = _index(r, t)
    if _PLAUSIBLE[0] < n < _MAX_INDEX:
        return
    traces = " and ".join(name for kind in ("T", "R") for name in names.get(kind, ()))
    if np.nanmax(t, initial=0.0) <= _MAX_FRACTION and _is_plausible(
        corrected := _index(100.0 * r if "R" in rows else 1.0 - 100.0 * t, 100.0 * t)
    ):
        raise DataError(
            f"traces {traces}",
            limit=f"look like fractions under a header in %: as % they give {_text(n)}, as fractions "
            f"n = {corrected:.3g}",
            remedy="remove the % from the header",
        )
    if "R" in rows and _is_plausible(corrected := _index(t, r)):
        raise DataError(
            f"traces {traces}",
            limit=f"appear to be swapped: as named they give {_text(n)}, swapped n = {corrected:.3g}",
            remedy="swap the two names",
        )


def _index(r: FloatArray, t: FloatArray) -> float:
    """Return the median index of a spectrum, which hardly depends on thickness and wavelength; NaN if undefined."""
    n = invert(r, t, 25.0, 600.0).n
    return float(np.nanmedian(n)) if np.isfinite(n).any() else np.nan


def _is_plausible(n: float) -> bool:
    return _PLAUSIBLE[0] < n < _PLAUSIBLE[1]


def _text(n: float) -> str:
    return "no index" if np.isnan(n) else f"n = {n:.3g}"

"""Probable mix-ups in a table of spectra, detected by the indices that result from them.

If the names of R and T are exchanged, or fractions are under a header in %, the index is impossible or undefined. If
the index becomes plausible when the names are exchanged, or the values are read as fractions, `check_plausibility`
reports the mix-up instead of the impossible number.
"""

from collections.abc import Mapping

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.inversion import invert

_LAYERS = (1.2, 2.5)  # range of plausible indices of layers
_IMPOSSIBLE = 5.0  # an index above that of silicon
_FRACTION = 0.0105  # largest T under a header in % that may be a fraction: 1 with noise


def check_plausibility(rows: Mapping[str, FloatArray], names: Mapping[str, tuple[str, ...]]) -> None:
    """Raise an error if T and R make sense only when exchanged, or only as fractions instead of percentages.

    Parameters
    ----------
    rows, names
        Spectra as fractions, and their names, as in `solen.recording.optical.OpticalSpectra`.

    Raises
    ------
    DataError
        If a mix-up is found; the message contains the index with and without the correction.
    """
    if "T" not in rows:
        return
    t = rows["T"].mean(axis=0)
    r = rows["R"].mean(axis=0) if "R" in rows else 1.0 - t
    stated = _index(r, t)
    if _LAYERS[0] < stated < _IMPOSSIBLE:
        return
    traces = " and ".join(name for kind in ("T", "R") for name in names.get(kind, ()))
    if np.nanmax(t, initial=0.0) <= _FRACTION and _is_layer(
        other := _index(100.0 * r if "R" in rows else 1.0 - 100.0 * t, 100.0 * t)
    ):
        raise DataError(
            f"traces {traces}",
            limit=f"look like fractions under a header in %: as % they give {_said(stated)}, as fractions {other:.2f}",
            remedy="remove the % from the header",
        )
    if "R" in rows and _is_layer(other := _index(t, r)):
        raise DataError(
            f"traces {traces}",
            limit=f"appear to be swapped: as named they give {_said(stated)}, swapped {other:.2f}",
            remedy="exchange the two names",
        )


def _index(r: FloatArray, t: FloatArray) -> float:
    """Return the index at the centre of a spectrum, independent of thickness and wavelength; NaN if undefined."""
    n = invert(r, t, 25.0, 600.0).n
    return float(np.nanmedian(n)) if np.isfinite(n).any() else np.nan


def _is_layer(n: float) -> bool:
    return _LAYERS[0] < n < _LAYERS[1]


def _said(n: float) -> str:
    return "no index" if np.isnan(n) else f"n = {n:.3g}"

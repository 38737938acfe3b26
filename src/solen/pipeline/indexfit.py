"""A formula through an index, and the literature beside it, as plain data for a result."""

from typing import Any

import numpy as np

from solen.errors import DataError
from solen.material.index import IndexSpectrum
from solen.material.index.fit import Fit, fit
from solen.material.index.literature import RESINS, band, check_dispersion, check_index
from solen.material.index.slab import FloatArray

FITS = ("cauchy", "sellmeier", "none")
LITERATURE = ("table", "package", "none")
_SHOWN = 101  # wavelengths at which a formula is written out
_FEW, _BEND = 10, 3.0  # points that tell no scatter; residuals above this many steps have a shape of their own
_SMALL = 1e-4  # of n, not worth a word


def formula(found: IndexSpectrum, kind: str | None, terms: int | None) -> Fit | str | None:
    """Formula through the wavelengths where n is known, or why there is none; None where none is wanted.

    By default a Cauchy formula, of what is a measurement. What was asked for and cannot be had raises `DataError`.
    """
    if kind == "none" or (kind is None and not found.measurement):
        return None
    n = found.n
    alone = n.u_random[n.known]
    u = np.where(n.known, n.u_random, np.nan) if (alone > 0.0).all() else None
    shared = n.common if n.common.size and np.isfinite(n.common[:, n.known]).all() else None
    value = np.where(n.known, n.value, np.nan)
    try:
        return fit(kind or "cauchy", found.wavelength_nm, value, u, shared=_filled(shared), terms=terms)
    except DataError as bad:
        if kind is not None:
            raise
        return f"no formula goes with it: {bad}"


def _filled(shared: FloatArray | None) -> FloatArray | None:
    """Common errors with 0 at masked wavelengths, which take no part."""
    return None if shared is None else np.nan_to_num(shared)


def formula_warnings(one: Fit | str | None) -> list[str]:
    """What a formula cannot be used for; why there is none."""
    if not isinstance(one, Fit):
        return [one] if one else []
    told = list(one.warnings)
    left = one.residuals[np.isfinite(one.residuals)]
    step = float(np.median(np.abs(np.diff(left)))) if left.size > _FEW else np.inf
    if one.rms > max(_BEND * step, _SMALL):
        told.append(
            f"the {one.kind} formula does not follow the points: it is off by {one.rms:.2g} where neighbours differ by "
            f"{step:.2g}; strong absorption does that; narrow the range, or take the points themselves"
        )
    return told


def formula_as_dict(one: Fit) -> dict[str, Any]:
    """A formula and what it gives along its range."""
    low, high = one.model.range_nm
    nm = np.linspace(low, high, _SHOWN)
    n, u_n = one.index(np.clip(nm, low, high))
    return one.as_dict() | {"curve": {"wavelength_nm": nm.tolist(), "n": n.tolist(), "u_n": u_n.tolist()}}


def literature(found: IndexSpectrum, which: str) -> tuple[dict[str, Any] | None, list[str]]:
    """Band of the literature's indices and warnings where n lies elsewhere, or falls as none of them does."""
    if which == "none":
        return None, []
    package, n = which == "package", found.n
    known = band(found.wavelength_nm, package=package)
    scatter = n.u_random if np.isfinite(n.u_random[n.known]).all() and (n.u_random[n.known] > 0.0).all() else None
    told = [
        *check_index(found.wavelength_nm, n.value, n.u, package=package),
        *check_dispersion(found.wavelength_nm, n.value, scatter, package=package),
    ]
    sides = {name: _plain(values) for name, values in (("low", known.low), ("high", known.high))}
    return {"polymers": list(RESINS), "from": which, **sides}, told


def _plain(values: FloatArray) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]

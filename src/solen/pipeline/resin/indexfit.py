"""A formula through an index spectrum, and what the literature says of it, as `solen resin index` states both."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.dispersion import Cauchy, Sellmeier
from solen.material.index import Estimate, IndexSpectrum
from solen.material.index.fit import Fit, fit
from solen.material.index.light import Light, formula_in
from solen.material.index.literature import RESINS, band, check_dispersion, check_index

LITERATURE = ("table", "package", "none")
_FEW, _BEND = 10, 3.0  # points that tell no scatter; residuals above this many steps have a shape of their own
_SMALL = 1e-4  # of n, not worth a word
_BESIDE = 15  # points to either side whose scatter is taken together
STEP_NM = 5.0
"""Distance of the wavelengths at which a formula is told."""


def fitted(kind: str | None, found: IndexSpectrum, terms: int | None = None) -> Fit | str | None:
    """Formula through n, its uncertainty from what scatters and what is common apart.

    Where no kind is said it is Cauchy's, and of a measurement alone; if there is none, the reason comes back in words.
    Where one is, `DataError` has the reason. Of what is no measurement the formula carries no uncertainty.
    """
    if kind == "none" or (kind is None and not found.measurement):
        return None
    try:
        return _fitted(kind or "cauchy", found, terms)
    except DataError as bad:
        if kind is not None:
            raise
        return f"no formula goes with it: {bad}"


def _fitted(kind: str, found: IndexSpectrum, terms: int | None) -> Fit:
    n = found.n
    random, common = scatter_nearby(n), n.common
    known = bool(np.isfinite(n.u[n.known]).all())
    whole = fit(
        kind,
        found.wavelength_nm,
        n.value,
        random if known else None,
        shared=common if known and common.size else None,
        terms=terms,
    )
    return whole if found.measurement else replace(whole, model=_without_covariance(whole.model))


def scatter_nearby(n: Estimate) -> FloatArray | None:
    """Standard uncertainty of what scatters, mean square over points nearby, NaN where n is masked; None without any.

    A point's own, of two or three repeats, is a bad weight: those that agree by chance would decide the fit.
    """
    square = n.scatter[n.known] ** 2
    total, at = np.append(0.0, np.cumsum(square)), np.arange(square.size)
    low, high = np.maximum(at - _BESIDE, 0), np.minimum(at + _BESIDE + 1, square.size)
    near = np.sqrt((total[high] - total[low]) / np.maximum(high - low, 1))
    if not (near > 0.0).all():
        return None
    found = np.full(n.value.shape, np.nan)
    found[n.known] = near
    return found


def _without_covariance(model: Cauchy | Sellmeier) -> Cauchy | Sellmeier:
    fields = {key: value for key, value in model.model_dump().items() if key != "covariance"}
    return type(model)(**fields)


def unfit(one: Fit | str | None) -> list[str]:
    """What a formula cannot be used for; or why there is none."""
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


def described(one: Fit, found: IndexSpectrum, lights: Sequence[Light], led: Light | None) -> dict[str, Any]:
    """A formula as plain data: its coefficients, its curve, and n in the lights that were asked for."""
    low, high = one.model.range_nm
    nm = np.unique(np.append(np.arange(np.ceil(low / STEP_NM) * STEP_NM, high, STEP_NM), [low, high]))
    nm = nm[(nm >= low) & (nm <= high)]
    return {
        **one.as_dict(),
        "wavelength_nm": nm.tolist(),
        "n": [one.model.index(at) for at in nm.tolist()],
        "u_n": [one.model.u_index(at) for at in nm.tolist()],
        "measurement": found.measurement,
        "at": [dict(vars(formula_in(one.model, light))) for light in lights],
        "led": None if led is None else dict(vars(formula_in(one.model, led))),
    }


def literature(found: IndexSpectrum, polymers: Sequence[str], which: str) -> tuple[dict[str, Any] | None, list[str]]:
    """Band of the literature's indices, and warnings where n lies elsewhere, or falls as none of them does."""
    if which == "none":
        return None, []
    package, classes, n = which == "package", tuple(polymers or RESINS), found.n
    known = band(found.wavelength_nm, classes, package=package)
    told = [
        *check_index(found.wavelength_nm, n.value, n.u, classes, package=package),
        *check_dispersion(found.wavelength_nm, n.value, scatter_nearby(n), package=package),
    ]
    sides = {name: _plain(values) for name, values in (("low", known.low), ("high", known.high))}
    return {"polymers": list(classes), "from": which, **sides}, told


def _plain(values: FloatArray) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]

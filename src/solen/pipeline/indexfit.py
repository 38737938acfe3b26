"""A formula through an index spectrum, and what the literature says of it, as `solen index` states both."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from solen.material.dispersion import Cauchy, Sellmeier
from solen.material.index import IndexSpectrum
from solen.material.index.fit import Fit, fit
from solen.material.index.light import Light, formula_in
from solen.material.index.literature import RESINS, check_dispersion, check_index

STEP_NM = 5.0
"""Distance of the wavelengths at which a formula is told."""


def fitted(kind: str, found: IndexSpectrum) -> Fit:
    """Formula through n, its uncertainty from what scatters and what is common apart.

    `DataError` where no such formula can be laid through the points, with the reason. Of what is no measurement the
    formula carries no uncertainty.
    """
    n = found.n
    random, common = n.u_random, n.common
    known = bool(np.isfinite(n.u[n.known]).all())
    scattering = known and bool((random[n.known] > 0).all())
    whole = fit(
        kind,
        found.wavelength_nm,
        n.value,
        random if scattering else None,
        shared=common if known and common.size else None,
    )
    return whole if found.measurement else replace(whole, model=_without_covariance(whole.model))


def _without_covariance(model: Cauchy | Sellmeier) -> Cauchy | Sellmeier:
    fields = {key: value for key, value in model.model_dump().items() if key != "covariance"}
    return type(model)(**fields)


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


def literature_warnings(found: IndexSpectrum, polymers: Sequence[str]) -> list[str]:
    """Whether n lies, and falls, as that of such polymers does."""
    n = found.n
    random = n.u_random if bool((n.u_random[n.known] > 0).all()) else None
    return [
        *check_index(found.wavelength_nm, n.value, n.u, polymers or RESINS),
        *check_dispersion(found.wavelength_nm, n.value, random),
    ]

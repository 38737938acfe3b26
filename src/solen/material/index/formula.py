"""The formula through an index spectrum, with separate independent and shared errors.

`formula_through` fits the formula; `smoothed_scatter` serves other uses of a spectrum's scatter.
"""

from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.fit import Fit, fit
from solen.material.index.spectrum import Estimate, IndexSpectrum
from solen.ranks import Caution, warning

_FEW, _BEND = 10, 3.0  # smallest number of points with scatter; ratio of residuals to steps that shows a misfit
_SMALL = 1e-4  # root mean square of negligible residuals
_BESIDE = 15  # points to either side whose scatter is pooled


def formula_through(
    spectrum: IndexSpectrum, kind: str | None = None, terms: int | None = None
) -> tuple[Fit | None, list[Caution]]:
    """Fit a formula to n; return it with warnings, or None with the reason why there is none.

    Parameters
    ----------
    spectrum
        Index at ascending wavelengths. For values that are not measurements, the formula has no uncertainty.
    kind
        ``cauchy``, ``sellmeier`` or ``none``; default: Cauchy's if n was measured, otherwise none.
    terms
        Number of terms; None for Akaike's criterion.

    Raises
    ------
    DataError
        If the requested kind cannot be fitted.
    """
    if kind == "none" or (kind is None and not spectrum.measurement):
        return None, []
    n = spectrum.n
    known = bool(np.isfinite(n.u[n.known]).all())
    u = smoothed_scatter(n) if known else None
    shared = n.common if known and n.common.size else None
    try:
        formula = fit(kind or "cauchy", spectrum.wavelength_nm, n.value, u, shared=shared, terms=terms)
    except DataError as bad:
        if kind is not None:
            raise
        return None, [warning(f"no formula is fitted: {bad}")]
    if not spectrum.measurement:
        formula = replace(formula, model=formula.model.model_copy(update={"covariance": None}))
    return formula, [*formula.warnings, *_misfit(formula)]


def smoothed_scatter(n: Estimate) -> FloatArray | None:
    """Return the standard uncertainty from scatter, pooled over nearby points; NaN where n is masked; None if unknown.

    The scatter at a single point, from two or three repeats, is a bad weight: points that agree by chance would
    dominate a fit.
    """
    square = n.scatter[n.known] ** 2
    total, at = np.append(0.0, np.cumsum(square)), np.arange(square.size)
    low, high = np.maximum(at - _BESIDE, 0), np.minimum(at + _BESIDE + 1, square.size)
    near = np.sqrt((total[high] - total[low]) / np.maximum(high - low, 1))
    if not (near > 0.0).all():
        return None
    scatter = np.full(n.value.shape, np.nan)
    scatter[n.known] = near
    return scatter


def _misfit(formula: Fit) -> list[Caution]:
    left = formula.residuals[np.isfinite(formula.residuals)]
    step = float(np.median(np.abs(np.diff(left)))) if left.size > _FEW else np.inf
    if formula.rms <= max(_BEND * step, _SMALL):
        return []
    return [
        warning(
            f"the {formula.kind} formula does not follow the points: it deviates by {formula.rms:.2g}, "
            f"whereas neighbouring points differ by {step:.2g}; strong absorption can cause that; "
            "narrow the range, or use the points themselves"
        )
    ]

"""The formula fitted to an index spectrum, with independent and shared errors.

`formula_through` fits the formula; `smoothed_scatter` returns the independent errors.
"""

from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.fit import Fit, fit
from solen.material.index.spectrum import Estimate, IndexSpectrum
from solen.ranks import Caution, warning

_MIN_POINTS = 10  # smallest number of points at which a misfit is detected
_MAX_RATIO = 3.0  # ratio of the residuals to their steps above which the formula does not follow the points
_MIN_RMS = 1e-4  # residuals below this RMS value are negligible
_NEIGHBOURS = 15  # points to either side whose scatter is pooled


def formula_through(
    spectrum: IndexSpectrum, kind: str | None = None, terms: int | None = None
) -> tuple[Fit | None, list[Caution]]:
    """Return the formula fitted to n with warnings, or None with the reason why there is none.

    Parameters
    ----------
    spectrum
        Index at wavelengths in ascending order. The formula has no uncertainty if the values are not measurements.
    kind
        ``cauchy``, ``sellmeier`` or ``none``; default: Cauchy's if n was measured, otherwise none.
    terms
        Number of terms; by default, it is chosen by Akaike's criterion.

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
    return formula, [*formula.warnings, *_misfit_warnings(formula)]


def smoothed_scatter(n: Estimate) -> FloatArray | None:
    """Return the standard uncertainty from scatter, pooled over nearby points; NaN where n is masked; None if unknown.

    The scatter at a single point, from two or three measurements, is unsuitable as a weight: points that agree by
    chance would dominate a fit.
    """
    square = n.scatter[n.known] ** 2
    total, position = np.append(0.0, np.cumsum(square)), np.arange(square.size)
    low, high = np.maximum(position - _NEIGHBOURS, 0), np.minimum(position + _NEIGHBOURS + 1, square.size)
    pooled = np.sqrt((total[high] - total[low]) / np.maximum(high - low, 1))
    if not (pooled > 0.0).all():
        return None
    scatter = np.full(n.value.shape, np.nan)
    scatter[n.known] = pooled
    return scatter


def _misfit_warnings(formula: Fit) -> list[Caution]:
    residuals = formula.residuals[np.isfinite(formula.residuals)]
    step = float(np.median(np.abs(np.diff(residuals)))) if residuals.size > _MIN_POINTS else np.inf
    if formula.rms <= max(_MAX_RATIO * step, _MIN_RMS):
        return []
    return [
        warning(
            f"the {formula.kind} formula does not follow the points: it deviates by {formula.rms:.2g} RMS, "
            f"whereas neighbouring points differ by {step:.2g}, perhaps due to strong absorption; "
            "restrict the range, or use the points themselves"
        )
    ]

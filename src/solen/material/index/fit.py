"""Cauchy and Sellmeier formulas fitted to an index spectrum, with a reliable covariance.

A formula with two to four parameters is fitted to hundreds of points by least squares, weighted by the independent
errors of the points. Shared errors (of the calibration, the substrate's index, the thickness) do not average out: they
are propagated to the covariance with the same weights, so the estimate does not depend on their assumed shape, and the
uncertainty does not decrease with the number of points. The covariance is widened if the points scatter by more than
the specified uncertainties, or if neighbouring points are correlated (by a slit wider than the step, or by fringes).

Internally, each formula has nearly uncorrelated parameters; A, B, C and their covariance are computed from these at the
end, and checked to reproduce the same index.

Unless it is specified, the number of terms follows from Akaike's criterion for small samples, AICc (K. P. Burnham and
D. R. Anderson, Model Selection and Multimodel Inference, 2002), in its form for overdispersed data if the points
scatter by more than their uncertainties.

`fit` accepts one of the names in `FITS` and returns a `Fit`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import field
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.dispersion import Cauchy, Sellmeier
from solen.material.index.formulas import CauchyForm, Form, OnePole, TwoPoles, UnfitError, covariance_rows, resonance_nm
from solen.material.index.least_squares import LeastSquaresFit, Points, points_of, solved
from solen.ranks import Caution, do_not_use, warning
from solen.results import HIDDEN, Result, reported
from solen.units import NM_PER_UM

_CURVE_STEP_NM = 5.0
_TOLERANCE = 1e-3  # largest difference of n from A, B, C and n from the inner parameters, relative to u(n)


class Fit(Result):
    """A formula fitted to an index spectrum.

    Attributes
    ----------
    kind, terms
        ``cauchy`` or ``sellmeier``, and the number of terms.
    model
        The formula with its covariance, valid over the wavelengths of the points.
    points
        Number of fitted points.
    residuals
        Points minus formula, in the shape of the input points; NaN if masked.
    rms
        RMS value of the residuals.
    chi2_reduced
        Reduced χ² with the specified independent uncertainties; None without them.
    neighbours
        Correlation of neighbouring residuals.
    widened
        Factor on the independent uncertainties that accounts for scatter and correlation; 1 if they suffice.
    aicc
        AICc, keyed by the number of terms; the fit with the smallest is chosen.
    refused
        Reasons why fits were rejected, keyed by the number of terms.
    warnings
        Warnings about the fit.
    """

    kind: str
    terms: int
    model: Cauchy | Sellmeier
    points: int
    residuals: FloatArray = field(metadata=HIDDEN)
    rms: float
    chi2_reduced: float | None
    neighbours: float
    widened: float
    aicc: Mapping[int, float]
    refused: Mapping[int, str]
    warnings: tuple[Caution, ...]

    @reported
    def wavelength_nm(self) -> FloatArray:
        """Wavelengths of the curve: the ends of the range and every 5 nm between them."""
        low, high = self.model.range_nm
        step = _CURVE_STEP_NM
        nm = np.unique(np.append(np.arange(np.ceil(low / step) * step, high, step), [low, high]))
        return np.asarray(nm[(nm >= low) & (nm <= high)])

    @reported
    def n(self) -> FloatArray:
        """Index at the wavelengths of the curve."""
        return self.model.indices(self.wavelength_nm)[0]

    @reported
    def u_n(self) -> FloatArray:
        """Standard uncertainty of the index at the wavelengths of the curve; NaN where it is unknown."""
        return self.model.indices(self.wavelength_nm)[1]


FITS: Mapping[str, Mapping[int, Callable[[FloatArray], Form]]] = {
    "cauchy": {terms: partial(CauchyForm, terms=terms) for terms in (1, 2, 3)},
    "sellmeier": {1: OnePole, 2: TwoPoles},
}
"""Functional forms, keyed by the name of the formula and the number of terms."""

_DEFAULT_TERMS = {"cauchy": (2, 3), "sellmeier": (1, 2)}
_PARAMETERS_PER_TERM = {"cauchy": 1, "sellmeier": 2}


def fit(
    kind: str,
    wavelength_nm: ArrayLike,
    n: ArrayLike,
    u_n: ArrayLike | None = None,
    *,
    shared: ArrayLike | None = None,
    terms: int | None = None,
) -> Fit:
    """Fit Cauchy's formula n = A + B/λ² + C/λ⁴ or Sellmeier's n² = 1 + Σ B λ²/(λ² − C) to a spectrum.

    Parameters
    ----------
    kind
        ``cauchy`` or ``sellmeier``.
    wavelength_nm, n
        Wavelengths and indices, shape (points,), in any order; a NaN in n is skipped.
    u_n
        Standard uncertainties, above 0, that are independent from point to point: a single number, or one per point; a
        NaN masks its point. By default, the uncertainty is estimated from the scatter.
    shared
        Errors common to all points, shape (rows, points) or (points,): the change of n for one standard uncertainty of
        each error. A single number is an offset.
    terms
        Number of terms: 1, 2 (A and B) or 3 for Cauchy's formula, 1 or 2 for Sellmeier's. By default, it is chosen by
        AICc, but never a single term of Cauchy's formula.

    Raises
    ------
    DataError
        If there are too few points, a number is invalid, or no formula can be fitted, with the reason, such as a
        resonance inside the range, or two terms that the points do not distinguish.
    """
    if kind not in FITS:
        raise DataError("fit", value=kind, limit=f"must be one of {', '.join(FITS)}")
    if terms is not None and terms not in FITS[kind]:
        raise DataError(f"terms of {kind}", value=terms, limit=f"must be one of {', '.join(map(str, FITS[kind]))}")
    points = points_of(wavelength_nm, n, u_n, shared)
    fits: dict[int, LeastSquaresFit] = {}
    refused: dict[int, str] = {}
    for count in (terms,) if terms is not None else _DEFAULT_TERMS[kind]:
        required = count * _PARAMETERS_PER_TERM[kind] + 1
        if (distinct := np.unique(points.um).size) < required:
            refused[count] = f"has {distinct} different wavelengths but requires at least {required}"
            continue
        try:
            fits[count] = solved(FITS[kind][count](points.um), points)
        except UnfitError as bad:
            refused[count] = str(bad)
    if not fits:
        count, reason = next(iter(refused.items()))
        remedy = "use fewer terms or the other formula" if terms is None or terms > 1 else "use the other formula"
        raise DataError(f"{kind} fit with {count} term{'s' if count > 1 else ''}", limit=reason, remedy=remedy)
    aicc = _aicc(fits, points)
    return _result(kind, min(aicc, key=lambda count: aicc[count]), fits, points, aicc, refused)


def _aicc(fits: Mapping[int, LeastSquaresFit], points: Points) -> dict[int, float]:
    """Return the AICc for each number of terms, from the scatter about the formula with the most terms."""
    largest = fits[max(fits)]
    overdispersion = 1.0 if points.u is None else max(1.0, largest.chi2 / largest.df)
    rho = max(largest.neighbours, 0.0)
    independent = max(points.n.size * (1 - rho) / (1 + rho), largest.inner.size + 3)  # equivalent number of points
    aicc = {}
    for count, fit in fits.items():
        parameters = fit.inner.size + (points.u is None)
        if points.u is None:
            misfit = independent * math.log(max(fit.chi2 / points.n.size, 1e-32))
        else:
            misfit = fit.chi2 / overdispersion * independent / points.n.size
        df = independent - parameters - 1
        aicc[count] = misfit + 2 * parameters + (2 * parameters * (parameters + 1) / df if df > 0 else math.inf)
    return aicc


def _result(
    kind: str,
    terms: int,
    fits: Mapping[int, LeastSquaresFit],
    points: Points,
    aicc: Mapping[int, float],
    refused: Mapping[int, str],
) -> Fit:
    """Return the result with the coefficients of the formula, after a check that they give the same index."""
    range_nm = (float(points.um[0]) * NM_PER_UM, float(points.um[-1]) * NM_PER_UM)
    models = {count: fit.form.model(fit.inner, fit.covariance, range_nm) for count, fit in fits.items()}
    best, model = fits[terms], models[terms]
    _check_coefficients(kind, best, model, points)
    if isinstance(model, Cauchy):
        cauchy = {count: other for count, other in models.items() if isinstance(other, Cauchy)}
        model = _with_model_uncertainty(model, cauchy, aicc)
    residuals = np.full(points.count, np.nan)
    residuals[points.order] = best.residuals
    known = points.u is not None
    return Fit(
        kind,
        terms,
        model,
        points.n.size,
        residuals,
        float(np.sqrt(np.mean(best.residuals**2))),
        best.chi2 / best.df if known else None,
        best.neighbours,
        best.widened if known else 1.0,
        dict(aicc),
        dict(refused),
        tuple(_warnings(model, best, points)),
    )


def _with_model_uncertainty(chosen: Cauchy, models: Mapping[int, Cauchy], aicc: Mapping[int, float]) -> Cauchy:
    """Return the chosen formula with a covariance averaged over all numbers of terms, with their Akaike weights.

    A third term that is omitted because the points do not require it may still exist; without this step, the 95 %
    interval would contain the true value in only 90 % of all cases (Burnham and Anderson, section 4.3).
    """
    lowest = min(aicc.values())
    weights = {count: math.exp((lowest - aicc[count]) / 2) for count in models}
    coefficients = np.array([chosen.A, chosen.B_um2, chosen.C_um4])
    total = np.zeros((3, 3))
    for count, model in models.items():
        difference = np.array([model.A, model.B_um2, model.C_um4]) - coefficients
        total += weights[count] * (np.array(model.covariance) + np.outer(difference, difference))
    covariance = total / sum(weights.values())
    return chosen.model_copy(update={"covariance": covariance_rows(covariance)})


def _check_coefficients(kind: str, fit: LeastSquaresFit, model: Cauchy | Sellmeier, points: Points) -> None:
    """Reject coefficients that lose the accuracy of the fit, for example because the wavelength range is too narrow."""
    value, slope = fit.form.value(fit.inner)
    for i in np.linspace(0, points.n.size - 1, 5).astype(int):
        nm = min(max(float(points.um[i]) * NM_PER_UM, model.range_nm[0]), model.range_nm[1])
        u = math.sqrt(float(slope[i] @ fit.covariance @ slope[i]))
        errors = abs(model.index(nm) - float(value[i])), abs((model.u_index(nm) or 0.0) - u)
        if max(errors) > _TOLERANCE * u + 1e-9:
            low, high = model.range_nm
            limit = f"the range of {low:g} to {high:g} nm is too narrow to determine its coefficients"
            raise DataError(f"{kind} fit", limit=limit, remedy="use fewer terms, or a wider range")


def _warnings(model: Cauchy | Sellmeier, fit: LeastSquaresFit, points: Points) -> list[Caution]:
    """Return warnings about a fit."""
    low, high = model.range_nm
    warnings = []
    rise = model.index(high) - model.index(low)
    u_rise = math.hypot(model.u_index(low) or 0.0, model.u_index(high) or 0.0)
    if rise > 2 * u_rise:
        warnings.append(
            do_not_use(
                f"the fitted index rises by {rise:.2g} from {low:g} to {high:g} nm, whereas the "
                "index of a transparent material falls"
            )
        )
    if points.u is not None and fit.widened > 1:
        warnings.append(
            warning(
                "the points scatter about the formula by more than their uncertainties, or neighbouring points are "
                f"correlated (correlation {fit.neighbours:.2f}); the uncertainties were multiplied by {fit.widened:.2g}"
            )
        )
    if points.u is None and not points.shared.size:
        warnings.append(
            warning(
                "the uncertainty of the fit follows from the scatter alone: errors common to all points are not "
                "included"
            )
        )
    if isinstance(model, Sellmeier):
        warnings += [
            warning(
                f"the resonance at {nm:.0f} nm is close to the shortest wavelength, {low:g} nm: use the formula only "
                "within the range of the points"
            )
            for nm in resonance_nm(model)
            if 0.85 * low < nm < low
        ]
    return warnings

"""Cauchy and Sellmeier formulas fitted to an index spectrum, with a reliable covariance.

A formula with two to four parameters is fitted to hundreds of points by least squares, weighted with the independent
errors of the points. Shared errors (calibration, the substrate's index, thickness) do not average out: they enter the
covariance through the same weights, so the estimate does not depend on their assumed shape and the uncertainty does not
shrink with the number of points. Scatter beyond the specified uncertainties, and correlation between neighbours (from a
slit wider than the step, or fringes), also widen the covariance.

Internally, each formula has nearly uncorrelated parameters; A, B, C and their covariance are computed from these at the
end and checked to reproduce the same numbers.

Unless the caller specifies it, the number of terms follows from Akaike's criterion for small samples, AICc (K. P.
Burnham and D. R. Anderson, Model Selection and Multimodel Inference, 2002), in its form for overdispersed data if the
points scatter beyond their uncertainties.

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
from solen.material.index.least_squares import Points, Solved, points_of, solved
from solen.ranks import Caution, do_not_use, warning
from solen.results import HIDDEN, Result, reported
from solen.units import NM_PER_UM

_CURVE_NM = 5.0
_SAME = 1e-3  # tolerated deviation of A, B, C from the inner parameters, relative to u(n)


class Fit(Result):
    """A formula through an index spectrum.

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
        Root mean square of the residuals.
    chi2_reduced
        Sum of squares in units of the specified independent uncertainties, per degree of freedom; None without them.
    neighbours
        Correlation of a residual with the next one.
    widened
        Factor on the independent uncertainties that accounts for scatter and correlation; 1 if they suffice.
    aicc
        AICc for each number of terms tried; the smallest wins.
    refused
        Reasons for rejected fits, by number of terms.
    warnings
        Warnings about the numbers.
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
        nm = np.unique(np.append(np.arange(np.ceil(low / _CURVE_NM) * _CURVE_NM, high, _CURVE_NM), [low, high]))
        return np.asarray(nm[(nm >= low) & (nm <= high)])

    @reported
    def n(self) -> FloatArray:
        """Index along the curve."""
        return self.model.along(self.wavelength_nm)[0]

    @reported
    def u_n(self) -> FloatArray:
        """Standard uncertainty of the index along the curve; NaN where it is unknown."""
        return self.model.along(self.wavelength_nm)[1]


FITS: Mapping[str, Mapping[int, Callable[[FloatArray], Form]]] = {
    "cauchy": {terms: partial(CauchyForm, terms=terms) for terms in (1, 2, 3)},
    "sellmeier": {1: OnePole, 2: TwoPoles},
}
"""Functional forms, by formula name and number of terms."""

_TRIED = {"cauchy": (2, 3), "sellmeier": (1, 2)}
_PER_TERM = {"cauchy": 1, "sellmeier": 2}


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
        NaN masks its point. None: estimated from the scatter.
    shared
        Errors common to all points, shape (rows, points) or (points,): change of n by one standard uncertainty of each
        error. A single number is an offset.
    terms
        Number of terms: 1, 2 (A and B) or 3 for Cauchy's formula, 1 or 2 for Sellmeier's; None selects it by AICc, but
        never a single Cauchy term.

    Raises
    ------
    DataError
        If there are too few points, a number is not finite, or no formula can be fitted, with the reason: a resonance
        inside the range, or two terms that cannot be distinguished.
    """
    if kind not in FITS:
        raise DataError("fit", value=kind, limit=f"must be one of {', '.join(FITS)}")
    if terms is not None and terms not in FITS[kind]:
        raise DataError(f"terms of {kind}", value=terms, limit=f"must be one of {', '.join(map(str, FITS[kind]))}")
    points = points_of(wavelength_nm, n, u_n, shared)
    roots: dict[int, Solved] = {}
    refused: dict[int, str] = {}
    for count in (terms,) if terms is not None else _TRIED[kind]:
        needed = count * _PER_TERM[kind] + 1
        if (distinct := np.unique(points.um).size) < needed:
            refused[count] = f"has {distinct} different wavelengths but requires at least {needed}"
            continue
        try:
            roots[count] = solved(FITS[kind][count](points.um), points)
        except UnfitError as bad:
            refused[count] = str(bad)
    if not roots:
        count, why = next(iter(refused.items()))
        remedy = "use fewer terms or the other formula" if terms is None or terms > 1 else "use the other formula"
        raise DataError(f"{kind} fit of {count} term{'s' if count > 1 else ''}", limit=why, remedy=remedy)
    scores = _scores(roots, points)
    best = min(scores, key=lambda count: scores[count])
    return _delivered(kind, best, roots, points, scores, refused)


def _scores(roots: Mapping[int, Solved], points: Points) -> dict[int, float]:
    """Return the AICc for each number of terms, using the scatter about the formula with the most terms."""
    richest = roots[max(roots)]
    spread = 1.0 if points.u is None else max(1.0, richest.chi2 / richest.freedom)
    rho = max(richest.neighbours, 0.0)
    apart = max(
        points.n.size * (1 - rho) / (1 + rho), richest.inner.size + 3
    )  # equivalent number of independent points
    scores = {}
    for count, root in roots.items():
        parameters = root.inner.size + (points.u is None)
        if points.u is None:
            misfit = apart * math.log(max(root.chi2 / points.n.size, 1e-32))
        else:
            misfit = root.chi2 / spread * apart / points.n.size
        left = apart - parameters - 1
        scores[count] = misfit + 2 * parameters + (2 * parameters * (parameters + 1) / left if left > 0 else math.inf)
    return scores


def _delivered(
    kind: str,
    terms: int,
    roots: Mapping[int, Solved],
    points: Points,
    scores: Mapping[int, float],
    refused: Mapping[int, str],
) -> Fit:
    """Return the result with the formula's own coefficients, after checking that they give the same numbers."""
    span_nm = (float(points.um[0]) * NM_PER_UM, float(points.um[-1]) * NM_PER_UM)
    models = {count: root.form.model(root.inner, root.covariance, span_nm) for count, root in roots.items()}
    best, model = roots[terms], models[terms]
    _check_delivered(kind, best, model, points)
    if isinstance(model, Cauchy):
        model = _with_model_uncertainty(
            model, {count: model for count, model in models.items() if isinstance(model, Cauchy)}, scores
        )
    residuals = np.full(points.given, np.nan)
    residuals[points.order] = best.residuals
    known = points.u is not None
    return Fit(
        kind,
        terms,
        model,
        points.n.size,
        residuals,
        float(np.sqrt(np.mean(best.residuals**2))),
        best.chi2 / best.freedom if known else None,
        best.neighbours,
        best.widened if known else 1.0,
        dict(scores),
        dict(refused),
        tuple(_warnings(model, best, points)),
    )


def _with_model_uncertainty(chosen: Cauchy, models: Mapping[int, Cauchy], scores: Mapping[int, float]) -> Cauchy:
    """Return the chosen formula with a covariance that includes the fits with other numbers of terms, by their weights.

    A third term that is omitted because the points do not require it may still exist; without this step, the reported
    95 % interval would contain the true value in only 90 % of cases. Burnham and Anderson, section 4.3.
    """
    least = min(scores.values())
    weights = {count: math.exp((least - scores[count]) / 2) for count in models}
    here = np.array([chosen.A, chosen.B_um2, chosen.C_um4])
    total = np.zeros((3, 3))
    for count, model in models.items():
        off = np.array([model.A, model.B_um2, model.C_um4]) - here
        total += weights[count] * (np.array(model.covariance) + np.outer(off, off))
    covariance = total / sum(weights.values())
    return chosen.model_copy(update={"covariance": covariance_rows(covariance)})


def _check_delivered(kind: str, one: Solved, model: Cauchy | Sellmeier, points: Points) -> None:
    """Reject coefficients that lost the accuracy of the fit, for example because the wavelength range is too short."""
    value, slope = one.form.value(one.inner)
    for i in np.linspace(0, points.n.size - 1, 5).astype(int):
        nm = min(max(float(points.um[i]) * NM_PER_UM, model.range_nm[0]), model.range_nm[1])
        u = math.sqrt(float(slope[i] @ one.covariance @ slope[i]))
        off = abs(model.index(nm) - float(value[i])), abs((model.u_index(nm) or 0.0) - u)
        if max(off) > _SAME * u + 1e-9:
            low, high = model.range_nm
            limit = f"{low:g} to {high:g} nm is too short a range for its coefficients"
            raise DataError(f"{kind} fit", limit=limit, remedy="use fewer terms, or a wider range")


def _warnings(model: Cauchy | Sellmeier, one: Solved, points: Points) -> list[Caution]:
    """Return warnings about the numbers of a fit."""
    low, high = model.range_nm
    warnings = []
    rise = model.index(high) - model.index(low)
    spread = math.hypot(model.u_index(low) or 0.0, model.u_index(high) or 0.0)
    if rise > 2 * spread:
        warnings.append(
            do_not_use(
                f"the fitted index rises by {rise:.2g} from {low:g} to {high:g} nm, whereas the "
                "index of a transparent material falls"
            )
        )
    if points.u is not None and one.widened > 1:
        warnings.append(
            warning(
                "the points scatter about the formula by more than their reported uncertainties, "
                f"or neighbouring points are correlated (correlation {one.neighbours:.2f}); the "
                f"uncertainties were multiplied by {one.widened:.2g}"
            )
        )
    if points.u is None and not points.shared.size:
        warnings.append(
            warning(
                "the uncertainty of the fit follows from scatter alone: errors common to all points are not included"
            )
        )
    if isinstance(model, Sellmeier):
        warnings += [
            warning(
                f"the resonance at {nm:.0f} nm is close to the points, which begin at {low:g} nm: use the fit only "
                "within their range"
            )
            for nm in resonance_nm(model)
            if 0.85 * low < nm < low
        ]
    return warnings

"""Hyperelastic fits: a single set of parameters for all tests of a material.

A model that fits tests in one mode may be wrong in another, so all modes are fitted jointly. The minimised quantity is
Σ w²(P_model − P)² with the engineering stress P, and w = 1 (``absolute``: equal weight of equal errors in MPa) or w =
1/max(|P|, 2 % of the largest stress of the test) (``relative``: equal weight of equal relative errors). Models that are
linear in their parameters are solved directly. Ogden's is not, and has many local minima (Ogden, Saccomandi & Sgura
2004): it is linear in its moduli for given powers α, so these are determined on a grid of powers, the best starts are
refined with exact derivatives, and the best result is chosen. The search is deterministic.

Models are compared by AICc (Hurvich & Tsai 1989), but only if they are stable over the measured stretches; of two
models that fit equally well, the simpler one is chosen. The likelihood is that of autoregressive residuals
(`solen.material.stiffness.correlation`): with independent residuals, a densely sampled curve would always favour the
model with the most parameters.

`fit` fits a model to `Curve`s, and `choose` selects one of several fits to the same curves.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.stiffness.correlation import Scatter, log_likelihood, scatter
from solen.material.stiffness.models import Model, Ogden, model
from solen.material.stiffness.modes import MODES, Mode
from solen.material.stiffness.stability import StableRange, stable_range
from solen.results import HIDDEN, reported

Weighting = Literal["absolute", "relative"]
MAX_RESIDUAL_INCREASE = 0.02
"""Relative increase of the RMS residual up to which a model with fewer parameters is preferred."""
_ZERO_STRESS_MPA = 1e-12  # smaller than any measured stress
_MIN_STRESS_FRACTION = 0.02  # fraction of the largest stress of a test below which a relative error is meaningless
_POWERS = (-8.0, -5.0, -3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 13.0)
_MAX_POWER = 30.0  # bound of |α|
_MAX_STARTS = 12  # number of starts that are refined
_MAX_CONVERGED = 3  # number of starts that are refined to convergence
_MAX_EVALUATIONS = 400  # maximum number of function evaluations for each start


@dataclass(frozen=True, eq=False)
class Curve:
    """One test: engineering stress against stretch in one mode.

    Attributes
    ----------
    mode
        Mode of deformation.
    stretch, stress_MPa
        Stretch and engineering stress, shape (n,); in compression, stretch is below 1 and stress negative.
    """

    mode: Mode = field(metadata=HIDDEN)
    stretch: FloatArray
    stress_MPa: FloatArray


@dataclass(frozen=True)
class ModeQuality:
    """Quality of a fit to the tests of one mode: number of points, range, absolute and relative RMS error, R²."""

    mode: str
    points: int
    stretch_range: tuple[float, float]
    rms_MPa: float
    rms_relative: float
    r_squared: float | None


@dataclass(frozen=True, eq=False)
class Fit:
    """One model fitted to all tests.

    Attributes
    ----------
    model, values, scatter
        The model, its parameters in the order of ``model.names``, and their covariance with its basis.
    weighting, weighted_squares
        Weighting of the residuals, and the sum of their squares.
    quality
        Quality of the fit for each measured mode.
    stable
        Range of stable stretches, keyed by mode, for all modes, measured or not.
    stable_in_data
        Whether the model is stable over the measured stretches of every measured mode.
    aicc
        Corrected Akaike criterion; None with too few points, or if all residuals are 0.
    delta_aicc
        Difference from the lowest AICc of the compared fits.
    """

    model: Model = field(metadata=HIDDEN)
    values: FloatArray = field(metadata=HIDDEN)
    scatter: Scatter
    weighting: Weighting
    weighted_squares: float
    quality: tuple[ModeQuality, ...]
    stable: dict[str, StableRange]
    stable_in_data: bool
    aicc: float | None
    delta_aicc: float | None = None

    @reported
    def kind(self) -> str:
        """Name of the model."""
        return self.model.kind

    @reported
    def parameters(self) -> dict[str, float]:
        """Parameters of the model, keyed by name."""
        return dict(zip(self.model.names, self.values.tolist(), strict=True))

    @reported
    def u_parameters(self) -> dict[str, float] | None:
        """Standard uncertainties of the parameters, keyed by name; None if the data do not determine them."""
        if self.scatter.covariance is None:
            return None
        return dict(zip(self.model.names, np.sqrt(np.diag(self.scatter.covariance)).tolist(), strict=True))

    @reported
    def initial_modulus_MPa(self) -> float:
        """Young's modulus at zero strain, E₀ = 3 μ₀."""
        return 3 * self.model.shear_modulus_row(self.values)[0]

    @reported
    def u_initial_modulus_MPa(self) -> float | None:
        """Standard uncertainty of the initial modulus, from the covariance of the parameters."""
        if self.scatter.covariance is None:
            return None
        row = 3 * self.model.shear_modulus_row(self.values)[1]
        return math.sqrt(max(float(row @ self.scatter.covariance @ row), 0.0))


def fit(kind: str, curves: Sequence[Curve], weighting: Weighting = "absolute") -> Fit:
    """Fit one model to all curves.

    Parameters
    ----------
    kind
        One of `solen.material.stiffness.models.KINDS`.
    curves
        Tests, each with its mode.
    weighting
        ``absolute`` or ``relative``.

    Raises
    ------
    DataError
        If the curves have fewer points than the model has parameters plus one, or a stretch is not above 0.
    SpecError
        If there is no such model.
    """
    fitted = model(kind)
    _check(curves, fitted)
    weights = [_weights(curve, weighting) for curve in curves]
    parameters = (
        _fit_ogden(fitted, curves, weights) if isinstance(fitted, Ogden) else _fit_linear(fitted, curves, weights)
    )
    residuals = [
        w * (fitted.stress(parameters, c.mode, c.stretch) - c.stress_MPa) for c, w in zip(curves, weights, strict=True)
    ]
    jacobians = [
        w[:, None] * fitted.jacobian(parameters, c.mode, c.stretch) for c, w in zip(curves, weights, strict=True)
    ]
    quality = _quality(fitted, parameters, curves)
    data_range = (min(q.stretch_range[0] for q in quality), max(q.stretch_range[1] for q in quality))
    stable = {name: stable_range(fitted, parameters, mode, data_range) for name, mode in MODES.items()}
    statistics = scatter(jacobians, residuals)
    return Fit(
        model=fitted,
        values=parameters,
        scatter=statistics,
        weighting=weighting,
        weighted_squares=sum(float(r @ r) for r in residuals),
        quality=quality,
        stable=stable,
        stable_in_data=all(stable[q.mode].covers(*q.stretch_range) for q in quality),
        aicc=_aicc(residuals, statistics.lag_one, len(parameters)),
    )


def fit_each(kinds: Sequence[str], curves: Sequence[Curve], weighting: Weighting = "absolute") -> tuple[Fit, ...]:
    """Return fits of several models to the same curves, each with the difference of its AICc from the lowest."""
    fits = [fit(kind, curves, weighting) for kind in kinds]
    lowest = min((result.aicc for result in fits if result.aicc is not None), default=0.0)
    return tuple(replace(result, delta_aicc=None if result.aicc is None else result.aicc - lowest) for result in fits)


def choose(fits: Sequence[Fit]) -> Fit | None:
    """Return the stable fit with the lowest AICc, or a simpler one that fits equally well; None if no fit is stable.

    Differences between specimens leave smooth residuals that no model removes; the likelihood of correlated residuals
    then favours parameters that hardly change the fit. A model with fewer parameters is therefore preferred if its
    residuals are larger by at most `MAX_RESIDUAL_INCREASE`.
    """
    stable = [fit for fit in fits if fit.stable_in_data]
    best = min((fit for fit in stable if fit.aicc is not None), key=lambda fit: fit.aicc or 0.0, default=None)
    if best is not None:
        max_squares = (1 + MAX_RESIDUAL_INCREASE) ** 2 * best.weighted_squares
        stable = [fit for fit in stable if fit.aicc is not None and fit.weighted_squares <= max_squares]
    return min(stable, key=lambda fit: len(fit.values), default=None)


def _check(curves: Sequence[Curve], fitted: Model) -> None:
    points, required = sum(len(curve.stretch) for curve in curves), len(fitted.names) + 1
    if points < required:
        limit = f"must be at least {required}"
        raise DataError(f"number of points for {fitted.kind}", value=points, limit=limit, remedy="measure more points")
    for curve in curves:
        if not (np.isfinite(curve.stretch).all() and np.isfinite(curve.stress_MPa).all()):
            limit = "has points without a value"
            raise DataError(f"{curve.mode.name} curve", limit=limit, remedy="remove these points")
        if (lowest := float(curve.stretch.min())) <= 0:
            raise DataError("stretch", value=lowest, limit="must be above 0", remedy="check length and displacement")


def _weights(curve: Curve, weighting: Weighting) -> FloatArray:
    magnitude = np.abs(curve.stress_MPa)
    if weighting == "absolute":
        return np.ones_like(magnitude)
    largest = float(magnitude.max())
    if largest < _ZERO_STRESS_MPA:
        raise DataError("stress", value=0, limit="is zero throughout a test", remedy="check the force column")
    return 1 / np.maximum(magnitude, _MIN_STRESS_FRACTION * largest)


def _fit_linear(fitted: Model, curves: Sequence[Curve], weights: Sequence[FloatArray]) -> FloatArray:
    start = np.zeros(len(fitted.names))
    rows = [w[:, None] * fitted.jacobian(start, c.mode, c.stretch) for c, w in zip(curves, weights, strict=True)]
    stresses = [w * c.stress_MPa for c, w in zip(curves, weights, strict=True)]
    return _solved(np.vstack(rows), np.concatenate(stresses))


def _solved(rows: FloatArray, values: FloatArray) -> FloatArray:
    """Return the least-squares solution; columns are scaled, because powers of the invariants differ by many orders."""
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    return np.asarray(np.linalg.lstsq(rows / scale, values, rcond=None)[0] / scale)


def _fit_ogden(fitted: Ogden, curves: Sequence[Curve], weights: Sequence[FloatArray]) -> FloatArray:
    """Return the best fit from several starts; α = 30 sin θ keeps powers within ±30 in an unconstrained search."""
    from scipy.optimize import leastsq

    terms = _Terms.of(curves, weights)
    order = fitted.order

    def residuals(p: FloatArray) -> FloatArray:
        return terms.basis(_MAX_POWER * np.sin(p[order:])) @ p[:order] - terms.stress

    def jacobian(p: FloatArray) -> FloatArray:
        powers, slope = _MAX_POWER * np.sin(p[order:]), _MAX_POWER * np.cos(p[order:])
        return np.hstack([terms.basis(powers), terms.by_power(powers) * p[:order] * slope])

    def refined(start: FloatArray, tolerance: float) -> tuple[float, FloatArray]:
        solution = leastsq(
            residuals, start, Dfun=jacobian, xtol=1e-12, ftol=tolerance, maxfev=_MAX_EVALUATIONS, full_output=True
        )
        p = np.asarray(solution[0])
        return float(np.sum(residuals(p) ** 2)), p

    starts = [np.concatenate([moduli, np.arcsin(powers / _MAX_POWER)]) for moduli, powers in _starts(terms, order)]
    coarse = sorted((refined(start, 1e-5) for start in starts), key=lambda solution: solution[0])
    converged = [refined(p, 1e-14) for _, p in coarse[:_MAX_CONVERGED]]
    best = min(converged, key=lambda solution: solution[0])[1]
    return _ordered(fitted, np.concatenate([best[:order], _MAX_POWER * np.sin(best[order:])]))


@dataclass(frozen=True, eq=False)
class _Terms:
    """Ogden's terms at all points of all curves: weighted stress Σᵢ fᵢ exp(α lᵢ) for μ = 1, with lᵢ = ln λᵢ."""

    factor: FloatArray
    logarithm: FloatArray
    stress: FloatArray

    @classmethod
    def of(cls, curves: Sequence[Curve], weights: Sequence[FloatArray]) -> "_Terms":
        factors, logarithms = [], []
        for curve, weight in zip(curves, weights, strict=True):
            powers = np.array(curve.mode.powers)
            factors.append(powers * (weight / curve.stretch / curve.mode.directions)[:, None])
            logarithms.append(powers * np.log(curve.stretch)[:, None])
        stress = np.concatenate([w * c.stress_MPa for c, w in zip(curves, weights, strict=True)])
        return cls(np.vstack(factors), np.vstack(logarithms), stress)

    def basis(self, powers: FloatArray) -> FloatArray:
        """Return the stress of each term: (points, terms)."""
        return np.asarray(np.einsum("ni,nit->nt", self.factor, np.exp(self.logarithm[:, :, None] * powers)))

    def by_power(self, powers: FloatArray) -> FloatArray:
        """Return the derivative of the stress of each term with respect to its power."""
        stretch_powers = np.exp(self.logarithm[:, :, None] * powers)
        return np.asarray(np.einsum("ni,nit->nt", self.factor * self.logarithm, stretch_powers))


def _starts(terms: _Terms, order: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return the best grid combinations of powers with their moduli, as starting points of the fit."""
    powers = np.array(_POWERS)
    basis = terms.basis(powers)
    candidates = []
    for columns in combinations(range(len(powers)), order):
        rows = basis[:, columns]
        moduli = _solved(rows, terms.stress)
        candidates.append((float(np.sum((rows @ moduli - terms.stress) ** 2)), moduli, powers[list(columns)]))
    candidates.sort(key=lambda candidate: candidate[0])
    return [(moduli, alphas) for _, moduli, alphas in candidates[:_MAX_STARTS]]


def _ordered(fitted: Ogden, parameters: FloatArray) -> FloatArray:
    """Return the parameters with Ogden's terms in descending order of power, which makes the order unique."""
    moduli, powers = fitted.split(parameters)
    order = np.argsort(-powers)
    return np.concatenate([moduli[order], powers[order]])


def _quality(fitted: Model, parameters: FloatArray, curves: Sequence[Curve]) -> tuple[ModeQuality, ...]:
    qualities = []
    for name, mode in MODES.items():
        group = [curve for curve in curves if curve.mode.name == name]
        if not group:
            continue
        stretch = np.concatenate([curve.stretch for curve in group])
        stress = np.concatenate([curve.stress_MPa for curve in group])
        error = fitted.stress(parameters, mode, stretch) - stress
        magnitude = np.maximum(np.abs(stress), _MIN_STRESS_FRACTION * np.abs(stress).max())
        squares = float(np.sum((stress - stress.mean()) ** 2))
        qualities.append(
            ModeQuality(
                mode=name,
                points=len(stretch),
                stretch_range=(min(float(stretch.min()), 1.0), max(float(stretch.max()), 1.0)),
                rms_MPa=float(np.sqrt(np.mean(error**2))),
                rms_relative=float(np.sqrt(np.mean((error / magnitude) ** 2))),
                r_squared=None if squares == 0 else 1 - float(error @ error) / squares,
            )
        )
    return tuple(qualities)


def _aicc(residuals: Sequence[FloatArray], lag_one: float, parameters: int) -> float | None:
    """Return the AICc; the variance and the correlation of the residuals are parameters, too."""
    points, k = sum(len(r) for r in residuals), parameters + 2
    likelihood = log_likelihood(residuals, lag_one)
    if points - k - 1 <= 0 or likelihood == float("inf"):
        return None
    return -2 * likelihood + 2 * k + 2 * k * (k + 1) / (points - k - 1)

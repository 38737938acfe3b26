"""Hyperelastic fits: a single set of parameters for all tests of a material.

A model that fits one kind of test implies little about another, so all modes are fitted together. The minimised
quantity is Σ w²(P_model − P)² over the engineering stress, with w = 1 (``absolute``: equal weight for every newton) or
w = 1/max(|P|, 2 % of the test's largest) (``relative``: equal weight for every per cent). Models that are linear in
their parameters are solved directly. Ogden's is not, and has many local minima (Ogden, Saccomandi & Sgura 2004): for
given powers α its moduli are linear, so they are solved for on a grid of powers, the best starts are refined with exact
derivatives, and the best result is kept. Nothing is random.

Models are compared by AICc (Hurvich & Tsai 1989), but only if they are stable over the measured stretches; of two
models that fit equally well, the simpler one is chosen. The likelihood is that of autoregressive residuals
(`solen.material.stiffness.correlation`): with independent residuals, a curve sampled densely enough would always favour
the most parameters.

`fit` fits a model to `Curve`s, and `choose` selects among several fits of the same curves.
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
SEEN = 0.02  # relative difference of the residuals of two fits that is negligible
_FLOOR = 0.02  # fraction of the largest stress of a test below which a relative error is meaningless
_POWERS = (-8.0, -5.0, -3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 13.0)
_STEEPEST = 30.0  # bound of |α|
_REFINED = 12  # number of starts that are refined
_POLISHED = 3  # number of starts refined to convergence
_STEPS = 400  # number of evaluations for each start


@dataclass(frozen=True, eq=False)
class Curve:
    """One test: engineering stress over stretch in one mode.

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
    """Quality of a fit to the tests of one mode: root mean square error in MPa and relative, R², range, points."""

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
        Quality of fit by mode.
    stable
        Range of stable stretches by mode, for all modes, measured or not.
    stable_in_data
        Whether the model is stable over the measured stretches of every measured mode.
    aicc
        Corrected Akaike criterion; None with too few points or no residual.
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
        """Parameters of the model by name."""
        return dict(zip(self.model.names, self.values.tolist(), strict=True))

    @reported
    def u_parameters(self) -> dict[str, float] | None:
        """Standard uncertainties of the parameters; None if the data do not determine them."""
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
    reached = (min(q.stretch_range[0] for q in quality), max(q.stretch_range[1] for q in quality))
    stable = {name: stable_range(fitted, parameters, mode, reached) for name, mode in MODES.items()}
    spread = scatter(jacobians, residuals)
    return Fit(
        model=fitted,
        values=parameters,
        scatter=spread,
        weighting=weighting,
        weighted_squares=sum(float(r @ r) for r in residuals),
        quality=quality,
        stable=stable,
        stable_in_data=all(stable[q.mode].covers(*q.stretch_range) for q in quality),
        aicc=_aicc(residuals, spread.lag_one, len(parameters)),
    )


def fit_each(kinds: Sequence[str], curves: Sequence[Curve], weighting: Weighting = "absolute") -> tuple[Fit, ...]:
    """Return fits of several models to the same curves, each with its AICc and the difference from the lowest."""
    fits = [fit(kind, curves, weighting) for kind in kinds]
    lowest = min((each.aicc for each in fits if each.aicc is not None), default=0.0)
    return tuple(replace(each, delta_aicc=None if each.aicc is None else each.aicc - lowest) for each in fits)


def choose(fits: Sequence[Fit]) -> Fit | None:
    """Return the fit of lowest AICc among those stable over the data, or a simpler one that fits equally well.

    Specimens that differ leave smooth residuals that no model removes; a likelihood of correlated residuals then
    favours parameters that change the fit imperceptibly. A model with fewer parameters is therefore preferred if its
    residuals are larger by at most `SEEN`. None if no model is stable.
    """
    stable = [f for f in fits if f.stable_in_data]
    judged = [f for f in stable if f.aicc is not None]
    if judged:
        best = min(judged, key=lambda f: 0.0 if f.aicc is None else f.aicc)
        alike = [f for f in judged if f.weighted_squares <= (1 + SEEN) ** 2 * best.weighted_squares]
        return min(alike, key=lambda f: len(f.values))
    return min(stable, key=lambda f: len(f.values)) if stable else None


def _check(curves: Sequence[Curve], fitted: Model) -> None:
    points, needed = sum(len(curve.stretch) for curve in curves), len(fitted.names) + 1
    if points < needed:
        raise DataError(f"points for {fitted.kind}", value=points, limit=f"at least {needed}", remedy="measure more")
    for curve in curves:
        if not (np.isfinite(curve.stretch).all() and np.isfinite(curve.stress_MPa).all()):
            raise DataError(f"{curve.mode.name} curve", limit="has gaps", remedy="remove points without a value")
        if (lowest := float(curve.stretch.min())) <= 0:
            raise DataError("stretch", value=lowest, limit="must be above 0", remedy="check length and displacement")


def _weights(curve: Curve, weighting: Weighting) -> FloatArray:
    size = np.abs(curve.stress_MPa)
    if weighting == "absolute":
        return np.ones_like(size)
    largest = float(size.max())
    if largest == 0:
        raise DataError("stress", value=0, limit="is zero throughout a test", remedy="check the force column")
    return 1 / np.maximum(size, _FLOOR * largest)


def _fit_linear(fitted: Model, curves: Sequence[Curve], weights: Sequence[FloatArray]) -> FloatArray:
    start = np.zeros(len(fitted.names))
    rows = [w[:, None] * fitted.jacobian(start, c.mode, c.stretch) for c, w in zip(curves, weights, strict=True)]
    wanted = [w * c.stress_MPa for c, w in zip(curves, weights, strict=True)]
    return _solved(np.vstack(rows), np.concatenate(wanted))


def _solved(rows: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the least-squares solution with scaled columns, because powers of the invariants differ by orders."""
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    return np.asarray(np.linalg.lstsq(rows / size, wanted, rcond=None)[0] / size)


def _fit_ogden(fitted: Ogden, curves: Sequence[Curve], weights: Sequence[FloatArray]) -> FloatArray:
    """Return the best result of the best starts; α = 30 sin θ keeps powers within ±30 in an unconstrained search."""
    from scipy.optimize import leastsq

    terms = _Terms.of(curves, weights)
    order = fitted.order

    def residual(searched: FloatArray) -> FloatArray:
        return terms.basis(_STEEPEST * np.sin(searched[order:])) @ searched[:order] - terms.wanted

    def jacobian(searched: FloatArray) -> FloatArray:
        powers, slope = _STEEPEST * np.sin(searched[order:]), _STEEPEST * np.cos(searched[order:])
        return np.hstack([terms.basis(powers), terms.by_power(powers) * searched[:order] * slope])

    def ended(start: FloatArray, tolerance: float) -> tuple[float, FloatArray]:
        solution = leastsq(residual, start, Dfun=jacobian, xtol=1e-12, ftol=tolerance, maxfev=_STEPS, full_output=True)
        return float(np.sum(residual(np.asarray(solution[0])) ** 2)), np.asarray(solution[0])

    rough = [
        ended(np.concatenate([moduli, np.arcsin(powers / _STEEPEST)]), 1e-5) for moduli, powers in _starts(terms, order)
    ]
    rough.sort(key=lambda each: each[0])
    best = min((ended(end, 1e-14) for _, end in rough[:_POLISHED]), key=lambda each: each[0])[1]
    return _ordered(fitted, np.concatenate([best[:order], _STEEPEST * np.sin(best[order:])]))


@dataclass(frozen=True, eq=False)
class _Terms:
    """Ogden's terms at all points of all curves: weighted stress Σᵢ fᵢ exp(α lᵢ) at μ = 1, with lᵢ = ln λᵢ."""

    factor: FloatArray
    logarithm: FloatArray
    wanted: FloatArray

    @classmethod
    def of(cls, curves: Sequence[Curve], weights: Sequence[FloatArray]) -> "_Terms":
        factors, logarithms = [], []
        for curve, weight in zip(curves, weights, strict=True):
            powers = np.array(curve.mode.powers)
            factors.append(powers * (weight / curve.stretch / curve.mode.directions)[:, None])
            logarithms.append(powers * np.log(curve.stretch)[:, None])
        wanted = np.concatenate([w * c.stress_MPa for c, w in zip(curves, weights, strict=True)])
        return cls(np.vstack(factors), np.vstack(logarithms), wanted)

    def basis(self, powers: FloatArray) -> FloatArray:
        """Return the stress of each term: (points, terms)."""
        return np.asarray(np.einsum("ni,nit->nt", self.factor, np.exp(self.logarithm[:, :, None] * powers)))

    def by_power(self, powers: FloatArray) -> FloatArray:
        """Return the derivative of the stress with respect to the term's power."""
        grown = np.exp(self.logarithm[:, :, None] * powers)
        return np.asarray(np.einsum("ni,nit->nt", self.factor * self.logarithm, grown))


def _starts(terms: _Terms, order: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return the best of a grid of powers, each with its least-squares moduli."""
    powers = np.array(_POWERS)
    basis = terms.basis(powers)
    tried = []
    for chosen in combinations(range(len(powers)), order):
        rows = basis[:, chosen]
        moduli = _solved(rows, terms.wanted)
        tried.append((float(np.sum((rows @ moduli - terms.wanted) ** 2)), moduli, powers[list(chosen)]))
    tried.sort(key=lambda each: each[0])
    return [(moduli, alphas) for _, moduli, alphas in tried[:_REFINED]]


def _ordered(fitted: Ogden, parameters: FloatArray) -> FloatArray:
    """Return the same sum with terms in order of falling power, so that equal fits look equal."""
    moduli, powers = fitted.split(parameters)
    order = np.argsort(-powers)
    return np.concatenate([moduli[order], powers[order]])


def _quality(fitted: Model, parameters: FloatArray, curves: Sequence[Curve]) -> tuple[ModeQuality, ...]:
    qualities = []
    for name, mode in MODES.items():
        ours = [curve for curve in curves if curve.mode.name == name]
        if not ours:
            continue
        stretch = np.concatenate([curve.stretch for curve in ours])
        stress = np.concatenate([curve.stress_MPa for curve in ours])
        error = fitted.stress(parameters, mode, stretch) - stress
        floored = np.maximum(np.abs(stress), _FLOOR * np.abs(stress).max())
        spread = float(np.sum((stress - stress.mean()) ** 2))
        qualities.append(
            ModeQuality(
                mode=name,
                points=len(stretch),
                stretch_range=(min(float(stretch.min()), 1.0), max(float(stretch.max()), 1.0)),
                rms_MPa=float(np.sqrt(np.mean(error**2))),
                rms_relative=float(np.sqrt(np.mean((error / floored) ** 2))),
                r_squared=None if spread == 0 else 1 - float(error @ error) / spread,
            )
        )
    return tuple(qualities)


def _aicc(residuals: Sequence[FloatArray], lag_one: float, parameters: int) -> float | None:
    """Return the AICc with k = parameters, the variance and the correlation."""
    points, k = sum(len(r) for r in residuals), parameters + 2
    likelihood = log_likelihood(residuals, lag_one)
    if points - k - 1 <= 0 or likelihood == float("inf"):
        return None
    return -2 * likelihood + 2 * k + 2 * k * (k + 1) / (points - k - 1)

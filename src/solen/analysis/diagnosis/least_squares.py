"""Least-squares fit of a model to mean curves, with uncertainties from the scatter of the cycles.

The noise of a recording is not white: drift, flicker and lag correlate the errors of neighbouring angles. However,
**cycles are repetitions of each other**. To first order, every estimate is a linear function of the curves. This
function, applied to each cycle separately, gives the scatter of the estimate, whatever the correlations within a cycle.
The mean of the estimate over n cycles follows Student's t distribution with n − 1 degrees of freedom. Two components
are added according to the law of propagation of uncertainty:

- priors (e.g. of the index), which enter the fit as observations;
- **misfit**: deviations of the mean curves from the model that exceed the scatter of the cycles, expressed as cosine
  waves over the range. Their amplitude is estimated from the waves that no parameter can absorb, and assumed to be the
  same for the other waves.

The effective degrees of freedom of the sum follow Welch and Satterthwaite.

Public names: `Cycles`, `fit` and `Fitted`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from solen.analysis.diagnosis.curve_model import OFFSET, SPREAD, Model
from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.results import Result, reported

START_DECENTRES_MM = (0.0, -0.03, 0.03, -0.06, 0.06, -0.1, 0.1)
START_SPREADS_MM2 = (0.1**2, 0.25**2)
"""Starting values of the emitter's decentre, relative to the design, and of the squared width of its chip."""
MAX_REFINED = 3
"""Number of starting values that are refined: those with the best linear fits. Parameters with a prior are fixed in the
first refinement.
"""
WAVES = 12
"""Number of cosine waves that a misfit may contain; they have 0, 1, 2, … half periods over the range of angles."""
MAX_CHANCE = 0.05
"""A misfit is significant if the probability of such a misfit by chance is below this value."""
MAX_CHANCE_ADDED = 0.16
"""Largest probability of a misfit by chance for which the misfit is added to the uncertainties."""
CURVE_ERROR = 2e-5
"""Error common to the curves of all cycles, as a fraction of the swing, due to interpolation between log entries and to
averaging over cells.
"""
_MAX_ITERATIONS = 60


@dataclass(frozen=True, eq=False)
class Cycles:
    """Curves of the cycles in a recording.

    Attributes
    ----------
    angle_deg
        Evenly spaced angles, (n,).
    volts
        Voltages (cycles, n, r); NaN at angles that are omitted.
    """

    angle_deg: FloatArray
    volts: FloatArray

    @property
    def valid(self) -> BoolArray:
        """Whether every cycle has a value at each angle, (n, r)."""
        return np.asarray(np.isfinite(self.volts).all(axis=0))

    @property
    def mean_V(self) -> FloatArray:
        """Mean of the cycles, (n, r); NaN at angles that are omitted."""
        return np.asarray(np.where(self.valid, self.volts.mean(axis=0), np.nan))

    @property
    def swing_V(self) -> FloatArray:
        """Range of each mean curve, (r,)."""
        mean = self.mean_V
        return np.asarray(np.nanmax(mean, axis=0) - np.nanmin(mean, axis=0))


class Misfit(Result):
    """Misfit of the model to the mean curves.

    Attributes
    ----------
    rms_V
        RMS residual of each receiver (r,), right before left.
    ratio, chance
        Mean square of the residual waves relative to the value expected from the scatter of the cycles, and the
        probability of such a ratio by chance; NaN for a single cycle.
    share
        Size of the misfit beyond the scatter as a fraction of the swing; 0 if there is none.
    """

    rms_V: FloatArray
    ratio: float
    chance: float
    share: float

    @reported
    def significant(self) -> bool:
        """Whether the misfit is significant."""
        return bool(self.chance < MAX_CHANCE)


@dataclass(frozen=True, eq=False)
class Fitted:
    """Result of a fit.

    Attributes
    ----------
    model
        The fitted model.
    values
        Values of all parameters, (p,).
    active
        Indices of the fitted parameters, (a,).
    covariance
        Covariance of the fitted parameters, (a, a).
    freedom
        Effective degrees of freedom of each fitted parameter, (a,).
    residual_V
        Mean curve minus model, (n, r); NaN at angles that are omitted.
    misfit
        See `Misfit`.
    """

    model: Model
    values: FloatArray
    active: IndexArray
    covariance: FloatArray
    freedom: FloatArray
    residual_V: FloatArray
    misfit: Misfit

    @property
    def names(self) -> list[str]:
        """Names of the fitted parameters."""
        return [self.model.parameters[index].name for index in self.active]

    def u(self, name: str) -> float:
        """Return the standard uncertainty of a parameter, or inf if the parameter was not fitted."""
        row = self._row(name)
        return float(np.sqrt(self.covariance[row, row])) if row is not None else float("inf")

    def value(self, name: str) -> float:
        """Return the value of a parameter."""
        return float(self.values[self.model.indices[name]])

    def half_width(self, name: str, level: float = 0.95) -> float:
        """Return the half-width of the interval of a parameter at a level, from Student's t distribution."""
        from scipy.stats import t

        row = self._row(name)
        if row is None:
            return float("inf")
        return float(t.ppf(0.5 + 0.5 * level, self.freedom[row])) * self.u(name)

    def _row(self, name: str) -> int | None:
        names = self.names
        return names.index(name) if name in names else None


def fit(model: Model, cycles: Cycles, active: Sequence[int], start: FloatArray | None = None) -> Fitted:
    """Fit a model to the mean of the cycles by least squares.

    Parameters
    ----------
    model
        Model with the same angles and receivers.
    cycles
        Curves; at least two cycles are required for intervals.
    active
        Indices of the fitted parameters; the others are fixed at their start values.
    start
        Starting values (p,); by default those with the best fit for several decentres.
    """
    indices = np.array(sorted(active), dtype=np.intp)
    sd = _mean_sd(cycles)
    values = _started(model, cycles, indices, sd) if start is None else _solved(model, cycles, indices, sd, start)[0]
    residual = cycles.mean_V - model.volts(values)
    rms = np.sqrt(np.nanmean(residual**2, axis=0))
    sd = np.maximum(sd, rms)  # the misfit limits the weight of the curves
    values = _solved(model, cycles, indices, sd, values)[0]
    return _fitted(model, cycles, indices, sd, values)


def _mean_sd(cycles: Cycles) -> FloatArray:
    """Return the standard deviation of each receiver's mean curve (r,), always greater than 0."""
    count = len(cycles.volts)
    minimum = 1e-6 * cycles.swing_V + 1e-12
    if count < 2:
        return np.asarray(1e-3 * cycles.swing_V + minimum)
    scatter = np.where(cycles.valid, cycles.volts.var(axis=0, ddof=1), np.nan)
    return np.asarray(np.sqrt(np.nanmean(scatter, axis=0) / count) + minimum)


def _started(model: Model, cycles: Cycles, indices: IndexArray, sd: FloatArray) -> FloatArray:
    """Return the parameter values fitted from the best of several starting points."""
    parameters = model.parameters
    spread_mm2 = parameters[model.indices[SPREAD]].start
    free = {parameters[index].name for index in indices}
    starts = [
        model.start(cycles.mean_V, model.response.offset_mm + offset, spread)
        for offset in (START_DECENTRES_MM if OFFSET in free else (0.0,))
        for spread in ({spread_mm2, *START_SPREADS_MM2} if SPREAD in free else {spread_mm2})
    ]
    costs = [_residuals(model, cycles, indices, sd, start)[1] for start in starts]
    without_prior = np.array([index for index in indices if np.isinf(parameters[index].u_prior)], dtype=np.intp)
    refined = [_solved(model, cycles, without_prior, sd, starts[n]) for n in np.argsort(costs)[:MAX_REFINED]]
    best = min(refined, key=lambda result: result[1])[0]
    return _solved(model, cycles, indices, sd, best)[0]


def _solved(
    model: Model, cycles: Cycles, indices: IndexArray, sd: FloatArray, start: FloatArray
) -> tuple[FloatArray, float]:
    """Return the values and sum of squares from the Levenberg-Marquardt method, with scaled parameters."""
    scale = np.array([model.parameters[index].scale for index in indices])
    values, damping = start.copy(), 1e-3
    residuals, cost = _residuals(model, cycles, indices, sd, values)
    for _ in range(_MAX_ITERATIONS):
        jacobian = _jacobian(model, cycles, indices, sd, values) * scale
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ residuals
        diagonal = np.diag(normal) + 1e-12 * np.trace(normal)
        while True:
            step = np.linalg.solve(normal + damping * np.diag(diagonal), gradient)
            new_values = values.copy()
            new_values[indices] += scale * step
            _keep_within(model, new_values)
            new_residuals, new_cost = _residuals(model, cycles, indices, sd, new_values)
            if new_cost <= cost or damping > 1e8:
                break
            damping *= 8.0
        if not new_cost <= cost:
            break
        decrease, values, residuals, cost = cost - new_cost, new_values, new_residuals, new_cost
        damping = max(damping / 12.0, 1e-12)
        if decrease <= 1e-10 * (1e-12 + cost) and np.abs(step).max() < 1e-6:
            break
    return values, cost


def _keep_within(model: Model, values: FloatArray) -> None:
    """Limit the chip to the traced positions."""
    reach, offset, spread = model.response.reach_mm, model.indices[OFFSET], model.indices[SPREAD]
    values[offset] = np.clip(values[offset], -0.6 * reach, 0.6 * reach)
    max_width = 2.0 * (reach - abs(values[offset]))
    values[spread] = np.clip(values[spread], -(0.1**2), max_width**2)


def _residuals(
    model: Model, cycles: Cycles, indices: IndexArray, sd: FloatArray, values: FloatArray
) -> tuple[FloatArray, float]:
    """Return the residuals of curves and priors, in units of their standard deviations, and their sum of squares."""
    of_curves = ((cycles.mean_V - model.volts(values)) / sd)[cycles.valid]
    of_priors = [(model.parameters[n].start - values[n]) / model.parameters[n].u_prior for n in indices]
    residuals = np.concatenate([of_curves, of_priors])
    return residuals, float(residuals @ residuals)


def _jacobian(model: Model, cycles: Cycles, indices: IndexArray, sd: FloatArray, values: FloatArray) -> FloatArray:
    """Return the derivatives of curves and priors, in units of their standard deviations, (observations, a)."""
    of_curves = (model.jacobian(values, indices.tolist()) / sd[:, None])[cycles.valid]
    of_priors = np.diag([1.0 / model.parameters[n].u_prior for n in indices])
    return np.concatenate([of_curves, of_priors])


def _fitted(model: Model, cycles: Cycles, indices: IndexArray, sd: FloatArray, values: FloatArray) -> Fitted:
    """Return the fit, with its covariance and misfit; curves are in units of their standard deviations."""
    valid, count = cycles.valid, len(cycles.volts)
    sd_of_points = np.broadcast_to(sd, valid.shape)[valid]
    jacobian = (model.jacobian(values, indices.tolist()) / sd[:, None])[valid]
    scale = np.array([model.parameters[n].scale for n in indices])
    priors = np.diag([1.0 / model.parameters[n].u_prior ** 2 for n in indices])
    inverse = _inverse(jacobian.T @ jacobian + priors, scale)
    estimator = inverse @ jacobian.T  # maps curves to estimates
    residual_V = np.where(valid, cycles.mean_V - model.volts(values), np.nan)
    residuals = (residual_V / sd)[valid]
    deviations = ((cycles.volts - cycles.mean_V) / sd)[:, valid] if count > 1 else np.zeros((0, len(residuals)))
    waves = _waves(cycles) * (np.broadcast_to(cycles.swing_V, valid.shape)[valid] / sd_of_points)[:, None]
    amplitude, wave_freedom, test = _misfit(residuals, deviations, waves, jacobian, estimator, count)
    estimates = deviations @ estimator.T
    white = _white(residuals, jacobian, inverse)
    scatter = estimates.T @ estimates / (count * (count - 1)) if count > 1 else white
    by_wave = estimator @ waves
    misfit = amplitude**2 * by_wave @ by_wave.T
    model_error = ((model.response.u_fraction**2 + CURVE_ERROR**2) / (0.5 * WAVES)) * by_wave @ by_wave.T
    covariance = scatter + misfit + model_error + inverse @ priors @ inverse
    scatter_freedom = float(count - 1) if count > 1 else max(len(residuals) - len(indices), 1.0)
    components = ((np.diag(scatter), scatter_freedom), (np.diag(misfit), wave_freedom))
    freedom = np.diag(covariance) ** 2 / sum(np.maximum(part, 1e-300) ** 2 / nu for part, nu in components)
    rms_V = np.sqrt(np.nanmean(residual_V**2, axis=0))
    result = Misfit(rms_V, *test, amplitude * np.sqrt(0.5 * WAVES))
    return Fitted(model, values, indices, covariance, freedom, residual_V, result)


def _inverse(normal: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the inverse of a matrix of normal equations, computed with scaled parameters."""
    return np.asarray(np.linalg.inv(normal * np.outer(scale, scale)) * np.outer(scale, scale))


def _white(residuals: FloatArray, jacobian: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the covariance of the estimates from a single cycle, for white noise with the scatter of the residuals."""
    variance = float(residuals @ residuals) / max(len(residuals) - jacobian.shape[1], 1)
    return np.asarray(variance * inverse @ (jacobian.T @ jacobian) @ inverse)


def _waves(cycles: Cycles) -> FloatArray:
    """Return the cosines over the range for each receiver separately, (observations, r × WAVES)."""
    angle, valid = cycles.angle_deg, cycles.valid
    phase = np.pi * (angle - angle[0]) / (angle[-1] - angle[0])
    cosines = np.cos(phase[:, None] * np.arange(WAVES))
    receivers = valid.shape[1]
    waves = np.zeros((*valid.shape, receivers * WAVES))
    for n in range(receivers):
        waves[:, n, n * WAVES : (n + 1) * WAVES] = cosines
    return np.asarray(waves[valid])


def _misfit(
    residuals: FloatArray,
    deviations: FloatArray,
    waves: FloatArray,
    jacobian: FloatArray,
    estimator: FloatArray,
    count: int,
) -> tuple[float, float, tuple[float, float]]:
    """Return the amplitude and degrees of freedom of the misfit waves, and the significance of the misfit.

    The significance is the ratio of the waves to the scatter, and the probability of such a ratio by chance.
    """
    unabsorbed = waves - jacobian @ (estimator @ waves)
    basis, singular, _ = np.linalg.svd(unabsorbed, full_matrices=False)
    basis = basis[:, singular > 1e-3 * singular[0]]
    freedom = float(np.sum(singular**2) ** 2 / np.sum(singular**4))
    misfit = float(np.sum((basis.T @ residuals) ** 2))
    per_wave = float(np.sum((basis.T @ unabsorbed) ** 2))
    if count < 2:
        return 0.0, freedom, (np.nan, np.nan)
    components = (deviations - deviations @ estimator.T @ jacobian.T) @ basis
    covariance = components.T @ components / (count * (count - 1))
    noise = float(np.trace(covariance))
    if not noise > 0.0:
        return float(np.sqrt(misfit / per_wave)), freedom, (np.inf, 0.0)
    effective = _effective(covariance, count - 1)
    ratio = misfit / noise
    chance = float(f_distribution.sf(ratio, effective, effective * (count - 1)))
    excess = max(misfit - noise, 0.0) / per_wave if chance < MAX_CHANCE_ADDED else 0.0
    return float(np.sqrt(excess)), freedom, (ratio, chance)


def _effective(scatter: FloatArray, freedom: int) -> float:
    """Return the effective number of independent waves, tr² C / tr C², from the scatter matrix S of a few deviations.

    The estimate uses E tr S² = (1 + 1/ν) tr C² + tr² C / ν for ν degrees of freedom.
    """
    size = float(len(scatter))
    trace, square = float(np.trace(scatter)), float(np.sum(scatter**2))
    unbiased = (square - trace**2 / freedom) / (1.0 + 1.0 / freedom)
    return float(np.clip(trace**2 / max(unbiased, trace**2 / size), 1.0, size))

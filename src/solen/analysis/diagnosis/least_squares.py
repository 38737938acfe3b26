"""Least-squares fit of a model to mean curves, with uncertainties from the scatter of the cycles.

The noise of a recording is not white: drift, flicker and lag correlate the errors of neighbouring angles. But **cycles
are repetitions of each other**. The fit is by least squares, and every estimate is, to first order, a linear function
of the curves. This function, applied to each cycle separately, gives the scatter of the estimate, whatever the
correlations within a cycle. The mean of the estimate over n cycles follows Student's t distribution with n − 1 degrees
of freedom. Two terms are added according to the law of propagation:

- priors (e.g. of the index), which enter the fit as observations;
- **misfit**: deviations of the mean curves from the model beyond the scatter of the cycles, expressed as waves.
  The wave amplitude is estimated from the waves that no parameter can absorb, and assumed for the others.

The degrees of freedom of the sum follow Welch and Satterthwaite.

Public names: `Cycles`, `fit` and `Fitted`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from solen.analysis.diagnosis.curve_model import OFFSET, SPREAD, Model
from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.results import Result, reported

STARTS_MM = (0.0, -0.03, 0.03, -0.06, 0.06, -0.1, 0.1)
STARTS_MM2 = (0.1**2, 0.25**2)
TRIED = 3
"""Number of starting values (chip decentres and spreads) that are refined in a fit.

The starting values with the best linear fits are chosen. Parameters with priors are fixed at first.
"""
WAVES = 12
"""Number of half waves over the range of angles, from 0, that a misfit may contain."""
SIGNIFICANT = 0.05
"""A misfit is significant if the probability of such a misfit by chance is below this value."""
CURVES_SHARE = 2e-5
"""Error common to the curves of all cycles, as a fraction of the swing, due to interpolation between log entries and to
averaging over cells.
"""
_ROUNDS = 60


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
        Root mean square of the residuals by receiver (r,), right before left.
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
        return bool(self.chance < SIGNIFICANT)


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

    def u(self, name: str) -> float:
        """Return the standard uncertainty of a parameter, or inf if the parameter was not fitted."""
        place = self._place(name)
        return float(np.sqrt(self.covariance[place, place])) if place is not None else float("inf")

    def value(self, name: str) -> float:
        """Return the value of a parameter."""
        return float(self.values[self.model.places[name]])

    def half_width(self, name: str, level: float = 0.95) -> float:
        """Return the half-width of the 95 % interval of a parameter, from Student's t distribution."""
        from scipy.stats import t

        place = self._place(name)
        if place is None:
            return float("inf")
        return float(t.ppf(0.5 + 0.5 * level, self.freedom[place])) * self.u(name)

    def _place(self, name: str) -> int | None:
        place = np.flatnonzero(self.active == self.model.places[name])
        return int(place[0]) if place.size else None


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
        Starting values (p,); by default the best of several decentres.
    """
    places = np.array(sorted(active), dtype=np.intp)
    sd = _first_sd(cycles)
    values = _started(model, cycles, places, sd) if start is None else _solved(model, cycles, places, sd, start)[0]
    residual = cycles.mean_V - model.volts(values)
    again = np.sqrt(np.nanmean(residual**2, axis=0))
    sd = np.maximum(sd, again)  # the misfit limits the weight of the curves
    values = _solved(model, cycles, places, sd, values)[0]
    return _fitted(model, cycles, places, sd, values)


def _first_sd(cycles: Cycles) -> FloatArray:
    """Return the standard deviation of each receiver's mean curve (r,), always greater than 0."""
    count = len(cycles.volts)
    least = 1e-6 * cycles.swing_V + 1e-12
    if count < 2:
        return np.asarray(1e-3 * cycles.swing_V + least)
    scatter = np.where(cycles.valid, cycles.volts.var(axis=0, ddof=1), np.nan)
    return np.asarray(np.sqrt(np.nanmean(scatter, axis=0) / count) + least)


def _started(model: Model, cycles: Cycles, places: IndexArray, sd: FloatArray) -> FloatArray:
    """Return the parameter values fitted from the best of several starting points."""
    spread = model.parameters[model.places[SPREAD]].start
    free = {model.parameters[place].name for place in places}
    begun = [
        model.start(cycles.mean_V, model.response.offset_mm + offset, width)
        for offset in (STARTS_MM if OFFSET in free else (0.0,))
        for width in ({spread, *STARTS_MM2} if SPREAD in free else {spread})
    ]
    costs = [_rest(model, cycles, places, sd, one)[1] for one in begun]
    unknown = np.array([place for place in places if np.isinf(model.parameters[place].known)], dtype=np.intp)
    nearest = [_solved(model, cycles, unknown, sd, begun[n]) for n in np.argsort(costs)[:TRIED]]
    best = min(nearest, key=lambda one: one[1])[0]
    return _solved(model, cycles, places, sd, best)[0]


def _solved(
    model: Model, cycles: Cycles, places: IndexArray, sd: FloatArray, start: FloatArray
) -> tuple[FloatArray, float]:
    """Return the values and sum of squares from the Levenberg-Marquardt method, with scaled parameters."""
    scale = np.array([model.parameters[place].scale for place in places])
    values, damping = start.copy(), 1e-3
    rest, cost = _rest(model, cycles, places, sd, values)
    for _ in range(_ROUNDS):
        table = _table(model, cycles, places, sd, values) * scale
        normal, slope = table.T @ table, table.T @ rest
        size = np.diag(normal) + 1e-12 * np.trace(normal)
        while True:
            step = np.linalg.solve(normal + damping * np.diag(size), slope)
            tried = values.copy()
            tried[places] += scale * step
            _keep_within(model, tried)
            other, less = _rest(model, cycles, places, sd, tried)
            if less <= cost or damping > 1e8:
                break
            damping *= 8.0
        if not less <= cost:
            break
        gained, values, rest, cost = cost - less, tried, other, less
        damping = max(damping / 12.0, 1e-12)
        if gained <= 1e-10 * (1e-12 + cost) and np.abs(step).max() < 1e-6:
            break
    return values, cost


def _keep_within(model: Model, values: FloatArray) -> None:
    """Return the limit the chip to the traced positions."""
    reach, at = model.response.reach_mm, model.places
    values[at[OFFSET]] = np.clip(values[at[OFFSET]], -0.6 * reach, 0.6 * reach)
    most = 2.0 * (reach - abs(values[at[OFFSET]]))
    values[at[SPREAD]] = np.clip(values[at[SPREAD]], -(0.1**2), most**2)


def _rest(
    model: Model, cycles: Cycles, places: IndexArray, sd: FloatArray, values: FloatArray
) -> tuple[FloatArray, float]:
    """Return the residuals of the mean curves and of the priors, in units of their standard deviations."""
    left = ((cycles.mean_V - model.volts(values)) / sd)[cycles.valid]
    prior = np.array([(model.parameters[p].start - values[p]) / model.parameters[p].known for p in places])
    rest = np.concatenate([left, prior])
    return rest, float(rest @ rest)


def _table(model: Model, cycles: Cycles, places: IndexArray, sd: FloatArray, values: FloatArray) -> FloatArray:
    """Return the derivatives of the model with respect to the parameters, in the same units, (observations, a)."""
    table = (model.jacobian(values, places.tolist()) / sd[:, None])[cycles.valid]
    prior = np.diag([1.0 / model.parameters[p].known for p in places])
    return np.concatenate([table, prior])


def _fitted(model: Model, cycles: Cycles, places: IndexArray, sd: FloatArray, values: FloatArray) -> Fitted:
    valid, count = cycles.valid, len(cycles.volts)
    width = np.broadcast_to(sd, valid.shape)[valid]
    table = (model.jacobian(values, places.tolist()) / sd[:, None])[valid]
    scale = np.array([model.parameters[p].scale for p in places])
    known = np.array([1.0 / model.parameters[p].known ** 2 for p in places])
    inverse = _inverse(table.T @ table + np.diag(known), scale)
    hat = inverse @ table.T  # for curves in units of their standard deviations
    left = ((cycles.mean_V - model.volts(values)) / sd)[valid]
    apart = ((cycles.volts - cycles.mean_V) / sd)[:, valid] if count > 1 else np.zeros((0, len(left)))
    waves = _waves(cycles) * (np.broadcast_to(cycles.swing_V, valid.shape)[valid] / width)[:, None]
    share, freedom, misfit = _misfit(left, apart, waves, table, hat, count)
    moved = apart @ hat.T
    scattered = moved.T @ moved / (count * (count - 1)) if count > 1 else _white(left, table, inverse)
    through = hat @ waves
    missed = share**2 * through @ through.T
    floor = ((model.response.u_share**2 + CURVES_SHARE**2) / (0.5 * WAVES)) * through @ through.T
    parts = [
        (np.diag(scattered), float(count - 1) if count > 1 else max(len(left) - len(places), 1.0)),
        (np.diag(missed), freedom),
    ]
    prior = inverse @ np.diag(known) @ inverse
    covariance = scattered + missed + floor + prior
    total = np.diag(covariance)
    freedoms = total**2 / sum(np.maximum(part, 1e-300) ** 2 / nu for part, nu in parts)
    residual = np.where(valid, cycles.mean_V - model.volts(values), np.nan)
    rms = np.sqrt(np.nanmean(residual**2, axis=0))
    misfit_of = Misfit(rms, *misfit, share * np.sqrt(0.5 * WAVES))
    return Fitted(model, values, places, covariance, freedoms, residual, misfit_of)


def _inverse(normal: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the inverse of a matrix of normal equations, computed with scaled parameters."""
    return np.asarray(np.linalg.inv(normal * np.outer(scale, scale)) * np.outer(scale, scale))


def _white(left: FloatArray, table: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the covariance of a single cycle, estimated from its residuals."""
    variance = float(left @ left) / max(len(left) - table.shape[1], 1)
    return np.asarray(variance * inverse @ (table.T @ table) @ inverse)


def _waves(cycles: Cycles) -> FloatArray:
    """Return the cosines over the range for each receiver separately, (observations, r × WAVES)."""
    angle, valid = cycles.angle_deg, cycles.valid
    phase = np.pi * (angle - angle[0]) / (angle[-1] - angle[0])
    one = np.cos(phase[:, None] * np.arange(WAVES))
    receivers = valid.shape[1]
    waves = np.zeros((*valid.shape, receivers * WAVES))
    for n in range(receivers):
        waves[:, n, n * WAVES : (n + 1) * WAVES] = one
    return np.asarray(waves[valid])


def _misfit(
    left: FloatArray, apart: FloatArray, waves: FloatArray, table: FloatArray, hat: FloatArray, count: int
) -> tuple[float, float, tuple[float, float]]:
    """Return the size of the misfit waves, their degrees of freedom, and their ratio to the scatter with its probability."""
    seen = waves - table @ (hat @ waves)
    basis, sizes, _ = np.linalg.svd(seen, full_matrices=False)
    basis = basis[:, sizes > 1e-3 * sizes[0]]
    most, freedom = float(basis.shape[1]), float(np.sum(sizes**2) ** 2 / np.sum(sizes**4))
    misfit = float(np.sum((basis.T @ left) ** 2))
    through = float(np.sum((basis.T @ seen) ** 2))
    if count < 2:
        return 0.0, freedom, (np.nan, np.nan)
    parts = (apart - apart @ hat.T @ table.T) @ basis
    covariance = parts.T @ parts / (count * (count - 1))
    noise = float(np.trace(covariance))
    if not noise > 0.0:
        return float(np.sqrt(misfit / through)), freedom, (np.inf, 0.0)
    effective = _effective(covariance, most, count - 1)
    ratio = misfit / noise
    chance = float(f_distribution.sf(ratio, effective, effective * (count - 1)))
    beyond = max(misfit - noise, 0.0) / through if chance < 0.16 else 0.0
    return float(np.sqrt(beyond)), freedom, (ratio, chance)


def _effective(scatter: FloatArray, most: float, freedom: int) -> float:
    """Return the effective number of independent waves, tr² C / tr C², from the scatter matrix S of a few deviations.

    The estimate uses E tr S² = (1 + 1/ν) tr C² + tr² C / ν for ν degrees of freedom.
    """
    trace, square = float(np.trace(scatter)), float(np.sum(scatter**2))
    unbiased = (square - trace**2 / freedom) / (1.0 + 1.0 / freedom)
    return float(np.clip(trace**2 / max(unbiased, trace**2 / most), 1.0, most))

"""Uncertainty of a fit whose neighbouring residuals are correlated.

A testing machine samples a smooth curve a hundred times a second. The residuals of a fit to it are not independent: the
machine's filter and any misfit of the model correlate neighbours, and a plain least-squares uncertainty shrinks with
the sampling rate without further information. Residuals are modelled as first-order autoregressive along each curve,
V_ij = ρ^|i−j|, and V is propagated through the estimator, so that n points count as about n(1 − ρ)/(1 + ρ) (Bayley &
Hammersley 1946).

Residuals of a fit are less correlated than the noise, because the fit follows some of the noise. ρ is therefore the
value at which the expected lag-one correlation of the residuals, tr(M S M V)/tr(M V), equals the measured one, where M
= I − J(JᵀJ)⁻¹Jᵀ converts noise to residuals and S shifts by one point.

`scatter` evaluates a linearised least-squares fit, `effective_points` counts independent points, and `log_likelihood`
evaluates residuals.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray

_MAX_CORRELATION = 0.995
_NEGLIGIBLE = 1e-10  # singular value, relative to the largest, below which a direction is due to rounding
_SINGULAR = 1e14  # condition number above which an inverse has no correct digit


@dataclass(frozen=True, eq=False)
class Scatter:
    """Statistics of a fit's parameters from its residuals.

    Attributes
    ----------
    covariance
        Covariance of the parameters, shape (p, p); None if the data do not determine them.
    sigma
        Standard deviation of a residual.
    lag_one
        Correlation ρ of neighbouring residuals.
    effective_points
        Equivalent number of independent points.
    """

    covariance: FloatArray | None
    sigma: float
    lag_one: float
    effective_points: float


def effective_points(points: int, lag_one: float) -> float:
    """Return the number of independent points, at least one, equivalent to ``points`` with that lag-one correlation."""
    return max(points * (1 - lag_one) / (1 + lag_one), 1.0)


def scatter(jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> Scatter:
    """Return the covariance of least-squares parameters whose residuals are correlated along each curve.

    Parameters
    ----------
    jacobians
        For each curve, derivatives of the weighted model with respect to the parameters, (points, p).
    residuals
        For each curve, weighted residuals, (points,).
    """
    points = sum(len(r) for r in residuals)
    power = sum(float(r @ r) for r in residuals)
    basis = _basis(jacobians)
    if points <= basis[0].shape[1]:
        return Scatter(None, 0.0, 0.0, float(points))
    lag_one = _lag_one(basis, residuals)
    variance = power / max(points - _overlap(basis, lag_one), 1.0)
    worth = effective_points(points, lag_one)
    inverse = _inverse(_gram(jacobians, jacobians))
    if inverse is None:
        return Scatter(None, float(np.sqrt(variance)), lag_one, worth)
    covariance = variance * inverse @ _gram(jacobians, [_smeared(j, lag_one) for j in jacobians]) @ inverse
    return Scatter((covariance + covariance.T) / 2, float(np.sqrt(variance)), lag_one, worth)


def log_likelihood(residuals: Sequence[FloatArray], lag_one: float) -> float:
    """Return the log-likelihood of residuals, autoregressive along each curve, maximised over their variance."""
    points = sum(len(r) for r in residuals)
    power = sum((1 - lag_one**2) * r[0] ** 2 + float(np.sum((r[1:] - lag_one * r[:-1]) ** 2)) for r in residuals)
    if power <= 0:
        return float("inf")
    starts = len(residuals) / 2 * math.log(1 - lag_one**2)
    return starts - points / 2 * (math.log(2 * math.pi * power / points) + 1)


def _basis(jacobians: Sequence[FloatArray]) -> list[FloatArray]:
    """Return orthonormal columns that span the effects of the parameters, even if some are not determined."""
    stacked = np.vstack(jacobians)
    size = np.linalg.norm(stacked, axis=0)
    left, singular, _ = np.linalg.svd(stacked / np.where(size > 0, size, 1.0), full_matrices=False)
    kept = left[:, singular > _NEGLIGIBLE * singular[0]]
    return np.split(kept, np.cumsum([len(j) for j in jacobians])[:-1])


def _lag_one(basis: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> float:
    """Return ρ from 0 to 0.995 for which the expected correlation of the residuals equals the measured one."""
    from scipy.optimize import brentq

    power = sum(float(r @ r) for r in residuals)
    if power <= 0:
        return 0.0
    measured = sum(float(r[1:] @ r[:-1]) for r in residuals) / power
    shifted = _gram(basis, [_shifted(q) for q in basis])

    def excess(lag_one: float) -> float:
        return _expected(basis, shifted, lag_one) - measured

    if excess(0.0) >= 0:
        return 0.0
    return (
        _MAX_CORRELATION if excess(_MAX_CORRELATION) <= 0 else float(brentq(excess, 0.0, _MAX_CORRELATION, xtol=1e-6))
    )


def _expected(basis: Sequence[FloatArray], shifted: FloatArray, lag_one: float) -> float:
    """Return tr(M S M V)/tr(M V) with M = I − QQᵀ, without a matrix of points by points."""
    points = sum(len(q) for q in basis)
    smeared = [_smeared(q, lag_one) for q in basis]
    through = _gram(basis, smeared)
    both = _gram(basis, [_shifted(s) for s in smeared])
    above = (points - len(basis)) * lag_one + float(np.sum(shifted * through.T) - 2 * np.trace(both))
    return above / (points - float(np.trace(through)))


def _overlap(basis: Sequence[FloatArray], lag_one: float) -> float:
    """Return tr(Qᵀ V Q), the part of correlated noise that the fit follows, in points."""
    return float(np.trace(_gram(basis, [_smeared(q, lag_one) for q in basis])))


def _gram(left: Sequence[FloatArray], right: Sequence[FloatArray]) -> FloatArray:
    """Return the sum over curves of LᵀR."""
    total = np.zeros((left[0].shape[1], right[0].shape[1]))
    for first, second in zip(left, right, strict=True):
        total += first.T @ second
    return total


def _shifted(columns: FloatArray) -> FloatArray:
    """Return S times columns: half of the neighbour on each side."""
    shifted = np.zeros_like(columns)
    shifted[1:] += columns[:-1] / 2
    shifted[:-1] += columns[1:] / 2
    return shifted


def _smeared(columns: FloatArray, lag_one: float) -> FloatArray:
    """Return V times columns, V_ij = ρ^|i−j|, with one sweep in each direction."""
    from scipy.signal import lfilter

    if lag_one == 0:
        return columns
    forward = lfilter([1.0], [1.0, -lag_one], columns, axis=0)
    backward = lfilter([1.0], [1.0, -lag_one], columns[::-1], axis=0)[::-1]
    return np.asarray(forward + backward - columns)


def _inverse(normal: FloatArray) -> FloatArray | None:
    """Return the inverse of a normal matrix, scaled for units of different orders; None if it has none."""
    scale = np.sqrt(np.diag(normal))
    if not np.isfinite(normal).all() or (scale == 0).any():
        return None
    scaled = normal / np.outer(scale, scale)
    if np.linalg.cond(scaled) > _SINGULAR:
        return None
    return np.asarray(np.linalg.inv(scaled) / np.outer(scale, scale))

"""Uncertainty of a fit with correlated neighbouring residuals.

A testing machine samples a smooth curve a hundred times a second. The residuals of a fit to it are not independent: the
filter of the machine and the misfit of the model correlate neighbouring points, and an ordinary least-squares
uncertainty would decrease with the sampling rate although no information is gained. The residuals of each curve are
therefore modelled as first-order autoregressive, V_ij = ρ^|i−j|, and V is propagated to the parameters, so that n
points are equivalent to about n(1 − ρ)/(1 + ρ) independent ones (Bayley & Hammersley 1946).

Residuals of a fit are less correlated than the noise, because the fit follows some of the noise. ρ is therefore the
value at which the expected lag-one correlation of the residuals, tr(M S M V)/tr(M V), equals the measured one, where M
= I − J(JᵀJ)⁻¹Jᵀ converts noise to residuals, and S averages the two neighbours of each point.

`scatter` evaluates a linearised least-squares fit, `effective_points` returns the equivalent number of independent
points, and `log_likelihood` evaluates residuals.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray

_MAX_CORRELATION = 0.995
_MIN_SINGULAR_VALUE = 1e-10  # smaller values, relative to the largest, are due to rounding
_MAX_CONDITION = 1e14  # condition number above which an inverse has no correct digit


@dataclass(frozen=True, eq=False)
class Scatter:
    """Statistics of a fit from its residuals.

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
    """Return the number of independent points, at least 1, equivalent to points with the lag-one correlation given."""
    return max(points * (1 - lag_one) / (1 + lag_one), 1.0)


def scatter(jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> Scatter:
    """Return the statistics of a least-squares fit with residuals that are correlated within each curve.

    Parameters
    ----------
    jacobians
        For each curve, derivatives of the weighted model with respect to the parameters, (points, p).
    residuals
        For each curve, weighted residuals, (points,).
    """
    points = sum(len(r) for r in residuals)
    squares = sum(float(r @ r) for r in residuals)
    basis = _basis(jacobians)
    if points <= basis[0].shape[1]:
        return Scatter(None, 0.0, 0.0, float(points))
    lag_one = _lag_one(basis, residuals)
    lost_points = float(np.trace(_gram(basis, [_correlated(q, lag_one) for q in basis])))  # tr(Qᵀ V Q)
    variance = squares / max(points - lost_points, 1.0)
    effective = effective_points(points, lag_one)
    inverse = _inverse(_gram(jacobians, jacobians))
    if inverse is None:
        return Scatter(None, float(np.sqrt(variance)), lag_one, effective)
    covariance = variance * inverse @ _gram(jacobians, [_correlated(j, lag_one) for j in jacobians]) @ inverse
    return Scatter((covariance + covariance.T) / 2, float(np.sqrt(variance)), lag_one, effective)


def log_likelihood(residuals: Sequence[FloatArray], lag_one: float) -> float:
    """Return the log-likelihood of residuals, autoregressive within each curve, maximised over their variance."""
    points = sum(len(r) for r in residuals)
    squares = sum((1 - lag_one**2) * r[0] ** 2 + float(np.sum((r[1:] - lag_one * r[:-1]) ** 2)) for r in residuals)
    if squares <= 0:
        return float("inf")
    first_points = len(residuals) / 2 * math.log(1 - lag_one**2)
    return first_points - points / 2 * (math.log(2 * math.pi * squares / points) + 1)


def _basis(jacobians: Sequence[FloatArray]) -> list[FloatArray]:
    """Return orthonormal columns that span the columns of the Jacobian, even if these are linearly dependent."""
    stacked = np.vstack(jacobians)
    norm = np.linalg.norm(stacked, axis=0)
    left, singular, _ = np.linalg.svd(stacked / np.where(norm > 0, norm, 1.0), full_matrices=False)
    columns = left[:, singular > _MIN_SINGULAR_VALUE * singular[0]]
    return np.split(columns, np.cumsum([len(j) for j in jacobians])[:-1])


def _lag_one(basis: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> float:
    """Return the ρ, from 0 to 0.995, at which the expected correlation of the residuals equals the measured one."""
    from scipy.optimize import brentq

    squares = sum(float(r @ r) for r in residuals)
    if squares <= 0:
        return 0.0
    measured = sum(float(r[1:] @ r[:-1]) for r in residuals) / squares
    shifted = _gram(basis, [_shifted(q) for q in basis])

    def excess(lag_one: float) -> float:
        return _expected(basis, shifted, lag_one) - measured

    if excess(0.0) >= 0:
        return 0.0
    if excess(_MAX_CORRELATION) <= 0:
        return _MAX_CORRELATION
    return float(brentq(excess, 0.0, _MAX_CORRELATION, xtol=1e-6))


def _expected(basis: Sequence[FloatArray], shifted: FloatArray, lag_one: float) -> float:
    """Return tr(M S M V)/tr(M V) with M = I − QQᵀ, without computing an n × n matrix for n points."""
    points = sum(len(q) for q in basis)
    correlated = [_correlated(q, lag_one) for q in basis]
    qvq = _gram(basis, correlated)
    qsvq = _gram(basis, [_shifted(columns) for columns in correlated])
    numerator = (points - len(basis)) * lag_one + float(np.sum(shifted * qvq.T) - 2 * np.trace(qsvq))
    return numerator / (points - float(np.trace(qvq)))


def _gram(left: Sequence[FloatArray], right: Sequence[FloatArray]) -> FloatArray:
    """Return the sum of LᵀR over the curves."""
    total = np.zeros((left[0].shape[1], right[0].shape[1]))
    for a, b in zip(left, right, strict=True):
        total += a.T @ b
    return total


def _shifted(columns: FloatArray) -> FloatArray:
    """Return S times columns: half of the sum of the two neighbours of each point."""
    shifted = np.zeros_like(columns)
    shifted[1:] += columns[:-1] / 2
    shifted[:-1] += columns[1:] / 2
    return shifted


def _correlated(columns: FloatArray, lag_one: float) -> FloatArray:
    """Return V times columns, V_ij = ρ^|i−j|, by one recursive filter in each direction."""
    from scipy.signal import lfilter

    if lag_one == 0:
        return columns
    forward = lfilter([1.0], [1.0, -lag_one], columns, axis=0)
    backward = lfilter([1.0], [1.0, -lag_one], columns[::-1], axis=0)[::-1]
    return np.asarray(forward + backward - columns)


def _inverse(normal: FloatArray) -> FloatArray | None:
    """Return the inverse of a normal matrix, scaled for units of different orders; None if the matrix is singular."""
    scale = np.sqrt(np.diag(normal))
    if not np.isfinite(normal).all() or (scale == 0).any():
        return None
    scaled = normal / np.outer(scale, scale)
    if np.linalg.cond(scaled) > _MAX_CONDITION:
        return None
    return np.asarray(np.linalg.inv(scaled) / np.outer(scale, scale))

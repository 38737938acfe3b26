"""Weighted least squares for a formula, and the covariance from independent and shared errors.

The weights are computed from the independent errors. The part of the covariance due to shared errors with covariance V
is G V Gᵀ, where G contains the derivatives of the parameters with respect to the points. The independent part is
widened if scatter, or correlation of neighbours, shows that the specified uncertainties are too small.

`points_of` and `solved` are used by `solen.material.index.fit`.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.formulas import Form, UnfitError
from solen.units import NM_PER_UM

_MAX_ITERATIONS = 50
_SIGNIFICANCE = 0.01  # p-value below which the scatter exceeds the specified uncertainties
_SIGNIFICANT_SIGMAS = 2.33  # standard deviations above which a correlation of neighbours is significant


@dataclass(frozen=True)
class Points:
    """Points used in a fit, in ascending order of wavelength."""

    um: FloatArray
    n: FloatArray
    u: FloatArray | None
    shared: FloatArray  # (rows, points)
    order: NDArray[np.intp]  # position of each point among the input points
    count: int  # of the input points

    @property
    def weights(self) -> FloatArray:
        """Factors by which the residuals are multiplied: 1/u, or 1 if u is unknown."""
        return np.ones_like(self.n) if self.u is None else 1 / self.u


@dataclass(frozen=True)
class LeastSquaresFit:
    """A fitted formula, with its inner parameters and their covariance."""

    form: Form
    inner: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    chi2: float
    neighbours: float
    widened: float

    @property
    def df(self) -> int:
        """Degrees of freedom: number of points minus number of parameters."""
        return int(self.residuals.size - self.inner.size)


def points_of(wavelength_nm: ArrayLike, n: ArrayLike, u_n: ArrayLike | None, shared: ArrayLike | None) -> Points:
    """Return the points without missing values.

    Raises
    ------
    DataError
        If shapes do not match, or an uncertainty or a wavelength is not positive.
    """
    nm, values = (np.atleast_1d(np.asarray(array, dtype=float)) for array in (wavelength_nm, n))
    if nm.shape != values.shape or nm.ndim != 1:
        shapes = f"{nm.shape} wavelengths, {values.shape} indices"
        raise DataError("shapes of the points", value=shapes, limit="must be one-dimensional and of equal length")
    u = None if u_n is None else np.broadcast_to(np.asarray(u_n, dtype=float), nm.shape)
    rows = np.zeros((0, nm.size)) if shared is None else np.atleast_2d(np.asarray(shared, dtype=float))
    rows = np.broadcast_to(rows, (rows.shape[0], nm.size))
    complete = np.isfinite(values) & np.isfinite(nm) & np.isfinite(rows).all(axis=0)
    if u is not None:
        complete &= np.isfinite(u)
        if (u[complete] <= 0).any():
            raise DataError(
                "u_n", value=float(u[complete].min()), limit="must be above 0", remedy="omit u_n if unknown"
            )
    if (nm[complete] <= 0).any():
        raise DataError("wavelength", value=float(nm[complete].min()), limit="must be above 0 nm")
    order = np.flatnonzero(complete)[np.argsort(nm[complete], kind="stable")]
    return Points(nm[order] / NM_PER_UM, values[order], None if u is None else u[order], rows[:, order], order, nm.size)


def solved(form: Form, points: Points) -> LeastSquaresFit:
    """Return the weighted least-squares fit, by Gauss-Newton steps; raise `UnfitError` if the formula does not fit."""
    inner = form.start(points.um, points.n, points.weights)
    for _ in range(_MAX_ITERATIONS):
        improved = _improved(form, inner, points)
        if improved is None:
            break
        inner = improved
    form.check(inner)
    value, slope = form.value(inner)
    residuals = points.n - value
    if not np.isfinite(residuals).all():
        raise UnfitError("does not converge")
    return _with_covariance(form, inner, slope, residuals, points)


def _improved(form: Form, inner: FloatArray, points: Points) -> FloatArray | None:
    """Return parameters with a smaller sum of squares, after a full or shorter Gauss-Newton step; None if none."""
    weights = points.weights
    value, slope = form.value(inner)
    residuals = weights * (points.n - value)
    cost = float(residuals @ residuals)
    if not np.isfinite(slope).all():
        return None
    step = np.linalg.lstsq(weights[:, None] * slope, residuals, rcond=None)[0]
    if np.abs(step).max() <= 1e-15 * (1 + np.abs(inner).max()):
        return None
    for fraction in (1.0, 0.25, 0.05):
        residuals = weights * (points.n - form.value(inner + fraction * step)[0])
        if float(residuals @ residuals) < cost:
            return np.asarray(inner + fraction * step)
    return None


def _with_covariance(
    form: Form, inner: FloatArray, slope: FloatArray, residuals: FloatArray, points: Points
) -> LeastSquaresFit:
    """Return the fit with its covariance: the independent part, widened if necessary, plus the shared part."""
    weights = points.weights
    q, r = np.linalg.qr(weights[:, None] * slope)
    scale = np.abs(np.diag(r))
    if scale.min() <= 1e-10 * scale.max():
        raise UnfitError("is not determined by these points")
    response = np.linalg.solve(r, q.T) * weights  # (parameters, points): derivatives of the parameters
    chi2 = float(np.sum((weights * residuals) ** 2))
    df = residuals.size - inner.size
    neighbours = _neighbour_correlation(weights * residuals)
    variance = _variance_factor(chi2, df, has_u=points.u is not None)
    if neighbours > _SIGNIFICANT_SIGMAS / math.sqrt(residuals.size):
        variance = max(variance, chi2 / df * (1 + neighbours) / (1 - neighbours))
    root, shared = np.linalg.inv(r), response @ points.shared.T
    covariance = variance * root @ root.T + shared @ shared.T
    form.check_covariance(inner, covariance)
    return LeastSquaresFit(form, inner, covariance, residuals, chi2, neighbours, math.sqrt(variance))


def _neighbour_correlation(weighted: FloatArray) -> float:
    """Return the correlation of neighbouring residuals."""
    total = float(np.sum(weighted**2))
    return min(float(np.sum(weighted[1:] * weighted[:-1])) / total, 0.99) if total > 0 else 0.0


def _variance_factor(chi2: float, df: int, *, has_u: bool) -> float:
    """Return the factor on the specified variances, or the variance of the scatter if none are specified."""
    from scipy.special import gammaincc

    ratio = chi2 / df
    if not has_u:
        return ratio
    return ratio if gammaincc(df / 2, chi2 / 2) < _SIGNIFICANCE else 1.0

"""Weighted least squares for a formula, and the covariance from independent and shared errors.

The weights are computed from the independent errors. Shared errors enter the covariance through the same weights, G V
Gᵀ with G the linear response of the parameters to the points. The independent part is widened if scatter or correlation
of neighbours shows that the specified uncertainties are too small.

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

_STEPS = 50
_SURE = 0.01  # probability below which scatter exceeds the stated uncertainties
_SIGMA = 2.33  # the same for a correlation of neighbours, in standard deviations


@dataclass(frozen=True)
class Points:
    """Points used in a fit, by ascending wavelength."""

    um: FloatArray
    n: FloatArray
    u: FloatArray | None
    shared: FloatArray  # (rows, points)
    order: NDArray[np.intp]  # index of each point among the supplied points
    given: int

    @property
    def weights(self) -> FloatArray:
        """Factors of the residuals."""
        return np.ones_like(self.n) if self.u is None else 1 / self.u


@dataclass(frozen=True)
class Solved:
    """A fitted formula, in its inner parameters."""

    form: Form
    inner: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    chi2: float
    neighbours: float
    widened: float

    @property
    def freedom(self) -> int:
        """Number of points minus number of parameters."""
        return int(self.residuals.size - self.inner.size)


def points_of(wavelength_nm: ArrayLike, n: ArrayLike, u_n: ArrayLike | None, shared: ArrayLike | None) -> Points:
    """Return the points to be fitted, which are those without a missing value.

    Raises
    ------
    DataError
        If shapes do not match, or an uncertainty or a wavelength is not positive.
    """
    nm, values = (np.atleast_1d(np.asarray(one, dtype=float)) for one in (wavelength_nm, n))
    if nm.shape != values.shape or nm.ndim != 1:
        raise DataError(
            "fit", value=f"{nm.shape} wavelengths, {values.shape} indices", limit="must be rows of equal length"
        )
    u = None if u_n is None else np.broadcast_to(np.asarray(u_n, dtype=float), nm.shape)
    rows = np.zeros((0, nm.size)) if shared is None else np.atleast_2d(np.asarray(shared, dtype=float))
    rows = np.broadcast_to(rows, (rows.shape[0], nm.size))
    there = np.isfinite(values) & np.isfinite(nm) & np.isfinite(rows).all(axis=0)
    if u is not None:
        there &= np.isfinite(u)
        if (u[there] <= 0).any():
            raise DataError("u_n", value=float(u[there].min()), limit="must be above 0", remedy="omit it if unknown")
    if (nm[there] <= 0).any():
        raise DataError("wavelength", value=float(nm[there].min()), limit="must be above 0 nm")
    order = np.flatnonzero(there)[np.argsort(nm[there], kind="stable")]
    return Points(nm[order] / NM_PER_UM, values[order], None if u is None else u[order], rows[:, order], order, nm.size)


def solved(form: Form, points: Points) -> Solved:
    """Return the weighted least-squares fit, by Gauss-Newton steps; `UnfitError` if the formula does not fit."""
    inner = form.start(points.um, points.n, points.weights)
    for _ in range(_STEPS):
        better = _stepped(form, inner, points)
        if better is None:
            break
        inner = better
    form.check(inner)
    value, slope = form.value(inner)
    residuals = points.n - value
    if not np.isfinite(residuals).all():
        raise UnfitError("does not converge")
    return _with_covariance(form, inner, slope, residuals, points)


def _stepped(form: Form, inner: FloatArray, points: Points) -> FloatArray | None:
    """Return parameters with a smaller sum of squares, after a full or shortened Gauss-Newton step, or None."""
    weights = points.weights
    value, slope = form.value(inner)
    wanted = weights * (points.n - value)
    cost = float(wanted @ wanted)
    if not np.isfinite(slope).all():
        return None
    step = np.linalg.lstsq(weights[:, None] * slope, wanted, rcond=None)[0]
    if np.abs(step).max() <= 1e-15 * (1 + np.abs(inner).max()):
        return None
    for part in (1.0, 0.25, 0.05):
        off = weights * (points.n - form.value(inner + part * step)[0])
        if float(off @ off) < cost:
            return np.asarray(inner + part * step)
    return None


def _with_covariance(form: Form, inner: FloatArray, slope: FloatArray, residuals: FloatArray, points: Points) -> Solved:
    """Return the covariance of the inner parameters: independent part, widened if necessary, plus shared part."""
    weights = points.weights
    q, r = np.linalg.qr(weights[:, None] * slope)
    scale = np.abs(np.diag(r))
    if scale.min() <= 1e-10 * scale.max():
        raise UnfitError("is not determined by these points")
    taken = np.linalg.solve(r, q.T) * weights  # (parameters, points): derivatives of the parameters
    chi2 = float(np.sum((weights * residuals) ** 2))
    freedom = residuals.size - inner.size
    neighbours = _neighbours(weights * residuals)
    variance = _excess(chi2, freedom, points.u is not None)
    if neighbours > _SIGMA / math.sqrt(residuals.size):
        variance = max(variance, chi2 / freedom * (1 + neighbours) / (1 - neighbours))
    own = np.linalg.inv(r)
    covariance = variance * own @ own.T + (taken @ points.shared.T) @ (taken @ points.shared.T).T
    form.check_covariance(inner, covariance)
    return Solved(form, inner, covariance, residuals, chi2, neighbours, math.sqrt(variance))


def _neighbours(weighted: FloatArray) -> float:
    """Return the correlation of each residual with the next."""
    total = float(np.sum(weighted**2))
    return min(float(np.sum(weighted[1:] * weighted[:-1])) / total, 0.99) if total > 0 else 0.0


def _excess(chi2: float, freedom: int, stated: bool) -> float:
    """Return the factor on the specified variances, or the scatter itself if none are specified."""
    from scipy.special import gammaincc

    ratio = chi2 / freedom
    if not stated:
        return ratio
    return ratio if gammaincc(freedom / 2, chi2 / 2) < _SURE else 1.0

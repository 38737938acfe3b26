"""Simultaneous fits of many blurred steps: grey values along lines that each cross one or two edges.

    I(t) = level + slope t + Σ rise_k · ½ [1 + erf((t − at_k) / (√2 blur_k))]

This is the exact profile of a straight edge blurred by a Gaussian of standard deviation ``blur``. Each row of the data
is a separate line; all rows are fitted together by the Levenberg-Marquardt method (see D. W. Marquardt, J. Soc. Indust.
Appl. Math. 11, 431, 1963), each with its own damping.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from solen.arrays import BoolArray, FloatArray

MAX_ITERATIONS = 40
CONVERGED_PX = 1e-4
"""Displacement of the edges below which a fit has converged."""
MIN_BLUR_PX, MAX_BLUR_PX = 0.35, 50.0
"""Limits of the blur. Integration over a pixel alone has a standard deviation of 0.29 px, and interpolation between
pixels adds a little. Below the lower limit, the position of an edge between two samples would be undetermined.
"""
MAX_LOG_BLUR_STEP = 0.3
"""Maximum change of the logarithm of the blur in one iteration."""


@dataclass(frozen=True, eq=False)
class StepPriors:
    """Priors for the lines across one edge, as normal distributions.

    Attributes
    ----------
    log_blur, u_log_blur
        Shape (K,): natural logarithm of the edges' blurs, and its standard deviation from line to line.
    slope_per_px, u_slope_per_px
        Slope of the background, and its standard deviation.
    noise
        Standard deviation of a grey value, which sets the weight of the priors relative to the values.
    """

    log_blur: FloatArray
    u_log_blur: float
    slope_per_px: float
    u_slope_per_px: float
    noise: float

    def of(self, parameters: int) -> tuple[FloatArray, FloatArray]:
        """Return the expected parameters (P,) and weights (P,) in units of the grey values."""
        expected, weight = np.zeros(parameters), np.zeros(parameters)
        expected[1], weight[1] = self.slope_per_px, self.noise / max(self.u_slope_per_px, 1e-12)
        expected[4::3], weight[4::3] = self.log_blur, self.noise / self.u_log_blur
        return expected, weight


@dataclass(frozen=True, eq=False)
class Steps:
    """Fits of N lines with K edges each.

    Attributes
    ----------
    at_px, u_at_px
        Shape (N, K): positions of the edges on their line, and their standard uncertainties from the residuals.
    rise
        Shape (N, K): rise of the grey value at the edge, along the line.
    blur_px
        Shape (N, K): standard deviation of the blur.
    slope_per_px
        Shape (N,): slope of the background.
    noise
        Shape (N,): standard deviation of the residuals.
    converged
        Shape (N,): whether the fit converged.
    """

    at_px: FloatArray
    u_at_px: FloatArray
    rise: FloatArray
    blur_px: FloatArray
    slope_per_px: FloatArray
    noise: FloatArray
    converged: BoolArray


def fit_steps(
    t_px: FloatArray,
    values: FloatArray,
    at_px: FloatArray,
    blur_px: float | FloatArray,
    use: BoolArray,
    priors: StepPriors | None = None,
) -> Steps:
    """Fit the steps of N lines.

    Parameters
    ----------
    t_px
        Shape (M,), positions along the lines.
    values
        Shape (N, M), grey values at these positions.
    at_px
        Shape (N, K), first guesses of the edges.
    blur_px
        First guess of the blur, for all edges or for each (K,).
    use
        Shape (N, M): which values are fitted; at least 2 + 3 K + 1 of each line.
    priors
        Priors of blurs and slope; without them each line is fitted independently.
    """
    weight = use.astype(np.float64)
    values = np.where(use, values, 0.0)
    parameters = _start(t_px, values, at_px, np.broadcast_to(blur_px, at_px.shape[1]), weight)
    expected, prior_weight = (np.zeros(parameters.shape[1]),) * 2 if priors is None else priors.of(parameters.shape[1])
    damping = np.full(len(values), 1e-3)
    residual, jacobian = _model(t_px, values, parameters, weight)
    cost = np.sum(residual**2, axis=1) + np.sum((prior_weight * (parameters - expected)) ** 2, axis=1)
    converged = np.zeros(len(values), dtype=bool)
    for _ in range(MAX_ITERATIONS):
        step = _step(parameters, jacobian, residual, damping, expected, prior_weight)
        trial = _limited(parameters, step, t_px)
        new_residual, new_jacobian = _model(t_px, values, trial, weight)
        new_cost = np.sum(new_residual**2, axis=1) + np.sum((prior_weight * (trial - expected)) ** 2, axis=1)
        better = new_cost <= cost
        moved = np.max(np.abs(trial[:, 3::3] - parameters[:, 3::3]), axis=1)
        converged |= moved < CONVERGED_PX
        parameters = np.where(better[:, None], trial, parameters)
        residual = np.where(better[:, None], new_residual, residual)
        jacobian = np.where(better[:, None, None], new_jacobian, jacobian)
        cost = np.where(better, new_cost, cost)
        damping = np.clip(np.where(better, 0.3 * damping, 8.0 * damping), 1e-9, 1e9)
        if converged.all():
            break
    return _steps(parameters, jacobian, np.sum(residual**2, axis=1), weight, converged, prior_weight)


def _start(t: FloatArray, values: FloatArray, at: FloatArray, blur: FloatArray, weight: FloatArray) -> FloatArray:
    """Return initial parameters: levels and rises by linear least squares at the guessed positions and blur."""
    count, edges = at.shape
    shape = 0.5 * (1.0 + erf((t[None, None, :] - at[:, :, None]) / (np.sqrt(2.0) * blur[:, None])))
    columns = np.concatenate([np.ones((count, 1, len(t))), shape], axis=1) * weight[:, None, :]
    normal = np.einsum("nim,njm->nij", columns, columns) + 1e-9 * np.eye(edges + 1)
    levels = np.linalg.solve(normal, np.einsum("nim,nm->ni", columns, values)[..., None])[..., 0]
    parameters = np.zeros((count, 2 + 3 * edges))
    parameters[:, 0] = levels[:, 0]
    parameters[:, 2::3], parameters[:, 3::3], parameters[:, 4::3] = levels[:, 1:], at, np.log(blur)
    return parameters


def _model(
    t: FloatArray, values: FloatArray, parameters: FloatArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted residuals (N, M), and their derivatives (N, M, P) with respect to the parameters."""
    rise, at, blur = parameters[:, 2::3], parameters[:, 3::3], np.exp(parameters[:, 4::3])
    u = (t[None, None, :] - at[:, :, None]) / blur[:, :, None]
    shape = 0.5 * (1.0 + erf(u / np.sqrt(2.0)))
    gaussian = np.exp(-0.5 * u * u) / np.sqrt(2.0 * np.pi)
    model = parameters[:, :1] + parameters[:, 1:2] * t[None, :] + np.einsum("nk,nkm->nm", rise, shape)
    jacobian = np.empty((*values.shape, parameters.shape[1]))
    jacobian[..., 0], jacobian[..., 1] = 1.0, t[None, :]
    jacobian[..., 2::3] = np.moveaxis(shape, 1, 2)
    jacobian[..., 3::3] = np.moveaxis(-(rise / blur)[:, :, None] * gaussian, 1, 2)
    jacobian[..., 4::3] = np.moveaxis(-rise[:, :, None] * u * gaussian, 1, 2)
    return (values - model) * weight, jacobian * weight[..., None]


def _normal(jacobian: FloatArray, damping: FloatArray, prior_weight: FloatArray) -> FloatArray:
    """Return the normal matrices (N, P, P) including the priors, with their diagonals increased by a fraction."""
    normal = np.matmul(np.swapaxes(jacobian, 1, 2), jacobian) + np.diag(prior_weight**2)
    diagonal = np.einsum("nii->ni", normal)
    floor = 1e-12 * (1.0 + diagonal.max(axis=1, keepdims=True))
    extra = damping[:, None] * diagonal + floor
    return np.asarray(normal + extra[:, :, None] * np.eye(normal.shape[1]))


def _step(
    parameters: FloatArray,
    jacobian: FloatArray,
    residual: FloatArray,
    damping: FloatArray,
    expected: FloatArray,
    prior_weight: FloatArray,
) -> FloatArray:
    """Return steps (N, P); a blur at its limit is kept there so that the other parameters converge."""
    gradient = np.einsum("nmi,nm->ni", jacobian, residual) + prior_weight**2 * (expected - parameters)
    fixed = np.zeros(gradient.shape, dtype=bool)
    blur, change = parameters[:, 4::3], gradient[:, 4::3]
    fixed[:, 4::3] = (blur <= np.log(MIN_BLUR_PX)) & (change < 0.0) | (blur >= np.log(MAX_BLUR_PX)) & (change > 0.0)
    normal = _normal(np.where(fixed[:, None, :], 0.0, jacobian), damping, prior_weight)
    return np.asarray(np.linalg.solve(normal, np.where(fixed, 0.0, gradient)[..., None])[..., 0])


def _limited(parameters: FloatArray, step: FloatArray, t: FloatArray) -> FloatArray:
    """Return the parameters after a step that keeps edges on their line and limits the change of a blur."""
    trial = parameters + step
    trial[:, 3::3] = np.clip(trial[:, 3::3], t[0], t[-1])
    log_step = np.clip(step[:, 4::3], -MAX_LOG_BLUR_STEP, MAX_LOG_BLUR_STEP)
    trial[:, 4::3] = np.clip(parameters[:, 4::3] + log_step, np.log(MIN_BLUR_PX), np.log(MAX_BLUR_PX))
    return trial


def _steps(
    parameters: FloatArray,
    jacobian: FloatArray,
    cost: FloatArray,
    weight: FloatArray,
    converged: BoolArray,
    prior_weight: FloatArray,
) -> Steps:
    freedom = np.maximum(weight.sum(axis=1) - parameters.shape[1], 1.0)
    variance = cost / freedom
    covariance = np.linalg.inv(_normal(jacobian, np.zeros(len(cost)), prior_weight))
    spread = np.sqrt(np.maximum(np.einsum("nii->ni", covariance)[:, 3::3] * variance[:, None], 0.0))
    return Steps(
        at_px=parameters[:, 3::3],
        u_at_px=spread,
        rise=parameters[:, 2::3],
        blur_px=np.exp(parameters[:, 4::3]),
        slope_per_px=parameters[:, 1],
        noise=np.sqrt(variance),
        converged=converged,
    )

"""Least-squares fit of a few parameters to many pixels, by the Levenberg-Marquardt method with parameter limits.

D. W. Marquardt, J. Soc. Indust. Appl. Math. 11, 431 (1963). The normal matrix is summed without a linear algebra
library: for matrices this small, starting its threads takes more time than they save.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import BoolArray, FloatArray

Model = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Function of the parameters (P,) that returns the values (N,) and their derivatives (N, P)."""

MAX_ITERATIONS = 60
CONVERGED = 1e-6
"""Relative change of the sum of squares below which, twice in succession, a fit has converged."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Least-squares parameters (P,) and their standard uncertainties (P,) from the residuals (N,)."""

    values: FloatArray
    u_values: FloatArray
    residuals: FloatArray


def least_squares(
    model: Model, data: FloatArray, first: Sequence[float], low: Sequence[float], high: Sequence[float]
) -> Fit:
    """Fit a model to data (N,) from start values, within limits; a parameter with equal limits is fixed."""
    lower, upper = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    p = np.clip(np.asarray(first, dtype=float), lower, upper)
    free = upper > lower
    values, slopes = model(p)
    cost, damping, converged = float(np.sum((data - values) ** 2)), 1e-3, 0
    for _ in range(MAX_ITERATIONS):
        normal, gradient = _normal(slopes, data - values, free)
        step = np.zeros(len(p))
        step[free] = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        trial = np.clip(p + step, lower, upper)
        new_values, new_slopes = model(trial)
        new_cost = float(np.sum((data - new_values) ** 2))
        if new_cost < cost:
            converged = converged + 1 if cost - new_cost < CONVERGED * cost else 0
            p, values, slopes, cost = trial, new_values, new_slopes, new_cost
            damping = max(0.2 * damping, 1e-9)
        else:
            damping *= 6.0
        if converged >= 2 or damping > 1e9:
            break
    normal, _ = _normal(slopes, data - values, free)
    u_values = np.zeros(len(p))
    variance = cost / max(len(data) - int(free.sum()), 1)
    u_values[free] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(normal)) * variance, 0.0))
    return Fit(p, u_values, data - values)


def _normal(slopes: FloatArray, residual: FloatArray, free: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the regularised normal matrix of the free parameters, and the gradient."""
    columns = slopes[:, free]
    normal = np.einsum("ni,nj->ij", columns, columns)
    normal[np.diag_indices_from(normal)] += 1e-12 * max(float(np.trace(normal)), 1e-300)
    return normal, np.einsum("ni,n->i", columns, residual)

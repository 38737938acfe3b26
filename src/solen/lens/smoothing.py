"""A curve through uncertain points that is as smooth as their uncertainty allows.

P-splines (P. H. C. Eilers & B. D. Marx, Statistical Science 11, 89, 1996): a cubic B-spline with more knots than
necessary, and a penalty on the third differences of its coefficients. The penalty strength follows from the points
themselves by restricted maximum likelihood (S. N. Wood, J. R. Stat. Soc. B 73, 3, 2011), which interprets independent
differences between points as noise. It would interpret correlated errors of neighbouring points, such as those of a
blurred edge, as shape; so the curve is smoothed further, if necessary, until its residuals match the specified
uncertainty (V. A. Morozov's discrepancy principle).

`smooth_curve` returns a `SmoothCurve`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray
from solen.results import HIDDEN, Result, reported

DEGREE, ORDER = 3, 3
"""Degree of the spline's pieces, and order of the penalised differences; a parabola is not penalised."""
MAX_SPANS, POINTS_PER_SPAN = 200, 3
WEAKEST, STRONGEST, STEPS = -10.0, 10.0, 161
"""Base-10 logarithms of the weakest and the strongest penalty that are tried, relative to the weight of the data, and
the number of penalties.
"""


class SmoothCurve(Result):
    """Smoothed values as a function of length.

    Attributes
    ----------
    spline
        Returns values at positions between the first and the last, or their derivatives of the order in its second
        argument.
    length_mm
        Length from the first position to the last.
    parameters
        Effective number of parameters: the trace of the matrix that converts values to smoothed values.
    residual
        RMS of the residuals, each in units of its standard uncertainty.
    """

    spline: Callable[..., FloatArray] = field(metadata=HIDDEN)
    length_mm: float
    parameters: float
    residual: float

    @reported
    def resolution_mm(self) -> float:
        """Length over which values are averaged: the total length divided by the number of parameters."""
        return self.length_mm / self.parameters


@dataclass(frozen=True, eq=False)
class _Penalised:
    """Normal equations for all penalty strengths at once, in the basis in which data and penalty are both diagonal.

    ``data`` (K,) are the fractional weights of the data, ``right`` (K,) is the right-hand side; ``basis`` (K, K)
    converts the solution to the coefficients. ``squares`` is the weighted sum of the squared values, ``count`` their
    number.
    """

    data: FloatArray
    right: FloatArray
    basis: FloatArray
    squares: float
    count: int

    def matrix(self, strength: float) -> FloatArray:
        return self.data + strength * (1.0 - self.data)

    def coefficients(self, strength: float) -> FloatArray:
        return np.asarray(self.basis @ (self.right / self.matrix(strength)))

    def parameters(self, strength: float) -> float:
        return float(np.sum(self.data / self.matrix(strength)))

    def residuals(self, strength: float) -> float:
        """Return the sum of the squares of the weighted residuals."""
        solution = self.right / self.matrix(strength)
        return max(float(self.squares - 2.0 * solution @ self.right + self.data @ solution**2), 0.0)

    def deviance(self, strength: float) -> float:
        """Return minus twice the restricted log-likelihood, up to a constant, at the best scale of the noise."""
        free, penalised = self.count - ORDER, self.data.size - ORDER
        matrix = self.matrix(strength)
        squares = max(float(self.squares - self.right @ (self.right / matrix)), 1e-300)
        return float(free * np.log(squares) + np.log(matrix).sum() - penalised * np.log(strength))


def smooth_curve(position: FloatArray, value: FloatArray, u: FloatArray) -> SmoothCurve:
    """Return a smooth curve through at least 16 values (N,) with standard uncertainties (N,) above 0.

    The positions (N,) must be in ascending order.
    """
    from scipy.interpolate import BSpline
    from scipy.sparse import diags_array

    spans = int(np.clip(position.size // POINTS_PER_SPAN, 4, MAX_SPANS))
    inner = np.linspace(position[0], position[-1], spans + 1)
    width = inner[1] - inner[0]
    knots = np.concatenate([inner[0] - width * np.arange(DEGREE, 0, -1), inner, inner[-1] + width * np.arange(1, 4)])
    clipped = np.clip(position, inner[0], inner[-1])
    weighted = diags_array(1.0 / u) @ BSpline.design_matrix(clipped, knots, DEGREE)
    normal = (weighted.T @ weighted).toarray()
    fit = _penalised(normal, np.asarray(weighted.T @ (value / u)), float(np.sum((value / u) ** 2)), position.size)
    strength = max(_most_likely(fit), _strongest_within(fit))
    residual = float(np.sqrt(fit.residuals(strength) / position.size))
    spline = BSpline(knots, fit.coefficients(strength), DEGREE)
    return SmoothCurve(spline, float(position[-1] - position[0]), fit.parameters(strength), residual)


def _penalised(normal: FloatArray, right: FloatArray, squares: float, count: int) -> _Penalised:
    from scipy.linalg import cholesky, eigh, solve_triangular

    differences = np.diff(np.eye(len(normal)), ORDER, axis=0)
    penalty = differences.T @ differences
    penalty *= np.trace(normal) / np.trace(penalty)
    root = cholesky(normal + penalty, lower=True)
    inner = solve_triangular(root, solve_triangular(root, normal, lower=True).T, lower=True)
    data, vectors = eigh(0.5 * (inner + inner.T))
    basis = solve_triangular(root.T, vectors, lower=False)
    return _Penalised(np.clip(data, 0.0, 1.0), np.asarray(basis.T @ right), np.asarray(basis), squares, count)


STRENGTHS = [float(strength) for strength in np.logspace(WEAKEST, STRONGEST, STEPS)]


def _most_likely(fit: _Penalised) -> float:
    """Return the penalty strength that maximises the restricted likelihood."""
    return min(STRENGTHS, key=fit.deviance)


def _strongest_within(fit: _Penalised) -> float:
    """Return the largest penalty strength whose residuals do not exceed the uncertainties, or 0 if all do."""
    return max((strength for strength in STRENGTHS if fit.residuals(strength) <= fit.count), default=0.0)

"""A spline that approximates a curve defined by a function: a bent wall, an ellipse, an offset curve.

Cubic pieces agree with the curve in position and velocity at their ends (Hermite), and are halved until the points at
one, two and three quarters of every piece are within a tolerance. The error of a piece falls with the fourth power of
its length. `displaced_spline` makes such a spline from a curve whose points are all displaced, by a bend or by a load.
"""

from collections.abc import Callable, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import MAX_POINTS, Curve
from solen.curve.chain import CubicChain
from solen.curve.spline import Spline
from solen.errors import DesignError

Function = Callable[[FloatArray], FloatArray]
Displacement = Callable[[Curve, float, float], tuple[Function, Function, Sequence[float] | FloatArray]]
"""Function that displaces a piece without corners. It is called with the piece and with the parameters of the entire
curve at the two ends of the piece. It returns the displaced positions and velocities as functions of the parameter of
the piece, and the values of this parameter at which cubics must end.
"""

MARGIN = 0.5
"""Fraction of the tolerance allowed at the sampled points; between them the error is barely larger."""


def fitted_spline(
    position: Function, velocity: Function, tolerance_mm: float, breaks: Sequence[float] | FloatArray = (0.0, 1.0)
) -> Spline:
    """Return a spline within ``tolerance_mm`` of ``position(u)``.

    Parameters
    ----------
    position, velocity
        Functions of parameters (N,) that return points (N, 2) in mm, and their derivatives.
    tolerance_mm
        Largest distance between spline and curve at the same parameter.
    breaks
        Parameters at which pieces must end, in ascending order and including both ends of the range.

    Raises
    ------
    DesignError
        If the spline would need more than 65,536 pieces, or a piece has zero length or a cusp.
    """
    ends = np.asarray(breaks, dtype=float)
    while True:
        points, per_u = position(ends), velocity(ends)
        handle = np.diff(ends)[:, None] / 3.0
        start, end = points[:-1], points[1:]
        controls = np.stack([start, start + handle * per_u[:-1], end - handle * per_u[1:], end], axis=1)
        rough = _error_mm(controls, ends, position) > MARGIN * tolerance_mm
        if not rough.any():
            control_points = np.vstack([controls[0, :1], controls[:, 1:].reshape(-1, 2)])
            return Spline(tuple((float(x), float(z)) for x, z in control_points))
        if len(ends) > MAX_POINTS:
            raise DesignError("tolerance_mm", value=tolerance_mm, limit=f"would need more than {MAX_POINTS} segments")
        ends = np.sort(np.concatenate([ends, (0.5 * (ends[:-1] + ends[1:]))[rough]]))


def displaced_spline(curve: Curve, displace: Displacement, tolerance_mm: float) -> Spline:
    """Return the spline of a curve whose points are displaced; each cubic of a chain is separate, to keep corners."""
    pieces: list[Curve] = [curve]
    if isinstance(curve, CubicChain):
        pieces = [Spline(control) for control in curve.controls]
    n = len(pieces)
    displaced = [displace(piece, i / n, (i + 1) / n) for i, piece in enumerate(pieces)]
    return Spline.chained(
        [fitted_spline(position, velocity, tolerance_mm, breaks) for position, velocity, breaks in displaced]
    )


def _error_mm(controls: FloatArray, ends: FloatArray, position: Function) -> FloatArray:
    """Return the largest distance (N,) of each piece from the curve at one, two and three quarters of the piece."""
    errors = []
    for v in (0.25, 0.5, 0.75):
        w = 1.0 - v
        weights = np.array([w**3, 3.0 * w * w * v, 3.0 * w * v * v, v**3])
        piece = np.einsum("k,nkd->nd", weights, controls)
        errors.append(np.hypot(*(piece - position(w * ends[:-1] + v * ends[1:])).T))
    return np.asarray(np.max(errors, axis=0))

"""A spline that approximates a curve given by a function: a bent wall, an ellipse, an offset.

Cubic pieces that agree with it in place and velocity at their ends (Hermite), halved until the middle and the quarters
of every piece lie within a tolerance. The error of a piece falls with the fourth power of its length. `carried` makes
such a spline of a curve all of whose points move elsewhere: by a bend, or by a load.
"""

from collections.abc import Callable, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import MOST_POINTS, Curve
from solen.curve.chain import CubicChain
from solen.curve.spline import Spline
from solen.errors import DesignError

Function = Callable[[FloatArray], FloatArray]
Carry = Callable[[Curve, float, float], tuple[Function, Function, Sequence[float] | FloatArray]]
"""Of a piece without corners, from one parameter of the whole to another: places and velocities by its own parameter,
and where pieces end in any case."""

MARGIN = 0.5
"""Share of the tolerance that the places looked at may use up: between them the error is hardly larger."""


def fitted(
    place: Function, velocity: Function, tolerance_mm: float, breaks: Sequence[float] | FloatArray = (0.0, 1.0)
) -> Spline:
    """Spline within ``tolerance_mm`` of ``place(u)``.

    Parameters
    ----------
    place, velocity
        Points (N, 2) in mm at parameters (N,), and their derivatives by the parameter.
    tolerance_mm
        How far the spline may be from the place of the same parameter.
    breaks
        Parameters, ascending from first to last, at which pieces end in any case.

    Raises
    ------
    DesignError
        If it would take more than 65,536 pieces, or a piece has no length or a cusp.
    """
    ends = np.asarray(breaks, dtype=float)
    while True:
        at, per_u = place(ends), velocity(ends)
        handle = np.diff(ends)[:, None] / 3.0
        controls = np.stack([at[:-1], at[:-1] + handle * per_u[:-1], at[1:] - handle * per_u[1:], at[1:]], axis=1)
        rough = _error_mm(controls, ends, place) > MARGIN * tolerance_mm
        if not rough.any():
            points = np.vstack([controls[0, :1], controls[:, 1:].reshape(-1, 2)])
            return Spline(tuple((float(x), float(z)) for x, z in points))
        if len(ends) > MOST_POINTS:
            raise DesignError("tolerance_mm", value=tolerance_mm, limit=f"would take more than {MOST_POINTS} pieces")
        ends = np.sort(np.concatenate([ends, (0.5 * (ends[:-1] + ends[1:]))[rough]]))


def carried(curve: Curve, carry: Carry, tolerance_mm: float) -> Spline:
    """Spline of a curve whose points are carried elsewhere; of a chain every cubic apart, so that corners stay."""
    pieces: list[Curve] = [curve]
    if isinstance(curve, CubicChain):
        pieces = [Spline(control) for control in curve.controls]
    n = len(pieces)
    followed = [carry(piece, i / n, (i + 1) / n) for i, piece in enumerate(pieces)]
    return Spline.chained([fitted(place, velocity, tolerance_mm, breaks) for place, velocity, breaks in followed])


def _error_mm(controls: FloatArray, ends: FloatArray, place: Function) -> FloatArray:
    """Largest distance (N,) of each piece from its places at the quarters."""
    errors = []
    for v in (0.25, 0.5, 0.75):
        w = 1.0 - v
        weights = np.array([w**3, 3.0 * w * w * v, 3.0 * w * v * v, v**3])
        piece = np.einsum("k,nkd->nd", weights, controls)
        errors.append(np.hypot(*(piece - place(w * ends[:-1] + v * ends[1:])).T))
    return np.asarray(np.max(errors, axis=0))

"""Exact plane curves, of which every face of a body, every mirror and every receiver is made.

A curve is directed, from its start to its end; *left* and its left normal are meant as seen walking along it. Nothing
is meshed: a ray meets the curve itself, at the roots of its equation. A ray that has just left a curve knows one root
already (the one it stands on); ``leaving=True`` divides that root out algebraically, so no distance threshold is
needed and no second hit is lost however close it is.

Interface: `Curve` with its leaves `Segment`, `Arc`, `Parabola`, `Conic`, `CartesianOval`, `Bezier` and `Spline`;
`solen.plane.Rigid` moves them. The last two are chains of cubics, which `simple_pieces` splits into a few `Piece` each.
`Measure` finds lengths along a curve; `fitted` approximates any other curve by a spline, `carried` one
whose points move elsewhere.
Coordinates are (x, z) in mm.
"""

from solen.curve.arc import Arc
from solen.curve.base import (
    END_TOLERANCE_MM,
    MOST_POINTS,
    ROUNDING,
    SMALL,
    Curve,
    check_axis,
    check_count,
    check_numbers,
    check_points,
    check_range,
    quadratic_roots,
)
from solen.curve.chain import CubicChain
from solen.curve.conic import Conic, Parabola
from solen.curve.cubic import Piece, cut, simple_pieces
from solen.curve.hermite import Function, carried, fitted
from solen.curve.length import Measure
from solen.curve.oval import CartesianOval
from solen.curve.segment import Segment
from solen.curve.spline import Bezier, Spline

__all__ = [
    "END_TOLERANCE_MM",
    "MOST_POINTS",
    "ROUNDING",
    "SMALL",
    "Arc",
    "Bezier",
    "CartesianOval",
    "Conic",
    "CubicChain",
    "Curve",
    "Function",
    "Measure",
    "Parabola",
    "Piece",
    "Segment",
    "Spline",
    "carried",
    "check_axis",
    "check_count",
    "check_numbers",
    "check_points",
    "check_range",
    "cut",
    "fitted",
    "quadratic_roots",
    "simple_pieces",
]

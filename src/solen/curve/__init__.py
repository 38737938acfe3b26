"""Exact plane curves, which make up the faces of bodies, mirrors and receivers.

A curve is directed from start to end; *left* and left normal are as seen in that direction. No mesh is used:
intersections are the roots of the curve's equation. If a ray leaves a curve, one root (its start) is already known;
``leaving=True`` divides that root out algebraically, so no distance threshold is needed and no second intersection is
lost, however close.

Public names: `Curve` with its subclasses `Segment`, `Arc`, `Parabola`, `Conic`, `CartesianOval`, `Bezier` and `Spline`;
`solen.plane.Rigid` moves them. The last two are chains of cubics, each of which `simple_pieces` splits into a few
`Piece` objects. `ArcLength` is the length along a curve; `fitted_spline` approximates a curve defined by a function,
and `displaced_spline` one whose points are displaced. Coordinates are (x, z) in mm.
"""

from solen.curve.arc import Arc
from solen.curve.base import (
    END_TOLERANCE_MM,
    MAX_POINTS,
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
from solen.curve.hermite import Function, displaced_spline, fitted_spline
from solen.curve.length import ArcLength
from solen.curve.oval import CartesianOval
from solen.curve.segment import Segment
from solen.curve.spline import Bezier, Spline

__all__ = [
    "END_TOLERANCE_MM",
    "MAX_POINTS",
    "ROUNDING",
    "SMALL",
    "Arc",
    "ArcLength",
    "Bezier",
    "CartesianOval",
    "Conic",
    "CubicChain",
    "Curve",
    "Function",
    "Parabola",
    "Piece",
    "Segment",
    "Spline",
    "check_axis",
    "check_count",
    "check_numbers",
    "check_points",
    "check_range",
    "cut",
    "displaced_spline",
    "fitted_spline",
    "quadratic_roots",
    "simple_pieces",
]

"""Shapes of drawing programs as curves: ellipses, and Bézier pieces up to degree 3."""

import math
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Bezier, Curve, Segment, Spline, cut, fitted
from solen.plane import Point, cross, dot, minus

SHAPE_TOLERANCE_MM = 1e-8
"""Tolerance of the spline that replaces an ellipse, or a spline that is rational or of a degree above 3."""
ROUND = 1e-9
"""Half axes this near in length and this square to each other, relative to their length, are those of a circle."""
STILL = 1e-9
"""A handle this near to its end, relative to the piece, leaves no direction there."""
CUT_OFF = 1e-4
"""Share of such a piece that becomes a straight bit; it deviates by the third power of it."""

Control = tuple[Point, Point, Point, Point]


def ellipse(center: Point, u: Point, v: Point, start: float, sweep: float) -> Curve:
    """Part of ``center + u cos a + v sin a`` for a from ``start`` on by ``sweep`` (radians): an arc if it is round."""
    long = math.hypot(*u)
    if abs(long - math.hypot(*v)) <= ROUND * long and abs(dot(u, v)) <= ROUND * long * long:
        way = math.copysign(1.0, cross(u, v))
        first = math.degrees(math.atan2(u[1], u[0]) + way * start)
        return Arc(center, long, first, max(-360.0, min(360.0, math.degrees(way * sweep))))
    middle, axes = np.asarray(center), np.array([u, v])

    def place(share: FloatArray) -> FloatArray:
        angle = start + share * sweep
        return np.asarray(middle + np.column_stack([np.cos(angle), np.sin(angle)]) @ axes)

    def velocity(share: FloatArray) -> FloatArray:
        angle = start + share * sweep
        return np.asarray(sweep * np.column_stack([-np.sin(angle), np.cos(angle)]) @ axes)

    return fitted(place, velocity, SHAPE_TOLERANCE_MM, tuple(np.linspace(0.0, 1.0, 5)))


def beziers(pieces: Sequence[Sequence[Point]]) -> Curve | None:
    """Curve of Bézier pieces of degree 1 to 3, each starting where the one before ends; None if it has no length."""
    cubics = [cubic for piece in pieces for cubic in _moving(_raised(piece))]
    if not cubics:
        return None
    if len(cubics) == 1:
        return Segment(cubics[0][0], cubics[0][3]) if _straight(cubics[0]) else Bezier(*cubics[0])
    return Spline.of(cubics)


def _raised(piece: Sequence[Point]) -> Control:
    """The same piece as a cubic."""
    if len(piece) == 2:
        a, d = piece
        return (a, _between(a, d, 1 / 3), _between(a, d, 2 / 3), d)
    if len(piece) == 3:
        a, b, d = piece
        return (a, _between(a, b, 2 / 3), _between(d, b, 2 / 3), d)
    a, b, c, d = piece
    return (a, b, c, d)


def _between(a: Point, b: Point, share: float) -> Point:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))


def _moving(cubic: Control) -> list[Control]:
    """Pieces that move at both ends: where a handle lies on its end, that end becomes a short straight bit."""
    a, b, c, d = cubic
    size = max(math.dist(a, point) for point in (b, c, d))
    if size == 0.0:
        return []
    if _straight(cubic):
        return [_raised((a, d))] if a != d else []
    first: list[Control] = []
    last: list[Control] = []
    if math.dist(a, b) <= STILL * size:
        bit, cubic = cut(cubic, CUT_OFF)
        first = [_raised((a, bit[3]))]
    if math.dist(c, d) <= STILL * size:
        cubic, bit = cut(cubic, 1.0 - CUT_OFF)
        last = [_raised((bit[0], d))]
    return [*first, cubic, *last]


def _straight(cubic: Control) -> bool:
    """Whether all of a piece lies on its chord and goes along it."""
    a, b, c, d = cubic
    chord = minus(d, a)
    square = dot(chord, chord)
    if square == 0.0:
        return False
    off = max(abs(cross(chord, minus(handle, a))) for handle in (b, c))
    places = [dot(chord, minus(handle, a)) / square for handle in (b, c)]
    return off <= 1e-15 * square and all(-1e-12 <= place <= 1.0 + 1e-12 for place in places)

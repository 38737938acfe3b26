"""Shapes of drawing programs as curves: ellipses, and Bézier segments up to degree 3."""

import math
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Bezier, Curve, Segment, Spline, cut, fitted
from solen.plane import Point, cross, dot, minus

SHAPE_TOLERANCE_MM = 1e-8
"""Tolerance of the spline that replaces an ellipse, a rational spline or a spline of degree above 3."""
CIRCULAR = 1e-9
"""Half axes count as equal and perpendicular, as in a circle, within this fraction of their length."""
DEGENERATE = 1e-9
"""A handle closer to its end than this fraction of the segment defines no direction there."""
CUT_OFF = 1e-4
"""Fraction of a segment without direction that becomes a short straight line; the deviation is of third order in it."""

Control = tuple[Point, Point, Point, Point]


def ellipse(center: Point, u: Point, v: Point, start: float, sweep: float) -> Curve:
    """Part of ``center + u cos a + v sin a`` for a from ``start`` by ``sweep`` (radians); an arc if it is round."""
    long = math.hypot(*u)
    if abs(long - math.hypot(*v)) <= CIRCULAR * long and abs(dot(u, v)) <= CIRCULAR * long * long:
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
    """Return the curve of connected Bézier segments of degree 1 to 3; None if its length is zero."""
    cubics = [cubic for piece in pieces for cubic in _moving(_raised(piece))]
    if not cubics:
        return None
    if len(cubics) == 1:
        return Segment(cubics[0][0], cubics[0][3]) if _straight(cubics[0]) else Bezier(*cubics[0])
    return Spline.of(cubics)


def _raised(piece: Sequence[Point]) -> Control:
    """Return the same Bézier segment as a cubic."""
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
    """Segments with a direction at both ends; an end that coincides with its handle becomes a short straight line."""
    a, b, c, d = cubic
    size = max(math.dist(a, point) for point in (b, c, d))
    if size == 0.0:
        return []
    if _straight(cubic):
        return [_raised((a, d))] if a != d else []
    first: list[Control] = []
    last: list[Control] = []
    if math.dist(a, b) <= DEGENERATE * size:
        bit, cubic = cut(cubic, CUT_OFF)
        first = [_raised((a, bit[3]))]
    if math.dist(c, d) <= DEGENERATE * size:
        cubic, bit = cut(cubic, 1.0 - CUT_OFF)
        last = [_raised((bit[0], d))]
    return [*first, cubic, *last]


def _straight(cubic: Control) -> bool:
    """Return whether a segment is on its chord and monotonic along it."""
    a, b, c, d = cubic
    chord = minus(d, a)
    square = dot(chord, chord)
    if square == 0.0:
        return False
    off = max(abs(cross(chord, minus(handle, a))) for handle in (b, c))
    places = [dot(chord, minus(handle, a)) / square for handle in (b, c)]
    return off <= 1e-15 * square and all(-1e-12 <= place <= 1.0 + 1e-12 for place in places)

"""Shapes of drawing programs as curves: ellipses, and Bézier segments of up to degree 3."""

import math
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Bezier, Curve, Segment, Spline, cut, fitted_spline
from solen.plane import Point, cross, dot, minus

SHAPE_TOLERANCE_MM = 1e-8
"""Tolerance of the spline that replaces an ellipse, a rational spline or a spline of degree above 3."""
CIRCULAR = 1e-9
"""Semi-axes are treated as equal and perpendicular, as in a circle, within this fraction of their length."""
MIN_HANDLE = 1e-9
"""Minimum distance of a handle from its end, as a fraction of the size of the segment, to define a direction there."""
STRAIGHT_END = 1e-4
"""Fraction of a segment that becomes a straight line at an end without direction; the deviation is of third order."""

Control = tuple[Point, Point, Point, Point]


def ellipse(center: Point, u: Point, v: Point, start: float, sweep: float) -> Curve:
    """Return the curve ``center + u cos a + v sin a`` for a from ``start`` to ``start + sweep`` (radians)."""
    radius = math.hypot(*u)
    if abs(radius - math.hypot(*v)) <= CIRCULAR * radius and abs(dot(u, v)) <= CIRCULAR * radius * radius:
        direction = math.copysign(1.0, cross(u, v))
        first = math.degrees(math.atan2(u[1], u[0]) + direction * start)
        return Arc(center, radius, first, max(-360.0, min(360.0, math.degrees(direction * sweep))))
    middle, axes = np.asarray(center), np.array([u, v])

    def point(fraction: FloatArray) -> FloatArray:
        angle = start + fraction * sweep
        return np.asarray(middle + np.column_stack([np.cos(angle), np.sin(angle)]) @ axes)

    def velocity(fraction: FloatArray) -> FloatArray:
        angle = start + fraction * sweep
        return np.asarray(sweep * np.column_stack([-np.sin(angle), np.cos(angle)]) @ axes)

    return fitted_spline(point, velocity, SHAPE_TOLERANCE_MM, tuple(np.linspace(0.0, 1.0, 5)))


def beziers(segments: Sequence[Sequence[Point]]) -> Curve | None:
    """Return the curve of connected Bézier segments of degree 1 to 3; None if its length is zero."""
    cubics = [cubic for segment in segments for cubic in _with_directions(_as_cubic(segment))]
    if not cubics:
        return None
    if len(cubics) == 1:
        return Segment(cubics[0][0], cubics[0][3]) if _is_straight(cubics[0]) else Bezier(*cubics[0])
    return Spline.of(cubics)


def _as_cubic(segment: Sequence[Point]) -> Control:
    """Return a Bézier segment of degree 1 to 3 as a cubic."""
    if len(segment) == 2:
        a, d = segment
        return (a, _between(a, d, 1 / 3), _between(a, d, 2 / 3), d)
    if len(segment) == 3:
        a, b, d = segment
        return (a, _between(a, b, 2 / 3), _between(d, b, 2 / 3), d)
    a, b, c, d = segment
    return (a, b, c, d)


def _between(a: Point, b: Point, fraction: float) -> Point:
    return (a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1]))


def _with_directions(cubic: Control) -> list[Control]:
    """Return segments with a direction at each end; an end that coincides with its handle becomes a short line."""
    a, b, c, d = cubic
    size = max(math.dist(a, point) for point in (b, c, d))
    if size == 0.0:
        return []
    if _is_straight(cubic):
        return [_as_cubic((a, d))] if a != d else []
    first: list[Control] = []
    last: list[Control] = []
    if math.dist(a, b) <= MIN_HANDLE * size:
        end, cubic = cut(cubic, STRAIGHT_END)
        first = [_as_cubic((a, end[3]))]
    if math.dist(c, d) <= MIN_HANDLE * size:
        cubic, end = cut(cubic, 1.0 - STRAIGHT_END)
        last = [_as_cubic((end[0], d))]
    return [*first, cubic, *last]


def _is_straight(cubic: Control) -> bool:
    """Return whether a segment lies on its chord and is monotonic along it."""
    a, b, c, d = cubic
    chord = minus(d, a)
    squared = dot(chord, chord)
    if squared == 0.0:
        return False
    deviation = max(abs(cross(chord, minus(handle, a))) for handle in (b, c))
    fractions = [dot(chord, minus(handle, a)) / squared for handle in (b, c)]
    return deviation <= 1e-15 * squared and all(-1e-12 <= fraction <= 1.0 + 1e-12 for fraction in fractions)

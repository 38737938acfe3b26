"""Curves defined by formulas: straight lines, circles and cubics are recognised; others become chains of cubics.

A formula can only be evaluated at points. If `CHECKED` points lie on one line, one circle or one cubic of the
parameter, to within rounding error, the curve is taken to be that line, circle or cubic. Otherwise its range is halved
until cubics through four of its points deviate from all others by at most `TOLERANCE` of the curve size. If halving
does not help, there is either a jump, which ray-optics bridges with a straight line, or the end of the formula's
domain, which is an error.
"""

import math
from collections.abc import Callable

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Bezier, Curve, Segment, Spline
from solen.errors import DataError, DesignError
from solen.plane import Point, cross, dot, minus
from solen.scene.rayoptics.fields import MAX_NUMBER

At = Callable[[float], Point]
Control = tuple[Point, Point, Point, Point]

EXACT = 1e-12
"""Deviation, as a fraction of the curve size, that is due to rounding alone."""
TOLERANCE = 1e-7
"""Deviation of a chain of cubics, as a fraction of the curve size."""
CHECKED = np.linspace(0.0, 1.0, 33)
MIN_WIDTH = 1e-9
"""Fraction of the total range below which a part is not halved any further."""
MAX_PIECES = 2000


def fitted(at: At, start: float, end: float, what: str) -> list[Curve]:
    """Fit connected curves to the points that ``at`` returns for parameters from ``start`` to ``end``.

    Raises
    ------
    DataError
        If the formula is undefined or constant, or would need too many pieces; ``what`` names it in the message.
    """
    points = _sampled(at, start, end)
    if not np.all(np.abs(points) <= MAX_NUMBER):
        bad = start + (end - start) * float(CHECKED[int(np.argmin((np.abs(points) <= MAX_NUMBER).all(axis=1)))])
        raise DataError(what, limit=f"is undefined at {bad:g}, but must be defined over its entire range")
    size = float(np.ptp(points, axis=0).max())
    if not size > 0.0:
        raise DataError(what, limit="is constant, so the curve has no length")
    curve = _recognised(points, size)
    return [curve] if curve is not None else _joined(_pieces(at, start, end, size, what), size)


def _sampled(at: At, start: float, end: float) -> FloatArray:
    """Sample 33 points (33, 2) over a range, with its exact ends."""
    return np.array([at(start), *(at(start + (end - start) * float(u)) for u in CHECKED[1:-1]), at(end)])


def _recognised(points: FloatArray, size: float) -> Curve | None:
    """Return the segment, arc or cubic through all points, or None."""
    a, middle, b = (_point(points[i]) for i in (0, len(points) // 2, -1))
    if a != b and _off_line(points, a, b) <= EXACT * size:
        return Segment(a, b)
    arc = _arc(points, a, middle, b, size)
    if arc is not None:
        return arc
    control = _cubic(points)
    if _off_cubic(points, control) > EXACT * size:
        return None
    try:
        return Bezier(*control)
    except DesignError:  # a cusp, or a line traversed in both directions
        return None


def _off_line(points: FloatArray, a: Point, b: Point) -> float:
    """Return the largest distance from a line, which is infinite if the points are not in order along it."""
    along = np.array(minus(b, a)) / math.dist(a, b)
    from_a = points - np.array(a)
    if np.any(np.diff(from_a @ along) <= 0.0):
        return math.inf
    return float(np.abs(from_a[:, 0] * along[1] - from_a[:, 1] * along[0]).max())


def _arc(points: FloatArray, a: Point, middle: Point, b: Point, size: float) -> Arc | None:
    """Return the arc through all points in order, or None."""
    third = _point(points[len(points) // 3])
    try:
        circle = Arc.through(a, third, middle)
    except DesignError:
        return None
    center, radius = circle.center, circle.radius_mm
    if radius > 1e3 * size or np.abs(np.hypot(*(points - np.array(center)).T) - radius).max() > EXACT * 10 * size:
        return None
    steps = [
        math.atan2(cross(p, q), dot(p, q))
        for p, q in zip(points[:-1] - np.array(center), points[1:] - np.array(center), strict=True)
    ]
    if not (all(step > 0.0 for step in steps) or all(step < 0.0 for step in steps)):
        return None
    sweep_deg = math.degrees(math.fsum(steps))
    if abs(abs(sweep_deg) - 360.0) < 1e-6 and math.dist(a, b) < EXACT * 1e3 * size:
        sweep_deg = math.copysign(360.0, sweep_deg)
    from_deg = math.degrees(math.atan2(a[1] - center[1], a[0] - center[0]))
    return Arc(center, radius, from_deg, sweep_deg) if abs(sweep_deg) <= 360.0 else None


def _cubic(points: FloatArray) -> Control:
    """Return the control points of the cubic through the first point, the last point and two points between them."""
    last = len(points) - 1
    inner = np.array([last // 3, last - last // 3])
    v = inner / last
    w = 1.0 - v
    ends = w[:, None] ** 3 * points[0] + v[:, None] ** 3 * points[-1]
    handles = np.linalg.solve(np.column_stack([3 * w**2 * v, 3 * w * v**2]), points[inner] - ends)
    return (_point(points[0]), _point(handles[0]), _point(handles[1]), _point(points[-1]))


def _off_cubic(points: FloatArray, control: Control) -> float:
    """Return the largest distance between a point and the cubic at the same parameter."""
    v = np.linspace(0.0, 1.0, len(points))[:, None]
    a, b, c, d = (np.array(point) for point in control)
    w = 1.0 - v
    return float(np.hypot(*(w**3 * a + 3 * w * v * (w * b + v * c) + v**3 * d - points).T).max())


def _pieces(at: At, start: float, end: float, size: float, what: str) -> list[Curve]:
    """Return consecutive lines, arcs and cubics, obtained by halving the range."""
    curves: list[Curve] = []
    ranges = [(start, end)]
    while ranges:
        low, high = ranges.pop()
        points = _sampled(at, low, high)
        if not np.all(np.abs(points) <= MAX_NUMBER):
            raise DataError(what, limit=f"is undefined near {low:g}, but must be defined over its entire range")
        if high - low <= MIN_WIDTH * (end - start):
            first, last = _point(points[0]), _point(points[-1])
            curves += [] if first == last else [Segment(first, last)]
            continue
        control = _cubic(points)
        if _off_cubic(points, control) <= TOLERANCE * size and _is_smooth(control):
            curves.append(_line_or_cubic(points, control, size))
        else:
            middle = 0.5 * (low + high)
            ranges += [(middle, high), (low, middle)]
        if len(curves) + len(ranges) > MAX_PIECES:
            raise DataError(what, limit=f"requires a curve of more than {MAX_PIECES} pieces")
    return curves


def _is_smooth(control: Control) -> bool:
    """Whether the cubic has a tangent everywhere."""
    try:
        _ = Bezier(*control)
    except DesignError:
        return False
    return True


def _line_or_cubic(points: FloatArray, control: Control, size: float) -> Curve:
    straight = _off_line(points, control[0], control[3]) <= EXACT * size
    return Segment(control[0], control[3]) if straight else Bezier(*control)


def _joined(pieces: list[Curve], size: float) -> list[Curve]:
    """Join collinear neighbours into one segment, and neighbouring cubics into one spline."""
    groups: list[list[Curve]] = []
    for piece in pieces:
        if groups and type(groups[-1][-1]) is type(piece) and _continues(groups[-1], piece, size):
            groups[-1].append(piece)
        else:
            groups.append([piece])
    return [_merged(group) for group in groups]


def _continues(group: list[Curve], piece: Curve, size: float) -> bool:
    if not isinstance(piece, Segment):
        return True
    points = np.array([*(member.start for member in group), piece.start, piece.end])
    return _off_line(points, group[0].start, piece.end) <= 10 * EXACT * size


def _merged(group: list[Curve]) -> Curve:
    if len(group) == 1:
        return group[0]
    if isinstance(group[0], Segment):
        return Segment(group[0].start, group[-1].end)
    return Spline.chained([piece for piece in group if isinstance(piece, Bezier)])


def _point(row: FloatArray) -> Point:
    return (float(row[0]), float(row[1]))

"""Outlines and curves of the objects in a ray-optics file: lines, arcs, paths, formulas."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from solen.curve import Arc, Bezier, Curve, Segment
from solen.errors import DesignError
from solen.plane import Point, along, cross, dot, left_of, minus, unit
from solen.scene.rayoptics.facets import Blend, Facets, along_parameter, over_line, sampled
from solen.scene.rayoptics.fields import Fields, UnreadableError, expression, finite, point_of
from solen.scene.rayoptics.formula import Function
from solen.scene.rayoptics.formula_curves import At, fitted
from solen.scene.rayoptics.modules import Expression

HALF_PLANE_EXTENT = 1e4
"""Half the length of the edge of a half-plane, in units of the scene size."""
HALF_ELLIPSE = "0.5\\cdot\\sqrt{1-x^2}"
CIRCLE: dict[str, Any] = {"eqnX": "50\\cos(t)", "eqnY": "50\\sin(t)", "tMin": 0.0, "tMax": math.tau, "tStep": 0.01}
CHECKED, ROUNDING = 200, 1e-9
"""Number of intervals at whose ends two curves of a glass are compared, and the tolerance relative to its length."""
SKIN = 1e-6
"""Distance from a surface, in length scales of the file, within which a ray that leaves the surface does not meet it
again.
"""
Outline = Callable[[Fields, "SceneSettings"], Sequence[Curve]]
"""Function that reads the curves of an object."""


@dataclass(frozen=True)
class SceneSettings:
    """Scene data that objects need: the length scale, whether colours are simulated, and the scene size.

    With ``facets``, curves defined by formulas become the polylines that ray-optics traces.
    """

    length_scale: float
    colours: bool
    span: float
    facets: bool


def segment(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return the segment from p1 to p2."""
    return [read_segment(fields)]


def read_segment(fields: Fields, first: str = "p1", second: str = "p2") -> Segment:
    """Read the segment between two points of the object."""
    a, b = fields.point(first), fields.point(second)
    if a == b:
        raise UnreadableError(second, "is the same point as " + first)
    return Segment(a, b)


def arc_or_line(a: Point, middle: Point, b: Point) -> list[Curve]:
    """Return the arc through three points, a segment if they are collinear, or nothing if both ends coincide."""
    if a == b:
        return []
    try:
        return [Arc.through(a, middle, b)]
    except DesignError:
        return [Segment(a, b)]


def path_outline(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return the outline through the points of a path."""
    _check_finished(fields)
    return path(fields.items("path"))


def path(items: list[dict[str, Any]]) -> list[Curve]:
    """Return the sides of an outline: segments between corners, or arcs through the point between two corners."""
    points = [point_of(f"path[{i}]", item) for i, item in enumerate(items)]
    arcs = [item.get("arc") is True for item in items]
    n = len(items)
    curves: list[Curve] = []
    for i in range(n):
        j, k = (i + 1) % n, (i + 2) % n
        if arcs[i]:
            continue
        if arcs[j]:
            curves += arc_or_line(points[i], points[j], points[k])
        elif points[i] != points[j]:
            curves.append(Segment(points[i], points[j]))
    if len(curves) < 2:
        raise UnreadableError("path", "encloses nothing")
    return curves


def circle(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return a circle from its centre and a point on it."""
    radius = read_segment(fields)
    return [Arc.circle(radius.a, radius.length_mm)]


def half_plane(fields: Fields, settings: SceneSettings) -> list[Curve]:
    """Return the edge of a half-plane."""
    edge = read_segment(fields)
    direction, extent = unit(minus(edge.b, edge.a)), HALF_PLANE_EXTENT * max(settings.span, 1.0)
    return [Segment(along(edge.a, direction, -extent), along(edge.a, direction, extent))]


def smooth_outline(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return the outline made of Bézier curves."""
    _check_finished(fields)
    fields.skip("displayControlPoints", "intersectTol")
    return _beziers(fields, closed=True)


def _beziers(fields: Fields, closed: bool) -> list[Curve]:
    items = fields.items("points")
    keys = ("a1", "c1", "c2")
    rows = [[point_of(f"points[{i}].{key}", item.get(key)) for key in keys] for i, item in enumerate(items)]
    pairs = list(pairwise([*rows, rows[0]] if closed and rows else rows))
    if not pairs:
        raise UnreadableError("points", "must contain at least two points")
    return [_bezier(a, control_a, control_b, following[0]) for (a, control_a, control_b), following in pairs]


def _bezier(a: Point, control_a: Point, control_b: Point, b: Point) -> Curve:
    deviation = max(abs(cross(minus(b, a), minus(handle, a))) for handle in (control_a, control_b))
    if deviation == 0.0 and a != b:
        return Segment(a, b)
    return Bezier(a, control_a, control_b, b)


def between_formulas(fields: Fields, settings: SceneSettings) -> list[Curve]:
    """Return the outline between two curves over a line; the formulas are evaluated from −1 to 1 along the line."""
    base = read_segment(fields)
    lower = _over(base, fields.formula("eqn1", "x", "0"))
    upper = _over(base, fields.formula("eqn2", "x", HALF_ELLIPSE))
    _check_above(base, lower, upper)
    if settings.facets:
        positions = over_line(base.length_mm, settings.length_scale)
        back = [upper(base.length_mm - position) for position in positions]
        corners = [base.a, *sampled(lower, positions, "eqn1"), *back, base.a]
        polyline = _facets(corners, (len(positions),), "lengths", settings)
        low, high = _without_spike(_height(base, corners[1]), _height(base, corners[-2]))
        return [replace(polyline[0], low=low), replace(polyline[1], high=len(corners) - 1.0 - high)]
    lower_curves, upper_curves = (
        fitted(at, 0.0, base.length_mm, key) for at, key in ((lower, "eqn1"), (upper, "eqn2"))
    )
    return closed_outline([lower_curves, reversed_curves(upper_curves)])


def _height(base: Segment, point: Point) -> float:
    return dot(minus(point, base.a), left_of(unit(minus(base.b, base.a))))


def _check_above(base: Segment, lower: At, upper: At) -> None:
    """Reject an upper curve that lies below the lower one, as ray-optics does."""
    for i in range(CHECKED + 1):
        position = base.length_mm * i / CHECKED
        if _height(base, upper(position)) < _height(base, lower(position)) - ROUNDING * base.length_mm:
            raise UnreadableError("eqn2", f"lies below eqn1 at x = {2.0 * i / CHECKED - 1.0:g}")


def _without_spike(first: float, last: float) -> tuple[float, float]:
    """Return the fractions of the first and of the last chord of an outline at which the two chords coincide.

    The outline leaves the end of its base towards the height ``first`` and returns from the height ``last``. If both
    heights are on the same side, the lower of the two chords is traversed in both directions and is not a surface.
    """
    if not first * last > 0.0:
        return 0.0, 0.0
    return min(last / first, 1.0), min(first / last, 1.0)


def _over(base: Segment, formula: Expression) -> At:
    """Return a function that maps a position along a base to the point of a curve over the base.

    The formula is evaluated from −1 to 1 along the base, and its unit of height is half the base length.
    """
    half, direction, height = 0.5 * base.length_mm, unit(minus(base.b, base.a)), formula.compiled()

    def at(position: float) -> Point:
        x = 1.0 if position == base.length_mm else 2.0 * (position - half) / base.length_mm
        return along(along(base.a, direction, position), left_of(direction), half * height(x))

    return at


def _facets(corners: Sequence[Point], joints: Sequence[int], blend: Blend, settings: SceneSettings) -> list[Facets]:
    """Return a polyline through corners, divided at the joints, which may be corners of the outline."""
    polyline = Facets.through(tuple(corners), blend, SKIN * settings.length_scale)
    return [replace(polyline, low=float(a), high=float(b)) for a, b in pairwise([0, *joints, len(corners) - 1])]


def closed_outline(parts: Sequence[Sequence[Curve]]) -> list[Curve]:
    """Join the parts of an outline with straight lines wherever a part does not end at the start of the next."""
    curves: list[Curve] = []
    for part, following in pairwise([*parts, parts[0]]):
        curves += part
        end, start = part[-1].end, following[0].start
        if math.dist(end, start) > 1e-9 * max(1.0, *map(abs, end)):
            curves.append(Segment(end, start))
    return curves


def reversed_curves(curves: Sequence[Curve]) -> list[Curve]:
    """Return the same curves in the opposite direction, from the end of the last to the start of the first."""
    return [curve.reversed() for curve in reversed(curves)]


def parametric_outline(fields: Fields, settings: SceneSettings) -> list[Curve]:
    """Return the outline formed by the pieces of a parametric object."""
    return reversed_curves(closed_outline(_parametric(fields, settings)))


def _parametric(fields: Fields, settings: SceneSettings) -> list[list[Curve]]:
    """Return the curves of all pieces of a parametric object."""
    x0, z0 = point_of("origin", fields.data.get("origin", {"x": 0.0, "y": 0.0}))
    fields.skip("origin")
    parts: list[list[Curve]] = []
    corners: list[Point] = []
    joints: list[int] = []
    for i, piece in enumerate(fields.items("pieces", [CIRCLE])):
        what = f"pieces[{i}]"
        x, y = (expression(f"{what}.{key}", piece.get(key), "t").compiled() for key in ("eqnX", "eqnY"))
        low, high, step = (finite(f"{what}.{key}", piece.get(key)) for key in ("tMin", "tMax", "tStep"))
        if not low < high:
            raise UnreadableError(f"{what}.tMax", f"must be above tMin: {low:g} to {high:g}")

        def at(t: float, x: Function = x, y: Function = y) -> Point:
            return (x0 + x(t), z0 - y(t))

        if settings.facets:
            joints += [len(corners)] if corners else []
            corners += sampled(at, along_parameter(low, high, step), what)
        else:
            parts.append(fitted(at, low, high, what))
    if settings.facets and corners:
        return [[*_facets(_closed(corners), joints, "units", settings)]]
    if not parts:
        raise UnreadableError("pieces", "must contain at least one piece")
    return parts


def _closed(corners: list[Point]) -> list[Point]:
    """Return the corners, with the last one replaced by the first if they are equal to within rounding error."""
    return [*corners[:-1], corners[0]] if math.dist(corners[0], corners[-1]) < 1e-9 else corners


def _check_finished(fields: Fields) -> None:
    if fields.flag("notDone"):
        raise UnreadableError("notDone", "the drawing of the object was not finished")


def aperture(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return the two blocking segments of an aperture."""
    return [read_segment(fields, "p1", "p3"), read_segment(fields, "p4", "p2")]


def arc(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return an arc through three points."""
    curves = arc_or_line(fields.point("p1"), fields.point("p3"), fields.point("p2"))
    if not curves:
        raise UnreadableError("p2", "is the same point as p1")
    return curves


def parabola(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return a parabola over a line, with its vertex at the height of the third point."""
    base, top = read_segment(fields), fields.point("p3")
    direction = unit(minus(base.b, base.a))
    height = dot(minus(top, base.a), left_of(direction))
    if abs(height) <= 1e-12 * base.length_mm:
        return [base]
    handles = (along(end, left_of(direction), 4.0 / 3.0 * height) for end in (base.a, base.b))
    third = base.length_mm / 3.0
    control_a, control_b = (
        along(handle, direction, sign * third) for handle, sign in zip(handles, (1.0, -1.0), strict=True)
    )
    return [Bezier(base.a, control_a, control_b, base.b)]


def over_line_curves(fields: Fields, settings: SceneSettings) -> list[Curve]:
    """Return the curve of a formula over a line."""
    base = read_segment(fields)
    at = _over(base, fields.formula("eqn", "x", HALF_ELLIPSE))
    if settings.facets:
        return [*_facets(sampled(at, over_line(base.length_mm, settings.length_scale), "eqn"), (), "images", settings)]
    return fitted(at, 0.0, base.length_mm, "eqn")


def parametric_curves(fields: Fields, settings: SceneSettings) -> list[Curve]:
    """Return the curves of the pieces of a parametric object, joined."""
    parts = _parametric(fields, settings)
    joints = [Segment(a[-1].end, b[0].start) for a, b in pairwise(parts) if math.dist(a[-1].end, b[0].start) > 1e-9]
    return [*(curve for part in parts for curve in part), *joints]


def smooth_curve(fields: Fields, _: SceneSettings) -> list[Curve]:
    """Return a chain of Bézier curves, which is closed unless the file specifies otherwise."""
    _check_finished(fields)
    return _beziers(fields, closed=fields.flag("isClosed", True))

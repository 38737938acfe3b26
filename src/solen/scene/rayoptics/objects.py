"""What stands in the light: glasses, mirrors, walls and ideal elements of the file, as outlines and curves."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from solen.curve import Arc, Bezier, Curve, Segment
from solen.errors import DesignError
from solen.plane import Point, along, cross, dot, left_of, minus, unit
from solen.scene.model import Behaviour
from solen.scene.rayoptics.arrangement import Element, Glass
from solen.scene.rayoptics.facets import Blend, Facets, along_parameter, over_line, sampled
from solen.scene.rayoptics.fields import GREEN_NM, Fields, UnreadError, expression, finite, point_of
from solen.scene.rayoptics.fit import At, fitted
from solen.scene.rayoptics.formula import Function
from solen.scene.rayoptics.modules import Expression
from solen.scene.surface import Surface

FAR = 1e4
"""Length of the edge of a half-plane to either side, in units of what the scene spans."""
HALF_ELLIPSE = "0.5\\cdot\\sqrt{1-x^2}"
CIRCLE: dict[str, Any] = {"eqnX": "50\\cos(t)", "eqnY": "50\\sin(t)", "tMin": 0.0, "tMax": math.tau, "tStep": 0.01}
SKIN = 1e-6
"""Length from a surface, in length scales of the file, within which a ray that leaves it does not meet it again."""

Reader = Callable[[Fields, str, "World"], list[Glass | Element]]


@dataclass(frozen=True)
class World:
    """What objects must know of their scene: its length scale, whether colours count, how far it reaches.

    ``facets`` says that curves of formulas shall be the polylines that ray-optics makes of them.
    """

    length_scale: float
    colours: bool
    span: float
    facets: bool


def glass(fields: Fields, name: str, outline: Sequence[Curve], world: World, **how: bool) -> list[Glass | Element]:
    """A glass with the keys that all glasses have."""
    index, b = fields.number_of("refIndex", 1.5), fields.number_of("cauchyB", 0.004)
    if not index > 0.0:
        raise UnreadError("refIndex", f"must be above 0, not {index:g}")
    partial = fields.flag("partialReflect", True)
    return [Glass(name, tuple(outline), index, b if world.colours else 0.0, partial, **how)]


def filtered(fields: Fields, world: World) -> tuple[float, float] | None:
    """Wavelengths at which a filter acts, from the higher to the lower where it acts outside them."""
    on, invert = fields.flag("filter"), fields.flag("invert")
    center, half = fields.number_of("wavelength", GREEN_NM), fields.number_of("bandwidth", 10.0)
    if not (on and world.colours):
        return None
    if half < 0.0:
        raise UnreadError("bandwidth", f"must be at least 0, not {half:g}")
    low, high = center - half, center + half
    return (max(high, math.nextafter(low, math.inf)), low) if invert else (low, high)


def element(
    fields: Fields, name: str, curves: Sequence[Curve], behaviour: Behaviour, world: World, **surface: float
) -> list[Glass | Element]:
    """An element with a filter."""
    band = filtered(fields, world)
    made = Surface(band_nm=band, **surface) if band is not None or surface else None  # type: ignore[arg-type]
    return [Element(name, tuple(curves), behaviour, made)]


def line(fields: Fields, first: str = "p1", second: str = "p2") -> Segment:
    """Straight line between two points of the object."""
    a, b = fields.point(first), fields.point(second)
    if a == b:
        raise UnreadError(second, "is the same point as " + first)
    return Segment(a, b)


def arc_or_line(a: Point, middle: Point, b: Point) -> list[Curve]:
    """Arc through three points, straight where they lie on one line; nothing where all is one point."""
    if a == b:
        return []
    try:
        return [Arc.through(a, middle, b)]
    except DesignError:
        return [Segment(a, b)]


def _path_glass(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    _finished(fields)
    return glass(fields, name, _path(fields.items("path")), world)


def _path(items: list[dict[str, Any]]) -> list[Curve]:
    """Sides of an outline: between corners, or from corner to corner by way of a point of an arc."""
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
        raise UnreadError("path", "encloses nothing")
    return curves


def _circle_glass(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    return glass(fields, name, [_circle(fields)], world)


def _circle(fields: Fields) -> Arc:
    spoke = line(fields)
    return Arc.circle(spoke.a, spoke.length_mm)


def _plane_glass(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    edge = line(fields)
    direction, far = unit(minus(edge.b, edge.a)), FAR * max(world.span, 1.0)
    return glass(
        fields, name, [Segment(along(edge.a, direction, -far), along(edge.a, direction, far))], world, endless=True
    )


def _spherical_lens(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    """A lens by its outline, or by its two edges, thickness and radii or focal distances."""
    defined = fields.choice("defBy", "DR1R2")
    if fields.data.get("path") is not None:
        fields.skip("p1", "p2", "params")
        return _path_glass(fields, name, world)
    edges, numbers = (fields.point("p1"), fields.point("p2")), fields.data.get("params")
    fields.skip("path", "params")
    if not isinstance(numbers, dict):
        raise UnreadError("params", "is missing, and path as well")
    if defined == "DR1R2":
        d, r1, r2 = (_radius(f"params.{key}", numbers.get(key)) for key in ("d", "r1", "r2"))
        return glass(fields, name, _lens(*edges, d, r1, r2), world)
    if defined != "DFfdBfd":
        raise UnreadError("defBy", f"is unknown: {defined}")
    d, ffd, bfd = (finite(f"params.{key}", numbers.get(key)) for key in ("d", "ffd", "bfd"))
    (made,) = glass(fields, name, (), world)
    if not isinstance(made, Glass):
        raise TypeError(name)
    for radii in _radii(d, ffd, bfd, made.a + made.b_um2 / 0.546**2):
        try:
            return [Glass(name, tuple(_lens(*edges, d, *radii)), made.a, made.b_um2, made.partial)]
        except UnreadError:
            continue
    raise UnreadError("params", "belong to no lens")


def _radius(key: str, value: Any) -> float:
    """A radius; text or null stand for infinity in JSON, which has no word for it."""
    return math.inf if value in (None, "Infinity", "-Infinity", "inf", "-inf") else finite(key, value)


def _radii(d: float, ffd: float, bfd: float, n: float) -> list[tuple[float, float]]:
    """Radii of the lenses with a thickness and front and back focal distances, the smaller ones first."""
    square = d * d + 4.0 * bfd * ffd * n * n
    if square < 0.0:
        raise UnreadError("params", "belong to no lens")
    found = []
    for root in (-math.sqrt(square), math.sqrt(square)):
        try:
            r1 = d * (n - 1.0) * (d + 2.0 * ffd * n + root) / (2.0 * n * (d + (ffd - bfd) * n))
            r2 = -d * (n - 1.0) * (d + 2.0 * bfd * n + root) / (2.0 * n * (d + (bfd - ffd) * n))
        except ZeroDivisionError:
            continue
        found.append((r1, r2))
    return sorted(found, key=lambda radii: abs(radii[0]) + abs(radii[1]))


def _lens(p1: Point, p2: Point, d: float, r1: float, r2: float) -> list[Curve]:
    """Outline of a lens between two edges, of a thickness on its axis and two radii of curvature."""
    length = math.dist(p1, p2)
    if length == 0.0:
        raise UnreadError("p2", "is the same point as p1")
    axis = left_of(unit(minus(p2, p1)))
    center = (0.5 * (p1[0] + p2[0]), 0.5 * (p1[1] + p2[1]))
    front, back = 0.5 * d - _sag(r1, length), 0.5 * d + _sag(r2, length)
    corners = [(p1, -front), (p1, back), (center, 0.5 * d), (p2, back), (p2, -front), (center, -0.5 * d)]
    points = [along(start, axis, shift) for start, shift in corners]
    items = [{"x": x, "y": -z, "arc": i in (2, 5)} for i, (x, z) in enumerate(points)]
    return _path(items)


def _sag(radius: float, length: float) -> float:
    if math.isinf(radius):
        return 0.0
    square = radius * radius - 0.25 * length * length
    if square < 0.0:
        raise UnreadError("params", "belong to no lens: a radius is less than half its height")
    return radius - math.copysign(math.sqrt(square), radius)


def _curve_glass(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    _finished(fields)
    fields.skip("displayControlPoints", "intersectTol")
    return glass(fields, name, _beziers(fields, closed=True), world)


def _beziers(fields: Fields, closed: bool) -> list[Curve]:
    items = fields.items("points")
    keys = ("a1", "c1", "c2")
    rows = [[point_of(f"points[{i}].{key}", item.get(key)) for key in keys] for i, item in enumerate(items)]
    pairs = list(pairwise([*rows, rows[0]] if closed and rows else rows))
    if not pairs:
        raise UnreadError("points", "must be at least two")
    return [_bezier(here[0], here[1], here[2], there[0]) for here, there in pairs]


def _bezier(a: Point, control_a: Point, control_b: Point, b: Point) -> Curve:
    off = max(abs(cross(minus(b, a), minus(handle, a))) for handle in (control_a, control_b))
    if off == 0.0 and a != b:
        return Segment(a, b)
    return Bezier(a, control_a, control_b, b)


def _custom_glass(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    """Glass between two curves over a line, which the formulas take as −1 to 1."""
    base = line(fields)
    lower = _over(base, fields.formula("eqn1", "x", "0"))
    upper = _over(base, fields.formula("eqn2", "x", HALF_ELLIPSE))
    places = over_line(base.length_mm, world.length_scale) if world.facets else []
    if places:
        back = [upper(base.length_mm - place) for place in places]
        corners = [base.a, *sampled(lower, places, "eqn1"), *back, base.a]
        return glass(fields, name, _facets(corners, (len(places),), "lengths", world), world, oriented=True)
    there, back_again = (fitted(one, 0.0, base.length_mm, key) for one, key in ((lower, "eqn1"), (upper, "eqn2")))
    outline = closed_outline([there, [one.reversed() for one in reversed(back_again)]])
    return glass(fields, name, outline, world, oriented=True)


def _over(base: Segment, formula: Expression) -> At:
    """Point over a place along a base: the formula knows the base as −1 to 1, and its half as the unit of heights."""
    half, direction, height = 0.5 * base.length_mm, unit(minus(base.b, base.a)), formula.compiled()

    def at(place: float) -> Point:
        x = 1.0 if place == base.length_mm else 2.0 * (place - half) / base.length_mm
        return along(along(base.a, direction, place), left_of(direction), half * height(x))

    return at


def _facets(corners: Sequence[Point], joints: Sequence[int], blend: Blend, world: World) -> list[Curve]:
    """Polyline through corners, in parts that end at the joints, which may be corners of the outline."""
    whole = Facets.through(tuple(corners), blend, SKIN * world.length_scale)
    return [replace(whole, low=float(a), high=float(b)) for a, b in pairwise([0, *joints, len(corners) - 1])]


def closed_outline(parts: Sequence[Sequence[Curve]]) -> list[Curve]:
    """Parts of an outline, joined by straight lines where one does not end at the next one's start."""
    found: list[Curve] = []
    for here, there in pairwise([*parts, parts[0]]):
        found += here
        if math.dist(here[-1].end, there[0].start) > 1e-9 * max(1.0, *map(abs, here[-1].end)):
            found.append(Segment(here[-1].end, there[0].start))
    return found


def _param_glass(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    outline = closed_outline(_parametric(fields, world))
    return glass(fields, name, [one.reversed() for one in reversed(outline)], world, oriented=True)


def _parametric(fields: Fields, world: World) -> list[list[Curve]]:
    """Curves of all pieces of a parametric object."""
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
            raise UnreadError(f"{what}.tMax", f"must be above tMin: {low:g} to {high:g}")

        def at(t: float, x: Function = x, y: Function = y) -> Point:
            return (x0 + x(t), z0 - y(t))

        if world.facets:
            joints += [len(corners)] if corners else []
            corners += sampled(at, along_parameter(low, high, step), what)
        else:
            parts.append(fitted(at, low, high, what))
    if world.facets and corners:
        return [_facets(_closed(corners), joints, "units", world)]
    if not parts:
        raise UnreadError("pieces", "must be at least one")
    return parts


def _closed(corners: list[Point]) -> list[Point]:
    """Corners whose last one is the first where they are one but for rounding."""
    return [*corners[:-1], corners[0]] if math.dist(corners[0], corners[-1]) < 1e-9 else corners


def _finished(fields: Fields) -> None:
    if fields.flag("notDone"):
        raise UnreadError("notDone", "its drawing was not finished")


def _blocker(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    return element(fields, name, [line(fields)], "absorbing", world)


def _circle_blocker(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    return element(fields, name, [_circle(fields)], "absorbing", world)


def _aperture(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    return element(fields, name, [line(fields, "p1", "p3"), line(fields, "p4", "p2")], "absorbing", world)


def _mirror(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    return element(fields, name, [line(fields)], "mirror", world)


def _arc_mirror(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    curves = arc_or_line(fields.point("p1"), fields.point("p3"), fields.point("p2"))
    if not curves:
        raise UnreadError("p2", "is the same point as p1")
    return element(fields, name, curves, "mirror", world)


def _parabolic_mirror(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    """A parabola over a line, with its vertex at the height of the third point."""
    base, top = line(fields), fields.point("p3")
    direction = unit(minus(base.b, base.a))
    height = dot(minus(top, base.a), left_of(direction))
    if abs(height) <= 1e-12 * base.length_mm:
        return element(fields, name, [base], "mirror", world)
    handles = (along(end, left_of(direction), 4.0 / 3.0 * height) for end in (base.a, base.b))
    third = base.length_mm / 3.0
    control_a, control_b = (
        along(handle, direction, way * third) for handle, way in zip(handles, (1.0, -1.0), strict=True)
    )
    return element(fields, name, [Bezier(base.a, control_a, control_b, base.b)], "mirror", world)


def _custom_mirror(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    base = line(fields)
    at = _over(base, fields.formula("eqn", "x", HALF_ELLIPSE))
    if world.facets:
        corners = sampled(at, over_line(base.length_mm, world.length_scale), "eqn")
        return element(fields, name, _facets(corners, (), "images", world), "mirror", world)
    return element(fields, name, fitted(at, 0.0, base.length_mm, "eqn"), "mirror", world)


def _param_mirror(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    parts = _parametric(fields, world)
    joints = [Segment(a[-1].end, b[0].start) for a, b in pairwise(parts) if math.dist(a[-1].end, b[0].start) > 1e-9]
    return element(fields, name, [*(curve for one in parts for curve in one), *joints], "mirror", world)


def _curve_mirror(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    _finished(fields)
    return element(fields, name, _beziers(fields, closed=fields.flag("isClosed", True)), "mirror", world)


def _ideal_mirror(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    return element(fields, name, [line(fields)], "mirror", world, focal_mm=_focal(fields))


def _ideal_lens(fields: Fields, name: str, world: World) -> list[Glass | Element]:  # noqa: ARG001  one of several
    return [Element(name, (line(fields),), "lens", Surface(focal_mm=_focal(fields)))]


def _focal(fields: Fields) -> float:
    focal = fields.number_of("focalLength", 100.0)
    if focal == 0.0:
        raise UnreadError("focalLength", "must not be 0")
    return focal


def _beam_splitter(fields: Fields, name: str, world: World) -> list[Glass | Element]:
    share = fields.number_of("transRatio", 0.5)
    if not 0.0 <= share <= 1.0:
        raise UnreadError("transRatio", f"must be from 0 to 1, not {share:g}")
    return element(fields, name, [line(fields)], "splitter", world, transmitted=share)


READERS: dict[str, Reader] = {
    "Glass": _path_glass,
    "CircleGlass": _circle_glass,
    "PlaneGlass": _plane_glass,
    "SphericalLens": _spherical_lens,
    "CurveGlass": _curve_glass,
    "CustomGlass": _custom_glass,
    "ParamGlass": _param_glass,
    "IdealLens": _ideal_lens,
    "IdealMirror": _ideal_mirror,
    "Blocker": _blocker,
    "CircleBlocker": _circle_blocker,
    "Aperture": _aperture,
    "Mirror": _mirror,
    "ArcMirror": _arc_mirror,
    "ParabolicMirror": _parabolic_mirror,
    "CustomMirror": _custom_mirror,
    "ParamMirror": _param_mirror,
    "CurveMirror": _curve_mirror,
    "BeamSplitter": _beam_splitter,
}

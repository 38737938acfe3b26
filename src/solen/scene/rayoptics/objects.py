"""Optical elements: glasses, mirrors, walls and ideal elements of the file, as outlines and curves."""

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
from solen.scene.rayoptics.formula import Function
from solen.scene.rayoptics.formula_curves import At, fitted
from solen.scene.rayoptics.modules import Expression
from solen.scene.surface import Grating, Surface

FAR = 1e4
"""Length of the edge of a half-plane to either side, in units of what the scene spans."""
HALF_ELLIPSE = "0.5\\cdot\\sqrt{1-x^2}"
CIRCLE: dict[str, Any] = {"eqnX": "50\\cos(t)", "eqnY": "50\\sin(t)", "tMin": 0.0, "tMax": math.tau, "tStep": 0.01}
CHECKED, ROUNDING = 200, 1e-9
"""Places at which two curves of a glass are compared, and by how much of its length they may be wrong."""
MOST_ORDERS, LEAST_ORDER = 1000, 1e-7
"""Orders of a grating to either side at most, and the share of the light below which an order is left out."""
SKIN = 1e-6
"""Length from a surface, in length scales of the file, within which a ray that leaves it does not meet it again."""

Reader = Callable[[Fields, str, "World"], Sequence[Glass | Element]]
"""Reads an object of one type under the name that it gets."""
Outline = Callable[[Fields, "World"], Sequence[Curve]]
"""Reads the curves of an object."""


@dataclass(frozen=True)
class World:
    """What objects need from their scene: its length scale, whether colours count, how far it reaches.

    With ``facets`` curves of formulas become the polylines that ray-optics makes of them.
    """

    length_scale: float
    colours: bool
    span: float
    facets: bool


def glass(fields: Fields, name: str, outline: Sequence[Curve], world: World, **how: bool) -> list[Glass]:
    """A glass with the keys that all glasses have."""
    index, b = fields.number_of("refIndex", 1.5, above=0.0), fields.number_of("cauchyB", 0.004)
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


def _element(
    behaviour: Behaviour, curves: Outline, *, filters: bool = True, **numbers: Callable[[Fields], float]
) -> Reader:
    """Reader of an element: its curves, its filter if it can have one, and the numbers of its surface."""

    def read(fields: Fields, name: str, world: World) -> Sequence[Glass | Element]:
        here = tuple(curves(fields, world))
        values = {key: number(fields) for key, number in numbers.items()}
        band = filtered(fields, world) if filters else None
        surface = Surface(band_nm=band, **values) if band is not None or values else None  # type: ignore[arg-type]
        return [Element(name, here, behaviour, surface)]

    return read


def _glass(outline: Outline, **how: bool) -> Reader:
    """Reader of a glass within an outline."""
    return lambda fields, name, world: glass(fields, name, outline(fields, world), world, **how)


def _line(fields: Fields, _: World) -> list[Curve]:
    return [line(fields)]


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


def _path_outline(fields: Fields, _: World) -> list[Curve]:
    _check_finished(fields)
    return _path(fields.items("path"))


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


def _circle(fields: Fields, _: World) -> list[Curve]:
    spoke = line(fields)
    return [Arc.circle(spoke.a, spoke.length_mm)]


def _half_plane(fields: Fields, world: World) -> list[Curve]:
    edge = line(fields)
    direction, far = unit(minus(edge.b, edge.a)), FAR * max(world.span, 1.0)
    return [Segment(along(edge.a, direction, -far), along(edge.a, direction, far))]


def _spherical_lens(fields: Fields, name: str, world: World) -> Sequence[Glass | Element]:
    """A lens by its outline, or by its two edges, thickness and radii or focal distances."""
    defined = fields.choice("defBy", "DR1R2")
    if fields.data.get("path") is not None:
        fields.skip("p1", "p2", "params")
        return glass(fields, name, _path_outline(fields, world), world)
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
    for radii in _radii(d, ffd, bfd, made.a + made.b_um2 / 0.546**2):
        try:
            return [replace(made, outline=tuple(_lens(*edges, d, *radii)))]
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


def _smooth_outline(fields: Fields, _: World) -> list[Curve]:
    _check_finished(fields)
    fields.skip("displayControlPoints", "intersectTol")
    return _beziers(fields, closed=True)


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


def _between_formulas(fields: Fields, world: World) -> list[Curve]:
    """Outline between two curves over a line, which the formulas take as −1 to 1."""
    base = line(fields)
    lower = _over(base, fields.formula("eqn1", "x", "0"))
    upper = _over(base, fields.formula("eqn2", "x", HALF_ELLIPSE))
    _check_above(base, lower, upper)
    if world.facets:
        places = over_line(base.length_mm, world.length_scale)
        back = [upper(base.length_mm - place) for place in places]
        corners = [base.a, *sampled(lower, places, "eqn1"), *back, base.a]
        whole = _facets(corners, (len(places),), "lengths", world)
        low, high = _without_spike(_height(base, corners[1]), _height(base, corners[-2]))
        return [replace(whole[0], low=low), replace(whole[1], high=len(corners) - 1.0 - high)]
    there, back_again = (fitted(at, 0.0, base.length_mm, key) for at, key in ((lower, "eqn1"), (upper, "eqn2")))
    return closed_outline([there, reversed_curves(back_again)])


def _height(base: Segment, point: Point) -> float:
    return dot(minus(point, base.a), left_of(unit(minus(base.b, base.a))))


def _check_above(base: Segment, lower: At, upper: At) -> None:
    """Refuse, as ray-optics does, an upper curve that runs below the lower one."""
    for i in range(CHECKED + 1):
        place = base.length_mm * i / CHECKED
        if _height(base, upper(place)) < _height(base, lower(place)) - ROUNDING * base.length_mm:
            raise UnreadError("eqn2", f"runs below eqn1 at x = {2.0 * i / CHECKED - 1.0:g}")


def _without_spike(first: float, last: float) -> tuple[float, float]:
    """What the first and the last chord of an outline from the base's end have in common, as shares of both.

    The outline goes from there to the ``first`` height and comes back from the ``last``: if both are on one side, the
    nearer stretch is walked there and back, and is not a surface.
    """
    if not first * last > 0.0:
        return 0.0, 0.0
    return min(last / first, 1.0), min(first / last, 1.0)


def _over(base: Segment, formula: Expression) -> At:
    """Point over a place along a base, which runs from −1 to 1 in the formula; its half is the unit of heights."""
    half, direction, height = 0.5 * base.length_mm, unit(minus(base.b, base.a)), formula.compiled()

    def at(place: float) -> Point:
        x = 1.0 if place == base.length_mm else 2.0 * (place - half) / base.length_mm
        return along(along(base.a, direction, place), left_of(direction), half * height(x))

    return at


def _facets(corners: Sequence[Point], joints: Sequence[int], blend: Blend, world: World) -> list[Facets]:
    """Polyline through corners, in parts that end at the joints, which may be corners of the outline."""
    whole = Facets.through(tuple(corners), blend, SKIN * world.length_scale)
    return [replace(whole, low=float(a), high=float(b)) for a, b in pairwise([0, *joints, len(corners) - 1])]


def closed_outline(parts: Sequence[Sequence[Curve]]) -> list[Curve]:
    """Parts of an outline, joined by straight lines where one does not end at the next one's start."""
    curves: list[Curve] = []
    for here, there in pairwise([*parts, parts[0]]):
        curves += here
        if math.dist(here[-1].end, there[0].start) > 1e-9 * max(1.0, *map(abs, here[-1].end)):
            curves.append(Segment(here[-1].end, there[0].start))
    return curves


def reversed_curves(curves: Sequence[Curve]) -> list[Curve]:
    """The same curves walked from the end of the last to the start of the first."""
    return [curve.reversed() for curve in reversed(curves)]


def _parametric_outline(fields: Fields, world: World) -> list[Curve]:
    return reversed_curves(closed_outline(_parametric(fields, world)))


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
        return [[*_facets(_closed(corners), joints, "units", world)]]
    if not parts:
        raise UnreadError("pieces", "must be at least one")
    return parts


def _closed(corners: list[Point]) -> list[Point]:
    """Corners whose last one is the first where they are one but for rounding."""
    return [*corners[:-1], corners[0]] if math.dist(corners[0], corners[-1]) < 1e-9 else corners


def _check_finished(fields: Fields) -> None:
    if fields.flag("notDone"):
        raise UnreadError("notDone", "its drawing was not finished")


def _aperture(fields: Fields, _: World) -> list[Curve]:
    return [line(fields, "p1", "p3"), line(fields, "p4", "p2")]


def _arc(fields: Fields, _: World) -> list[Curve]:
    curves = arc_or_line(fields.point("p1"), fields.point("p3"), fields.point("p2"))
    if not curves:
        raise UnreadError("p2", "is the same point as p1")
    return curves


def _parabola(fields: Fields, _: World) -> list[Curve]:
    """A parabola over a line, with its vertex at the height of the third point."""
    base, top = line(fields), fields.point("p3")
    direction = unit(minus(base.b, base.a))
    height = dot(minus(top, base.a), left_of(direction))
    if abs(height) <= 1e-12 * base.length_mm:
        return [base]
    handles = (along(end, left_of(direction), 4.0 / 3.0 * height) for end in (base.a, base.b))
    third = base.length_mm / 3.0
    control_a, control_b = (
        along(handle, direction, way * third) for handle, way in zip(handles, (1.0, -1.0), strict=True)
    )
    return [Bezier(base.a, control_a, control_b, base.b)]


def _over_line(fields: Fields, world: World) -> list[Curve]:
    base = line(fields)
    at = _over(base, fields.formula("eqn", "x", HALF_ELLIPSE))
    if world.facets:
        return [*_facets(sampled(at, over_line(base.length_mm, world.length_scale), "eqn"), (), "images", world)]
    return fitted(at, 0.0, base.length_mm, "eqn")


def _parametric_curves(fields: Fields, world: World) -> list[Curve]:
    parts = _parametric(fields, world)
    joints = [Segment(a[-1].end, b[0].start) for a, b in pairwise(parts) if math.dist(a[-1].end, b[0].start) > 1e-9]
    return [*(curve for part in parts for curve in part), *joints]


def _smooth_curve(fields: Fields, _: World) -> list[Curve]:
    _check_finished(fields)
    return _beziers(fields, closed=fields.flag("isClosed", True))


def _focal(fields: Fields) -> float:
    focal = fields.number_of("focalLength", 100.0)
    if focal == 0.0:
        raise UnreadError("focalLength", "must not be 0")
    return focal


def _transmitted(fields: Fields) -> float:
    share = fields.number_of("transRatio", 0.5)
    if not 0.0 <= share <= 1.0:
        raise UnreadError("transRatio", f"must be from 0 to 1, not {share:g}")
    return share


def _grating(curves: Outline, way: int, mirrored: bool | None = None) -> Reader:
    """Reader of a grating, whose orders are counted to the right of the light's way, or to its left for ``way`` −1."""

    def read(fields: Fields, name: str, world: World) -> Sequence[Glass | Element]:
        lines, custom = fields.number_of("lineDensity", 1000.0, above=0.0), fields.flag("customBrightness")
        stated, ratio = fields.numbers("brightnesses", (1.0, 0.5, 0.5)), fields.number_of("slitRatio", 0.5)
        if not 0.0 <= ratio <= 1.0:
            raise UnreadError("slitRatio", f"must be from 0 to 1, not {ratio:g}")
        orders = _stated_orders(stated) if custom else _of_slits(ratio)
        if not orders:
            raise UnreadError("brightnesses" if custom else "slitRatio", "leaves no light")
        back = fields.flag("mirrored") if mirrored is None else mirrored
        ruled = Grating(lines, tuple((way * order, share) for order, share in orders), back)
        return [Element(name, tuple(curves(fields, world)), "grating", Surface(grating=ruled))]

    return read


def _stated_orders(shares: Sequence[float]) -> list[tuple[int, float]]:
    """Orders 0, 1, −1, 2, −2 and so on with their shares."""
    if min(shares, default=0.0) < 0.0:
        raise UnreadError("brightnesses", f"must be at least 0, not {min(shares):g}")
    return [((i + 1) // 2 * (1 if i % 2 else -1), share) for i, share in enumerate(shares) if share > 0.0]


def _of_slits(ratio: float) -> list[tuple[int, float]]:
    """Orders of a wall with slits of this share of the interval: sin²(π m ratio) / (π m)², the same at all angles."""
    of_slits = [(0, ratio * ratio)]
    for m in range(1, MOST_ORDERS + 1):
        share = (math.sin(math.pi * m * ratio) / (math.pi * m)) ** 2
        of_slits += [(way * m, share) for way in (1, -1)]
    return [(m, share) for m, share in of_slits if share > LEAST_ORDER]


READERS: dict[str, Reader] = {
    "Glass": _glass(_path_outline),
    "CircleGlass": _glass(_circle),
    "PlaneGlass": _glass(_half_plane, endless=True),
    "SphericalLens": _spherical_lens,
    "CurveGlass": _glass(_smooth_outline),
    "CustomGlass": _glass(_between_formulas, oriented=True),
    "ParamGlass": _glass(_parametric_outline, oriented=True),
    "IdealLens": _element("lens", _line, filters=False, focal_mm=_focal),
    "IdealMirror": _element("mirror", _line, focal_mm=_focal),
    "Blocker": _element("absorbing", _line),
    "CircleBlocker": _element("absorbing", _circle),
    "Aperture": _element("absorbing", _aperture),
    "Mirror": _element("mirror", _line),
    "ArcMirror": _element("mirror", _arc),
    "ParabolicMirror": _element("mirror", _parabola),
    "CustomMirror": _element("mirror", _over_line),
    "ParamMirror": _element("mirror", _parametric_curves),
    "CurveMirror": _element("mirror", _smooth_curve),
    "DiffractionGrating": _grating(_line, 1),
    "ConcaveDiffractionGrating": _grating(_arc, -1, mirrored=True),
    "BeamSplitter": _element("splitter", _line, transmitted=_transmitted),
}
"""Readers by the type of the object; a new type is a line here."""

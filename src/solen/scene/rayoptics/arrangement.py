"""Overlapping glasses as separate regions: ray-optics lets glasses overlap, but scenes of solen do not.

In ray-optics a glass multiplies the index of its surroundings, and coinciding surfaces act as one. Here all curves are
divided where other curves end on them or cross them, and coinciding segments are merged. On both sides of each segment,
the glasses that contain a point close to the segment are determined. Each set of glasses is a region, whose index is
the product of their indices. A segment with the same set on both sides is not a surface, unless an element is there.

A glass without orientation contains the points surrounded by an odd number of its outlines. A glass with an
orientation, which is drawn by a formula, uses the winding number of its outline; with the wrong orientation, its
outside is glass.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise

import numpy as np

from solen.curve import Curve, Segment
from solen.errors import DesignError
from solen.material import Cauchy
from solen.plane import Point, along, cross, dot, heading, minus
from solen.scene.model import Behaviour, Interface, Region
from solen.scene.rayoptics.facets import Facets
from solen.scene.rayoptics.intersections import crossings, parameter_of, part, without_loops
from solen.scene.surface import Surface

Levels = tuple[int, ...]
"""Number of times that each glass encloses a point."""

DIRECTIONS = tuple(heading(angle_deg) for angle_deg in (17.3, 131.9, 253.1))
"""Directions along which outline crossings are counted; the majority decides."""
SIDE_POINT = 0.3819660112501051
"""Parameter of the point at which the sides of a segment are tested; it is not the midpoint, where drawn objects often
touch.
"""
AIR = "air"


@dataclass(frozen=True)
class Glass:
    """A glass with a closed outline and the index A + B/λ², with λ in µm.

    If ``endless``, the glass is a half-plane on the right of its only curve, a long segment.
    """

    name: str
    outline: tuple[Curve, ...]
    a: float
    b_um2: float = 0.0
    partial: bool = True
    oriented: bool = False
    endless: bool = False


@dataclass(frozen=True)
class Element:
    """A mirror, wall or ideal element with its own curves."""

    name: str
    curves: tuple[Curve, ...]
    behaviour: Behaviour
    surface: Surface | None = None


@dataclass
class _Portion:
    """Part of a curve on which no other curve ends, with its owners."""

    curve: Curve
    owners: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class Arranged:
    """Regions and interfaces, and the elements that are not supported, each with the reason."""

    regions: tuple[Region, ...]
    interfaces: tuple[Interface, ...]
    rejected: tuple[tuple[str, str], ...]


def arranged(parts: Sequence[Glass | Element], tolerance: float, colours: bool) -> Arranged:
    """Divide the plane by glasses and elements; points closer than the tolerance coincide.

    If several objects share a segment, its behaviour is determined by an element if there is one, otherwise by the
    first glass. The same object supplies the name and determines whether there is partial reflection. With ``colours``,
    indices depend on the wavelength.
    """
    glasses = [part for part in parts if isinstance(part, Glass)]
    region_names: dict[Levels, str] = {}
    interfaces: list[Interface] = []
    rejected: dict[str, str] = {}
    counts: dict[str, int] = {}
    for portion in _portions(parts, tolerance):
        owners = [parts[i] for i in portion.owners]
        left, right = (_levels(glasses, portion.curve, side * 4.0 * tolerance) for side in (1.0, -1.0))
        principal = next((owner for owner in owners if isinstance(owner, Element)), owners[0])
        if left == right and isinstance(principal, Glass):
            continue
        if left != right and isinstance(principal, Element) and principal.behaviour in ("splitter", "lens"):
            rejected[principal.name] = f"is a {principal.behaviour} on a glass surface, which is not supported"
            continue
        if isinstance(principal, Element) and principal.behaviour == "grating" and any(left + right):
            rejected[principal.name] = "is a grating in or on glass, where ray-optics uses the wavelength in air"
            continue
        if sum(isinstance(owner, Element) for owner in owners) > 1:
            rejected[next(o.name for o in owners if isinstance(o, Element) and o is not principal)] = (
                f"lies on {principal.name}"
            )
        counts[principal.name] = counts.get(principal.name, 0) + 1
        sides = (region_names.setdefault(levels, _region_name(glasses, levels)) for levels in (left, right))
        interfaces.append(_interface(f"{principal.name}.{counts[principal.name]}", portion.curve, principal, *sides))
    region_names.setdefault((0,) * len(glasses), AIR)
    regions = tuple(_region(name, glasses, levels, colours) for levels, name in region_names.items())
    return Arranged(regions, tuple(interfaces), tuple(rejected.items()))


def _interface(name: str, curve: Curve, principal: Glass | Element, left: str, right: str) -> Interface:
    if isinstance(principal, Element):
        return Interface(name, curve, left, right, principal.behaviour, surface=principal.surface)
    return Interface(name, curve, left, right, surface=None if principal.partial else Surface(partial=False))


def _region_name(glasses: Sequence[Glass], levels: Levels) -> str:
    names = [_power(glass.name, level) for glass, level in zip(glasses, levels, strict=True) if level]
    return "*".join(names) or AIR


def _power(name: str, level: int) -> str:
    return name if level == 1 else f"{name}^{level}"


def _region(name: str, glasses: Sequence[Glass], levels: Levels, colours: bool) -> Region:
    members = [(glass, level) for glass, level in zip(glasses, levels, strict=True) if level]
    if not colours or not any(glass.b_um2 for glass, _ in members):
        return Region(name, math.prod(glass.a**level for glass, level in members))
    if min(level for _, level in members) < 0:
        raise DesignError(
            f"region {name}",
            limit="contains a dispersive glass that is outside its outline",
            remedy="reverse the direction of the outline",
        )
    return Region(name, _product([glass for glass, level in members for _ in range(level)]))


def _product(glasses: Iterable[Glass]) -> Cauchy:
    """Return Cauchy's formula for the product of at most two dispersive glasses; a third would need a term in 1/λ⁶."""
    a, b, c = 1.0, 0.0, 0.0
    for glass in glasses:
        if c and glass.b_um2:
            limit = "is a third dispersive glass at the same position, but only two may overlap"
            raise DesignError(f"glass {glass.name}", limit=limit, remedy="set cauchyB of one of the glasses to 0")
        a, b, c = a * glass.a, a * glass.b_um2 + b * glass.a, b * glass.b_um2 + c * glass.a
    return Cauchy(A=a, B_um2=b, C_um4=c)


def _portions(parts: Sequence[Glass | Element], tolerance: float) -> list[_Portion]:
    portions = [
        _Portion(piece, [i])
        for i, owner in enumerate(parts)
        for curve in (owner.outline if isinstance(owner, Glass) else owner.curves)
        for piece in without_loops(curve)
    ]
    return _divided_at_crossings(_united(_divided_at_ends(portions, tolerance), tolerance), tolerance)


def _divided_at_ends(portions: list[_Portion], tolerance: float) -> list[_Portion]:
    """Divide segments wherever another segment ends on them."""
    ends = [point for portion in portions for point in (portion.curve.start, portion.curve.end)]
    corners = np.array(ends)
    divided: list[_Portion] = []
    for portion in portions:
        near = _near(portion.curve, corners, tolerance)
        cuts = [parameter_of(portion.curve, ends[i], tolerance) for i in near]
        divided += _cut(portion, [u for u in cuts if u is not None], tolerance)
    return divided


def _near(curve: Curve, points: np.ndarray, tolerance: float) -> list[int]:
    """Return the indices of the points within the bounding box of a curve."""
    low, high = _box(curve)
    return np.flatnonzero(np.all((points >= low - tolerance) & (points <= high + tolerance), axis=1)).tolist()


def _box(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    points = curve.points(np.linspace(0.0, 1.0, 129))
    margin = 0.0 if isinstance(curve, Segment) else float(np.hypot(*np.diff(points, axis=0).T).max())
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _cut(portion: _Portion, cuts: Iterable[float], tolerance: float) -> list[_Portion]:
    """Cut a segment at these parameters, ignoring any within the tolerance of another cut or of an end."""
    curve = portion.curve
    ends = [0.0]
    for u in sorted(cuts):
        cut, last, end = curve.points(np.array([u, ends[-1], 1.0]))
        if u > ends[-1] and min(math.dist(cut, last), math.dist(cut, end)) > tolerance:
            ends.append(u)
    return [_Portion(part(curve, low, high), list(portion.owners)) for low, high in pairwise([*ends, 1.0])]


def _united(portions: list[_Portion], tolerance: float) -> list[_Portion]:
    """Merge coinciding segments and their owners; an outline that passes along a segment twice is listed twice."""
    united: list[_Portion] = []
    for portion in portions:
        same = next((other for other in united if _coincide(portion.curve, other.curve, tolerance)), None)
        if same is None:
            united.append(portion)
        else:
            same.owners += portion.owners
    for portion in united:
        portion.owners.sort()
    return united


def _coincide(a: Curve, b: Curve, tolerance: float) -> bool:
    same_direction = (math.dist(a.start, b.start), math.dist(a.end, b.end))
    opposite_direction = (math.dist(a.start, b.end), math.dist(a.end, b.start))
    if min(max(same_direction), max(opposite_direction)) > 2.0 * tolerance:
        return False
    return parameter_of(b, a.middle_point, 2.0 * tolerance) is not None


def _divided_at_crossings(portions: list[_Portion], tolerance: float) -> list[_Portion]:
    cuts: list[list[float]] = [[] for _ in portions]
    boxes = [_box(portion.curve) for portion in portions]
    for i, j in combinations(range(len(portions)), 2):
        if np.any(np.maximum(boxes[i][0], boxes[j][0]) > np.minimum(boxes[i][1], boxes[j][1])):
            continue
        for u, v in crossings(portions[i].curve, portions[j].curve, tolerance):
            cuts[i].append(u)
            cuts[j].append(v)
    pairs = zip(portions, cuts, strict=True)
    return [piece for portion, cuts in pairs for piece in _cut(portion, cuts, tolerance)]


def _levels(glasses: Sequence[Glass], curve: Curve, offset_mm: float) -> Levels:
    """Return how many times each glass encloses the point at the distance ``offset_mm`` to the left of a curve."""
    at = curve.point_at(SIDE_POINT)
    point = along(at, curve.normal_at(at), offset_mm)
    return tuple(_level(glass, point) for glass in glasses)


def _level(glass: Glass, point: Point) -> int:
    if glass.endless:
        line = glass.outline[0]
        return int(cross(minus(line.end, line.start), minus(point, line.start)) < 0.0)
    return sorted(_winding(glass, point, direction) for direction in DIRECTIONS)[1]


def _winding(glass: Glass, point: Point, direction: Point) -> int:
    """Count the crossings of a ray with a glass outline: modulo 2, or with signs if the outline is oriented."""
    total = 0
    for curve in glass.outline:
        for t in curve.hits(point, direction):
            total += _sign(curve, along(point, direction, t), direction)
    return total if glass.oriented else total % 2


def _sign(curve: Curve, at: Point, direction: Point) -> int:
    """Return 1 if a ray crosses a curve from its left to its right, −1 in the other direction."""
    if isinstance(curve, Facets):
        return curve.sign_at(at, direction)
    return 1 if dot(curve.normal_at(at), direction) < 0.0 else -1

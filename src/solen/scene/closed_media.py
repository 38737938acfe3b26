"""The rule that media are closed: around any point where interfaces end, each region must border the next.

An interface with different regions on its two sides is part of a *boundary* between media. Where it ends, other
interfaces must begin in such a way that, going counter-clockwise, the region behind each is the region in front of the
next. An interface with the same region on both sides (a mirror, a wall, a receiver in air) may end anywhere.

All ends are grouped into vertices by sorting, and nearly all vertices can be checked from the region names alone. The
curves themselves are needed in only two cases: where three or more curves meet, to find their order around the vertex;
and where the regions do not fit, because the end may then lie in the interior of another curve, which is treated as two
branches, one in each direction.

Errors that only a comparison of complete areas would reveal are not detected, for example a closed body inside a medium
that differs from the one named for its outer side. `solen.scene.overlaps` checks that no two curves coincide or cross.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.curve import END_TOLERANCE_MM, Arc, Curve
from solen.errors import DesignError
from solen.geometry.body import point_text
from solen.plane import Point, along, cross, dot, left_of, right_of

if TYPE_CHECKING:  # the model calls this module
    from solen.scene.model import Interface

TOLERANCE_MM = 2.0 * END_TOLERANCE_MM
"""Ends closer together than this form one vertex: each of two curves extends half of this distance beyond its end,
so that no ray slips between them.
"""
ROUNDING = 1e-14
"""Tolerance relative to the largest coordinate; it exceeds `TOLERANCE_MM` for coordinates above 2 m.

Trigonometric functions and rigid motions have rounding errors of about 1e-15 of a coordinate. The centre of an arc
is included, because the ends of a flat arc are no more accurate than its centre.
"""
NEAR_TANGENT_RAD = 1e-3
"""Curves whose directions at a vertex differ by less than this are ordered by their directions slightly further
along.
"""
COLLINEAR_RAD = 1e-9
"""Curves whose directions still differ by less than this are treated as collinear: any order that fits is accepted."""
BACK_MM = 1.0
"""Distance from the tested point at which the test ray starts when checking whether the point lies on a curve."""
ENDS = np.array([0.0, 1.0])
SAMPLES = np.linspace(0.0, 1.0, 33)


class _Branch(NamedTuple):
    """An interface that leaves a vertex, either in its own direction or in the opposite direction."""

    interface: "Interface"
    at: Point
    forwards: bool
    closed: bool = False

    @property
    def after(self) -> str:
        """Region on the counter-clockwise side of the branch."""
        return self.interface.left if self.forwards else self.interface.right

    @property
    def before(self) -> str:
        """Region on the clockwise side of the branch."""
        return self.interface.right if self.forwards else self.interface.left

    @property
    def end(self) -> str:
        """The end of the curve that is at the vertex."""
        return "start" if self.forwards else "end"

    def angle(self, step_mm: float) -> float:
        """Direction in which the curve leaves the vertex.

        This is the direction of the chord to the point ``step_mm`` further along the curve, or of the tangent if
        ``step_mm`` is 0.
        """
        curve = self.interface.curve
        # a closed curve may have a corner where it begins, and two normals there
        at = curve.point_at(1e-6 if self.forwards else 1.0 - 1e-6) if self.closed else self.at
        out = self._out(curve.normal_at(at))
        angle = math.atan2(out[1], out[0])
        if step_mm == 0.0:
            return angle
        ahead = self._out(curve.normal_at(along(at, out, step_mm)))
        return angle + 0.5 * math.atan2(cross(out, ahead), dot(out, ahead))

    def _out(self, normal: Point) -> Point:
        return right_of(normal) if self.forwards else left_of(normal)


def check_closed(interfaces: Sequence["Interface"]) -> None:
    """Check that the interfaces enclose all media.

    Raises
    ------
    DesignError
        If a boundary between media has a free end; the message gives the interface, the location and the gap to the
        nearest other end. Also if the media around a vertex do not fit; the message gives two neighbouring interfaces
        and the regions that they name.
    """
    if all(_within_one_medium(interface) for interface in interfaces):
        return
    ends = np.array([interface.curve.points(ENDS) for interface in interfaces]).reshape(-1, 2)
    tolerance_mm = tolerance_of(interfaces, ends)
    vertices = _vertices(interfaces, ends, tolerance_mm)
    doubtful = [vertex for vertex in vertices if not _fits(vertex)]
    if not doubtful:
        return
    # an open end is compared with other open ends first, if there are any
    partners = [[branch for vertex in group for branch in vertex] for group in (doubtful, vertices)]
    boxes = _boxes(interfaces, tolerance_mm)
    for vertex in doubtful:
        through = _passing(vertex, interfaces, boxes, tolerance_mm)
        vertex.extend(_Branch(interface, vertex[0].at, forwards) for interface in through for forwards in (True, False))
        if _fits(vertex):
            continue
        boundary = [branch for branch in vertex if not _within_one_medium(branch.interface)]
        raise _gap(boundary[0], interfaces, partners) if len(boundary) == 1 else _misfit(vertex, through)


def _within_one_medium(interface: "Interface") -> bool:
    """Whether the interface has the same region on both sides, and may therefore have free ends."""
    return interface.left == interface.right


def tolerance_of(interfaces: Sequence["Interface"], ends: FloatArray) -> float:
    """Maximum distance in mm between ends that form one vertex.

    This is `TOLERANCE_MM`, or the rounding error of the largest coordinate if that is larger.
    """
    centers = [abs(x) for i in interfaces if isinstance(i.curve, Arc) for x in i.curve.center]
    return max(TOLERANCE_MM, ROUNDING * max(float(np.max(np.abs(ends))), *centers, 0.0))


def _vertices(interfaces: Sequence["Interface"], ends: FloatArray, tolerance_mm: float) -> list[list[_Branch]]:
    """Return all branches, grouped by the vertex that they leave."""
    labels = _labels(ends, tolerance_mm).tolist()
    vertices: dict[int, list[_Branch]] = {}
    for k, (label, (x, z)) in enumerate(zip(labels, ends.tolist(), strict=True)):
        closed = labels[k] == labels[k ^ 1]
        vertices.setdefault(label, []).append(_Branch(interfaces[k // 2], (x, z), k % 2 == 0, closed))
    return list(vertices.values())


def _labels(points: FloatArray, tolerance_mm: float) -> IndexArray:
    """Return group numbers (N,), which are equal for coinciding points.

    Points sorted along x are split wherever neighbours are further apart than the tolerance. Each group is then split
    along z in the same way, and so on until no group splits further. This takes N log N steps even for collinear
    points.
    """
    labels = np.zeros(len(points), dtype=np.intp)
    count = 0
    while count < (count := int(labels.max()) + 1):
        for axis in (0, 1):
            order = np.lexsort((points[:, axis], labels))
            with np.errstate(over="ignore"):  # differences of coordinates of 1e308 may overflow
                separated = np.diff(points[order, axis]) > tolerance_mm
            labels[order[1:]] = np.cumsum(separated | (np.diff(labels[order]) > 0))
            labels[order[0]] = 0
    return labels


def _fits(vertex: list[_Branch]) -> bool:
    """Whether each region around a vertex ends where the next begins; walls within one medium may have free ends."""
    if all(_within_one_medium(branch.interface) for branch in vertex):
        return True
    return len(vertex) > 1 and all(a.after == b.before for a, b in _neighbours(vertex))


def _neighbours(vertex: list[_Branch]) -> list[tuple[_Branch, _Branch]]:
    """Pairs of neighbouring branches, counter-clockwise; among collinear branches, one that fits is placed first."""
    groups = (
        _in_order(vertex) if len(vertex) > 2 else [[branch] for branch in vertex]
    )  # two branches have only one order
    first = next((i for i, group in enumerate(groups) if len(group) == 1), 0)
    chain: list[_Branch] = []
    for group in (*groups[first:], *groups[:first]):
        left = list(group)
        while left:
            region = chain[-1].after if chain else left[0].before
            fit = [(branch.before != region, branch.after != region) for branch in left]
            chain.append(left.pop(fit.index(min(fit))))
    return list(pairwise([*chain, chain[0]]))


def _in_order(vertex: list[_Branch]) -> list[list[_Branch]]:
    """Branches in counter-clockwise order, with collinear branches in one group."""
    angles = [branch.angle(0.0) for branch in vertex]
    order, gaps = _sorted(angles)
    if min(gaps) < NEAR_TANGENT_RAD:
        # if tangents agree, curvature decides; the step is so short that no curves cross within it
        step_mm = 1e-3 * min(_size_mm(branch.interface.curve) for branch in vertex)
        order, gaps = _sorted([branch.angle(step_mm) for branch in vertex])
    groups: list[list[_Branch]] = []
    for i, gap in zip(order, gaps, strict=True):
        if gap < COLLINEAR_RAD and groups:
            groups[-1].append(vertex[i])
        else:
            groups.append([vertex[i]])
    return groups


def _sorted(angles: list[float]) -> tuple[list[int], list[float]]:
    """Order of the angles and the gap before each, starting after the largest gap so that no group is split."""
    turns = [math.remainder(angle, math.tau) for angle in angles]
    order = sorted(range(len(turns)), key=turns.__getitem__)
    gaps = [(turns[i] - turns[order[k - 1]]) % math.tau for k, i in enumerate(order)]
    widest = gaps.index(max(gaps))
    return order[widest:] + order[:widest], gaps[widest:] + gaps[:widest]


def _size_mm(curve: Curve) -> float:
    start, middle, end = curve.points(np.array([0.0, 0.5, 1.0])).tolist()
    return max(math.dist(start, middle), math.dist(middle, end))


def _boxes(interfaces: Sequence["Interface"], tolerance_mm: float) -> FloatArray:
    """Bounding boxes (N, 4) of the curves: lowest x and z, highest x and z.

    A curve deviates from its sampled points by less than the point spacing, which is used as the margin of the box.
    """
    points = np.array([interface.curve.points(SAMPLES) for interface in interfaces])
    with np.errstate(over="ignore"):
        margin = np.hypot(*np.moveaxis(np.diff(points, axis=1), 2, 0)).max(axis=1) + tolerance_mm
        return np.hstack([points.min(axis=1) - margin[:, None], points.max(axis=1) + margin[:, None]])


def _passing(
    vertex: list[_Branch], interfaces: Sequence["Interface"], boxes: FloatArray, tolerance_mm: float
) -> list["Interface"]:
    """Return the interfaces that pass through a vertex without ending there."""
    at = vertex[0].at
    ending = {branch.interface.name for branch in vertex}
    near = np.flatnonzero(((boxes[:, :2] <= at) & (boxes[:, 2:] >= at)).all(axis=1)).tolist()
    return [
        interfaces[k]
        for k in near
        if interfaces[k].name not in ending and passes_through(interfaces[k].curve, at, tolerance_mm)
    ]


def passes_through(curve: Curve, point: Point, tolerance_mm: float) -> bool:
    """Whether a curve passes through a point, within a tolerance."""
    rays = [(along(point, direction, -BACK_MM), direction) for direction in ((1.0, 0.0), (0.0, 1.0))]
    return any(abs(t - BACK_MM) <= tolerance_mm for ray in rays for t in curve.hits(*ray))


def _gap(branch: _Branch, interfaces: Sequence["Interface"], partners: list[list[_Branch]]) -> DesignError:
    """Return the error for a boundary with a free end."""
    name = branch.interface.name
    others = ([b for b in group if b is not branch and not _within_one_medium(b.interface)] for group in partners)
    other = min(next(filter(None, others)), key=lambda other: math.dist(other.at, branch.at))
    gap_mm, target = math.dist(other.at, branch.at), f"{other.end} of {other.interface.name}"
    extension_mm, side = _nearest_side(branch, interfaces)
    if extension_mm < 0.1 * gap_mm:  # so much closer that the boundary was probably meant to end there
        gap_mm, target = extension_mm, f"side of {side}"
    return DesignError(
        f"interface {name}",
        limit=f"is not closed at its {branch.end}: there is a gap of {gap_mm:.3g} mm at {point_text(branch.at)} to the "
        f"{target}; the interface separates {branch.interface.left} and {branch.interface.right}, so another boundary "
        "must continue from this end",
        remedy="join the ends, specify the same region on both sides, or set open_media",
    )


def _nearest_side(branch: _Branch, interfaces: Sequence["Interface"]) -> tuple[float, str]:
    """Return the smallest distance along the tangent from an end to another boundary, and the name of that boundary."""
    angle = branch.angle(0.0)
    out = (math.cos(angle), math.sin(angle))
    nearest_side = [(math.inf, "")]
    for interface in interfaces:
        if interface.name != branch.interface.name and not _within_one_medium(interface):
            for direction in (out, (-out[0], -out[1])):
                nearest_side.extend((t, interface.name) for t in interface.curve.hits(branch.at, direction))
    return min(nearest_side)


def _misfit(vertex: list[_Branch], through: list["Interface"]) -> DesignError:
    """Return the error for media that do not fit."""
    a, b = next((a, b) for a, b in _neighbours(vertex) if a.after != b.before)
    remedy = "swap the left and right regions of the wrong interface, or reverse its curve"
    if through:  # a curve that passes through has the same two media on both sides of this point
        remedy = f"divide {' and '.join(interface.name for interface in through)} at this point, or {remedy}"
    return DesignError(
        f"interfaces {a.interface.name} and {b.interface.name}",
        limit=f"media do not fit at {point_text(a.at)}: in the sector between them, {a.interface.name} specifies "
        f"{a.after} and {b.interface.name} specifies {b.before}",
        remedy=remedy,
    )

"""Strokes chained into closed outlines.

Ends within ``join_mm`` of each other form one corner, and the curves are made to meet there: lines, arcs and free-form
curves are deformed slightly, other curves stay unchanged and determine the corner. Open ends, branches and duplicates
raise errors with their location. Receivers, mirrors and black faces may be separate objects in air.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.curve import Arc, Bezier, Curve, Measure, Segment, Spline
from solen.errors import DesignError
from solen.geometry.body import GAP_MM, Face, place_text
from solen.geometry.drawing import Stroke
from solen.geometry.walls import DARK
from solen.plane import Point, minus

DEFORMABLE = (Segment, Arc, Bezier, Spline)
"""Kinds of curves that are deformed to meet others."""
QUARTERS = (0.25, 0.5, 0.75)


class Joints:
    """Stroke ends, grouped by corner."""

    def __init__(self, strokes: Sequence[Stroke], join_mm: float) -> None:
        self.strokes = [stroke for stroke in strokes if not _is_crumb(stroke.curve, join_mm)]
        self.join_mm = join_mm
        self.ends = np.array([(stroke.curve.start, stroke.curve.end) for stroke in self.strokes]).reshape(-1, 2)
        self.label = _labels(self.ends, join_mm)
        self.members: dict[int, list[int]] = {}
        for end, label in enumerate(self.label):
            self.members.setdefault(int(label), []).append(end)

    def chains(self) -> list[list[int]]:
        """Return connected groups of strokes, by number."""
        left, rows = set(range(len(self.strokes))), []
        while left:
            group, waiting = set[int](), [min(left)]
            while waiting:
                stroke = waiting.pop()
                if stroke not in group:
                    group.add(stroke)
                    ends = (end for side in (0, 1) for end in self.members[int(self.label[2 * stroke + side])])
                    waiting += [end // 2 for end in ends]
            rows.append(sorted(group))
            left -= group
        return rows

    def point(self, label: int) -> Point:
        """Position of a corner: the end of a curve that cannot be changed, otherwise halfway between the ends."""
        members = self.members[label]
        stiff = [end for end in members if not isinstance(self.strokes[end // 2].curve, DEFORMABLE)]
        x, z = self.ends[stiff[:1] or members].mean(axis=0)
        return (float(x), float(z))

    def joined(self, stroke: int) -> Curve:
        """Return the curve of a stroke from corner to corner."""
        first, last = (self.point(int(self.label[2 * stroke + side])) for side in (0, 1))
        return _between(self.strokes[stroke].curve, first, last)


def closed_outlines(strokes: Sequence[Stroke], join_mm: float) -> tuple[list[list[Face]], list[Face]]:
    """Return closed outlines, each with its faces in order, and the separate faces.

    Raises
    ------
    DesignError
        If an outline is open or branches, or a stroke is drawn twice; the message reports the position.
    """
    if not strokes:
        raise DesignError("body outline", value="no strokes", limit="the drawing is empty", remedy="check its layers")
    joints = Joints(strokes, join_mm)
    _check_twice(joints)
    outlines: list[list[Face]] = []
    alone: list[Face] = []
    for chain in joints.chains():
        faulty = [label for label in _corners(joints, chain) if len(joints.members[label]) != 2]
        if not faulty:
            outlines.append(_walked(joints, chain))
        elif all(Face(joints.strokes[i].name, joints.strokes[i].curve).part in DARK for i in chain):
            alone += [Face(joints.strokes[i].name, joints.strokes[i].curve) for i in chain]
        else:
            raise _fault(joints, faulty)
    if not outlines:
        raise DesignError("body outline", value="no closed outline", limit="a body requires a closed outline")
    return outlines, alone


def _is_crumb(curve: Curve, join_mm: float) -> bool:
    """Return whether an entire curve would collapse into one corner."""
    return math.dist(curve.start, curve.end) <= join_mm and Measure(curve).length_mm <= 2.0 * join_mm


def _labels(ends: FloatArray, join_mm: float) -> NDArray[np.int32]:
    """Return group numbers (N,), equal for coinciding ends."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    pairs = KDTree(ends).query_pairs(join_mm, output_type="ndarray").reshape(-1, 2)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(ends), len(ends)))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int32)


def _corners(joints: Joints, chain: list[int]) -> list[int]:
    return sorted({int(joints.label[2 * stroke + side]) for stroke in chain for side in (0, 1)})


def _check_twice(joints: Joints) -> None:
    """Raise `DesignError` if two strokes coincide."""
    seen: dict[tuple[int, ...], list[int]] = {}
    for i in range(len(joints.strokes)):
        key = tuple(sorted(int(label) for label in joints.label[2 * i : 2 * i + 2]))
        for other in seen.setdefault(key, []):
            if _same(joints.strokes[i].curve, joints.strokes[other].curve, joints.join_mm):
                first, second = joints.strokes[other], joints.strokes[i]
                raise DesignError(
                    "body outline",
                    value=f"{second.name} drawn twice",
                    limit=f"{first.what} and {second.what} coincide at {place_text(second.curve.middle_point)}",
                    remedy="delete one of the two",
                )
        seen[key].append(i)


def _same(a: Curve, b: Curve, join_mm: float) -> bool:
    places = [_quarters(curve) for curve in (a, b, b.reversed())]
    return any(float(np.hypot(*(places[0] - other).T).max()) <= join_mm for other in places[1:])


def _quarters(curve: Curve) -> FloatArray:
    measure = Measure(curve)
    return curve.points(np.array([measure.u_at(share * measure.length_mm) for share in QUARTERS]))


def _walked(joints: Joints, chain: list[int]) -> list[Face]:
    """Return the faces of a closed chain in order."""
    faces: list[Face] = []
    stroke, side = chain[0], 0
    for _ in chain:
        curve = joints.joined(stroke)
        faces.append(Face(joints.strokes[stroke].name, curve if side == 0 else curve.reversed()))
        arrived = 2 * stroke + 1 - side
        first, second = joints.members[int(joints.label[arrived])]
        following = second if first == arrived else first
        stroke, side = divmod(following, 2)
    return faces


def _fault(joints: Joints, faulty: list[int]) -> DesignError:
    """Return the error for a chain that does not close: it reports a free end if there is one, otherwise a branch."""
    single = [label for label in faulty if len(joints.members[label]) == 1]
    if not single:
        members = joints.members[faulty[0]]
        names = ", ".join(sorted({joints.strokes[end // 2].name for end in members}))
        return DesignError(
            "body outline",
            value=f"{len(members)} curves meet at {place_text(joints.point(faulty[0]))}",
            limit=f"an outline continues with a single curve, but these curves meet here: {names}",
            remedy="delete the extra curves, or draw notes on a layer whose name begins with _",
        )
    end = joints.members[single[0]][0]
    at = joints.ends[end]
    apart = np.hypot(*(joints.ends - at).T)
    apart[end] = np.inf
    loose = [k for (k, *more) in joints.members.values() if not more and k != end]
    other = min(loose or range(len(apart)), key=lambda k: float(apart[k]))
    return DesignError(
        "body outline",
        value=f"open at the end of {joints.strokes[end // 2].name}",
        limit=f"there is a gap of {apart[other]:.4g} mm from {place_text((float(at[0]), float(at[1])))} to the end of "
        f"{joints.strokes[other // 2].name}",
        remedy="close it, or increase body.join_mm",
    )


def _between(curve: Curve, first: Point, last: Point) -> Curve:
    """Return the curve with its ends moved to two corners."""
    if math.dist(curve.start, first) <= GAP_MM / 4 and math.dist(curve.end, last) <= GAP_MM / 4:
        return curve
    if isinstance(curve, Segment):
        return Segment(first, last)
    if isinstance(curve, Arc):
        return _arc(curve, first, last)
    if isinstance(curve, Bezier):
        return Bezier(*_shifted(curve.controls[0], first, last))
    if isinstance(curve, Spline):
        return Spline(_shifted(curve.control_points, first, last))
    raise DesignError(
        "body outline",
        value=f"a {type(curve).__name__} from {place_text(curve.start)}",
        limit=f"does not meet its neighbours to within {GAP_MM:g} mm",
        remedy="make its ends exact: this kind of curve cannot be deformed",
    )


def _arc(arc: Arc, first: Point, last: Point) -> Arc:
    """Return the arc of the same angle between two corners: rotated and scaled."""
    if math.dist(first, last) == 0.0:
        return arc
    chord, wanted = complex(*minus(arc.end, arc.start)), complex(*minus(last, first))
    factor = wanted / chord
    center = complex(*first) + factor * complex(*minus(arc.center, arc.start))
    start_deg = arc.start_deg + math.degrees(cmath.phase(factor))
    return replace(arc, center=(center.real, center.imag), radius_mm=arc.radius_mm * abs(factor), start_deg=start_deg)


def _shifted(points: tuple[Point, ...], first: Point, last: Point) -> tuple[Point, ...]:
    """Return control points after moving both ends together with their handles."""
    start, end = minus(first, points[0]), minus(last, points[-1])
    before = (points[1][0] + start[0], points[1][1] + start[1])
    behind = (points[-2][0] + end[0], points[-2][1] + end[1])
    return (first, before, *points[2:-2], behind, last)

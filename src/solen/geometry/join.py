"""Strokes chained into closed outlines.

Ends within ``join_mm`` of each other form one corner, and the curves are made to meet there: lines, arcs and free-form
curves are deformed slightly; other curves remain unchanged and determine the corner. Errors report the position of open
ends, branches and duplicates. Receivers, mirrors and black faces may be separate objects in air.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, ArcLength, Bezier, Curve, Segment, Spline
from solen.errors import DesignError
from solen.geometry.body import GAP_MM, Face, point_text
from solen.geometry.drawing import Stroke
from solen.geometry.walls import DARK
from solen.plane import Point, minus

DEFORMABLE = (Segment, Arc, Bezier, Spline)
"""Kinds of curves that may be deformed to meet others."""
SAMPLE_FRACTIONS = (0.25, 0.5, 0.75)


class Joints:
    """The ends of strokes, grouped into corners. Ends 2i and 2i + 1 belong to stroke i."""

    def __init__(self, strokes: Sequence[Stroke], join_mm: float) -> None:
        self.strokes = [stroke for stroke in strokes if not _is_negligible(stroke.curve, join_mm)]
        self.join_mm = join_mm
        self.ends = np.array([(stroke.curve.start, stroke.curve.end) for stroke in self.strokes]).reshape(-1, 2)
        self.corner = _corners_of_ends(self.ends, join_mm)
        self.members: dict[int, list[int]] = {}
        for end, corner in enumerate(self.corner):
            self.members.setdefault(corner, []).append(end)

    def chains(self) -> list[list[int]]:
        """Return the connected groups of strokes, as sorted indices."""
        unvisited, chains = set(range(len(self.strokes))), []
        while unvisited:
            chain, pending = set[int](), [min(unvisited)]
            while pending:
                stroke = pending.pop()
                if stroke not in chain:
                    chain.add(stroke)
                    ends = (end for side in (0, 1) for end in self.members[self.corner[2 * stroke + side]])
                    pending += [end // 2 for end in ends]
            chains.append(sorted(chain))
            unvisited -= chain
        return chains

    def point(self, corner: int) -> Point:
        """Return the position of a corner: the end of a curve that cannot be deformed, or the mean of the ends."""
        members = self.members[corner]
        fixed = [end for end in members if not isinstance(self.strokes[end // 2].curve, DEFORMABLE)]
        x, z = self.ends[fixed[:1] or members].mean(axis=0)
        return (float(x), float(z))

    def joined_curve(self, stroke: int) -> Curve:
        """Return the curve of a stroke from corner to corner."""
        first, last = (self.point(self.corner[2 * stroke + side]) for side in (0, 1))
        return _between(self.strokes[stroke].curve, first, last)


def closed_outlines(strokes: Sequence[Stroke], join_mm: float) -> tuple[list[list[Face]], list[Face]]:
    """Return the closed outlines, each with its faces in order, and the separate faces.

    Raises
    ------
    DesignError
        If an outline is open or branches, or a stroke is drawn twice; the message contains the position.
    """
    if not strokes:
        raise DesignError("body outline", limit="the drawing contains no curves", remedy="show the layers of the body")
    joints = Joints(strokes, join_mm)
    _check_duplicates(joints)
    outlines: list[list[Face]] = []
    separate: list[Face] = []
    for chain in joints.chains():
        faulty_corners = [corner for corner in _corners_of_chain(joints, chain) if len(joints.members[corner]) != 2]
        if not faulty_corners:
            outlines.append(_faces_in_order(joints, chain))
        elif all(Face(joints.strokes[i].name, joints.strokes[i].curve).part in DARK for i in chain):
            separate += [Face(joints.strokes[i].name, joints.strokes[i].curve) for i in chain]
        else:
            raise _open_chain_error(joints, faulty_corners)
    if not outlines:
        raise DesignError("body outline", limit="no outline is closed, but a body requires one")
    return outlines, separate


def _is_negligible(curve: Curve, join_mm: float) -> bool:
    """Return whether a curve is so short that both its ends would form the same corner."""
    return math.dist(curve.start, curve.end) <= join_mm and ArcLength(curve).length_mm <= 2.0 * join_mm


def _corners_of_ends(ends: FloatArray, join_mm: float) -> list[int]:
    """Return the number of the corner to which each end belongs."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    pairs = KDTree(ends).query_pairs(join_mm, output_type="ndarray").reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(ends), len(ends)))
    _, corners = connected_components(graph, directed=False)
    return [int(corner) for corner in corners]


def _corners_of_chain(joints: Joints, chain: list[int]) -> list[int]:
    return sorted({joints.corner[2 * stroke + side] for stroke in chain for side in (0, 1)})


def _check_duplicates(joints: Joints) -> None:
    """Raise `DesignError` if two strokes coincide."""
    strokes_by_ends: dict[tuple[int, ...], list[int]] = {}
    for i in range(len(joints.strokes)):
        key = tuple(sorted(joints.corner[2 * i : 2 * i + 2]))
        for earlier in strokes_by_ends.setdefault(key, []):
            if _coincide(joints.strokes[i].curve, joints.strokes[earlier].curve, joints.join_mm):
                first, second = joints.strokes[earlier], joints.strokes[i]
                raise DesignError(
                    "body outline",
                    limit=f"{second.name} is drawn twice: {first.what} and {second.what} coincide at "
                    f"{point_text(second.curve.middle_point)}",
                    remedy="delete one of the two",
                )
        strokes_by_ends[key].append(i)


def _coincide(a: Curve, b: Curve, join_mm: float) -> bool:
    samples = [_sampled(curve) for curve in (a, b, b.reversed())]
    return any(float(np.hypot(*(samples[0] - other).T).max()) <= join_mm for other in samples[1:])


def _sampled(curve: Curve) -> FloatArray:
    measure = ArcLength(curve)
    return curve.points(np.array([measure.u_at(fraction * measure.length_mm) for fraction in SAMPLE_FRACTIONS]))


def _faces_in_order(joints: Joints, chain: list[int]) -> list[Face]:
    """Return the faces of a closed chain in order."""
    faces: list[Face] = []
    stroke, side = chain[0], 0
    for _ in chain:
        curve = joints.joined_curve(stroke)
        faces.append(Face(joints.strokes[stroke].name, curve if side == 0 else curve.reversed()))
        end = 2 * stroke + 1 - side
        first, second = joints.members[joints.corner[end]]
        next_end = second if first == end else first
        stroke, side = divmod(next_end, 2)
    return faces


def _open_chain_error(joints: Joints, faulty_corners: list[int]) -> DesignError:
    """Return the error for a chain that does not close: it reports a free end if there is one, otherwise a branch."""
    free = [corner for corner in faulty_corners if len(joints.members[corner]) == 1]
    if not free:
        members = joints.members[faulty_corners[0]]
        names = ", ".join(sorted({joints.strokes[end // 2].name for end in members}))
        return DesignError(
            "body outline",
            limit=f"{len(members)} curves meet at {point_text(joints.point(faulty_corners[0]))} ({names}), but an "
            "outline continues with a single curve",
            remedy="delete the extra curves, or draw notes on a layer whose name begins with _",
        )
    end = joints.members[free[0]][0]
    x, z = joints.ends[end].tolist()
    distances = np.hypot(*(joints.ends - (x, z)).T)
    distances[end] = np.inf
    other_free = [k for (k, *more) in joints.members.values() if not more and k != end]
    nearest = min(other_free or range(len(distances)), key=lambda k: float(distances[k]))
    return DesignError(
        "body outline",
        limit=f"is open at the end of {joints.strokes[end // 2].name} ({point_text((x, z))}), "
        f"{distances[nearest]:.4g} mm from the end of {joints.strokes[nearest // 2].name}",
        remedy="close the gap, or increase body.join_mm",
    )


def _between(curve: Curve, first: Point, last: Point) -> Curve:
    """Return the curve, deformed so that it runs from one corner to another."""
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
        limit=f"a {type(curve).__name__} from {point_text(curve.start)} does not meet its neighbours to within "
        f"{GAP_MM:g} mm, and curves of this kind cannot be deformed",
        remedy="make its end points coincide with those of its neighbours",
    )


def _arc(arc: Arc, first: Point, last: Point) -> Arc:
    """Return the arc, rotated and scaled so that it runs between two corners."""
    if math.dist(first, last) == 0.0:
        return arc
    chord, required = complex(*minus(arc.end, arc.start)), complex(*minus(last, first))
    factor = required / chord
    center = complex(*first) + factor * complex(*minus(arc.center, arc.start))
    start_deg = arc.start_deg + math.degrees(cmath.phase(factor))
    return replace(arc, center=(center.real, center.imag), radius_mm=arc.radius_mm * abs(factor), start_deg=start_deg)


def _shifted(points: tuple[Point, ...], first: Point, last: Point) -> tuple[Point, ...]:
    """Return the control points with both ends, and the handles next to them, moved."""
    start, end = minus(first, points[0]), minus(last, points[-1])
    second = (points[1][0] + start[0], points[1][1] + start[1])
    second_last = (points[-2][0] + end[0], points[-2][1] + end[1])
    return (first, second, *points[2:-2], second_last, last)

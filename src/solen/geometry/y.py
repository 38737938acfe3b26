"""The Y-shaped waveguide: stem, two arms, and a lens at the base of the stem, at any motion angle.

The stem flares: its half width is ``half_width_mm + stem_curve_per_mm u²`` at u above its base. The arms leave the
corners of the fork at ``arm_angle_deg`` to the axis, by default along the tangent of the side of the stem there. This
is an assumption: the figure of the paper with the exact geometry is not public. The inner edges of the arms are
parallel to the outer edges at the arm width and meet on the axis, in the crotch.

``motion.join`` of the design selects how a rotated lens joins the stem. With each option the outline remains closed and
simple, and changes continuously with the angle:

- ``bridge``: if an edge of the lens has moved below the base of the stem, a straight bridge joins it to the corner of
  the stem; if it has moved into the stem, the side of the stem begins at the height of the edge, and a short step joins
  the two. After a rotation of 3° about the centre of the base, the step is 2.8 µm wide.
- ``seam``: a straight seam joins each edge to its corner, even if the edge has moved into the stem.
- ``smooth``: the side of the stem bends. A cubic Bézier curve leaves the edge along the lens axis and joins the side
  tangentially, half a lens width above the edge; without rotation it is the side itself.

A sensor without a lens has a flat face that belongs to the stem and remains fixed while the emitter rotates.

A bend (see `solen.geometry.bend`) curves the stem between its base and its fork; the lens then meets the stem as in the
unbent sensor, and no join is needed.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

from solen.curve import ArcLength, Bezier, Curve, Parabola, Segment, check_numbers
from solen.errors import DesignError
from solen.geometry.bend import bend_of, bent
from solen.geometry.body import GAP_MM, Body, Face, Front, Pose
from solen.geometry.walls import behind_gap, with_walls
from solen.lens import FlatFace, Lens, LensInSpace
from solen.plane import Point, Rigid, along
from solen.spec import Body as BodyTable
from solen.spec import Design, Join, Motion, Wall

JOINS = ("join-right", "join-left")
"""Names of the join faces of a rotated lens."""
MIN_LENGTH_MM, STEP_MM = 1e-8, 1e-6
"""A step between lens and stem that is shorter than the first length is replaced by a step of the second length along
the stem. Such a step occurs if an edge has moved up by less than a few micrometres, as with a measured lens.
"""


@dataclass(frozen=True)
class _Half:
    """One side of the Y; ``side`` is +1 on the right, −1 on the left. Corners are in scene coordinates."""

    side: int
    wall: Parabola
    fork: Point
    outer_end: Point
    inner_end: Point


@dataclass(frozen=True)
class _Plan:
    """The part of a design that determines its Y; designs that differ only in other respects share cached bodies.

    ``emitter`` is the position of the emitter before any motion.
    """

    lens: Lens
    body: BodyTable
    motion: Motion
    wall: tuple[Wall, ...]
    gap_mm: float | None
    emitter: Point

    @classmethod
    def of(cls, design: Design, lens: Lens) -> "_Plan":
        emitter = (design.emitter.offset_mm, -design.emitter.distance_mm)
        return cls(lens, design.body, design.motion, design.wall, design.receivers.gap_mm, emitter)


def y_body(design: Design, lens: Lens, angle_deg: float = 0.0) -> Body:
    """Return the checked body of a design moved to ``angle_deg``; raise `DesignError` if it cannot be built.

    The last 256 bodies are cached.
    """
    check_numbers("angle_deg", angle_deg)
    return _built(_Plan.of(design, lens), angle_deg)


@lru_cache(maxsize=256)
def _built(plan: _Plan, angle_deg: float) -> Body:
    return (_bent(plan, angle_deg) if plan.motion.kind == "bend" else _rotated(plan, angle_deg)).check()


def _rotated(plan: _Plan, angle_deg: float) -> Body:
    """Return the body with its moving parts rotated about the pivot."""
    lens = plan.lens
    moving, rotation = plan.motion.moves, Rigid.about(_pivot(plan), angle_deg)
    emitter = Pose(plan.emitter, 0.0)
    if "emitter" in moving:
        emitter = Pose(rotation.point(emitter.point), angle_deg)
    lens_moves = "lens" in moving and not isinstance(lens, FlatFace)
    front = lens.front.moved(rotation) if lens_moves else lens.front
    right, left = _half(plan, +1), _half(plan, -1)
    crotch = _crotch(plan.body, right)
    join = _Join(plan.motion.join, rotation.vector((0.0, 1.0)) if lens_moves else (0.0, 1.0))
    faces = (
        Face("lens", front),
        *_side("right", right, front.end, crotch, join),
        *(
            replace(face, curve=face.curve.reversed(), from_end=True)
            for face in reversed(_side("left", left, front.start, crotch, join))
        ),
    )
    marks = {"crotch": crotch, "fork-right": right.fork, "fork-left": left.fork, "stem-base": (0.0, lens.depth_mm)}
    faces, separate = behind_gap(faces, plan.gap_mm)
    if "receivers" in moving:
        separate = tuple(replace(face, curve=face.curve.moved(rotation)) for face in separate)
    (walls,) = with_walls((faces,), plan.wall, JOINS if plan.motion.kind == "rotation" and "lens" in moving else ())
    front_in_space = Front("lens", lens, rotation if lens_moves else Rigid()) if isinstance(lens, LensInSpace) else None
    return Body(walls, emitter, marks, separate=separate, front=front_in_space)


def _bent(plan: _Plan, angle_deg: float) -> Body:
    """Return the body with its stem bent from base to fork; lens and emitter move with the base, the arms are fixed."""
    rest = _rotated(plan, 0.0)
    base_mm = plan.lens.depth_mm
    bend = bend_of(plan.motion.centre_line, base_mm, base_mm + plan.body.stem_length_mm, angle_deg)
    base_motion = bend.section_motion(base_mm)

    def moved(face: Face) -> Curve:
        if face.part == "lens":
            return face.curve.moved(base_motion)
        if face.part != "stem":
            return face.curve
        (curve,) = bent(face.curve, bend)
        return curve

    emitter = Pose(base_motion.point(rest.emitter.point), angle_deg)
    marks = {**rest.marks, "stem-base": base_motion.point(rest.marks["stem-base"])}
    faces = tuple(replace(face, curve=moved(face)) for face in rest.faces)
    front = None if rest.front is None else replace(rest.front, motion=base_motion)
    return replace(rest, faces=faces, emitter=emitter, marks=marks, front=front)


def arm_angle_deg(design: Design) -> float:
    """Return the angle of the arms to the axis: as specified, otherwise that of the side of the stem at the fork."""
    return _arm_angle_deg(design.body)


def _arm_angle_deg(body: BodyTable) -> float:
    if body.arm_angle_deg is not None:
        return body.arm_angle_deg
    return math.degrees(math.atan(2.0 * body.stem_curve_per_mm * body.stem_length_mm))


def _pivot(plan: _Plan) -> Point:
    """Return the pivot of the motion; the position of the emitter excludes its decentre, which is an assembly error."""
    pivot = plan.motion.pivot
    if pivot == "stem-base":
        return (0.0, plan.lens.depth_mm)
    if pivot == "emitter":
        return (0.0, plan.emitter[1])
    return pivot


def _half(plan: _Plan, side: int) -> _Half:
    body, lens = plan.body, plan.lens
    angle = math.radians(_arm_angle_deg(body))
    outwards: Point = (side * math.sin(angle), math.cos(angle))
    inwards: Point = (-side * math.cos(angle), math.sin(angle))
    corner: Point = (side * lens.half_width_mm, lens.depth_mm)
    wall = Parabola(corner, (0.0, 1.0), side * body.stem_curve_per_mm, 0.0, body.stem_length_mm)
    outer_end = along(wall.end, outwards, body.arm_length_mm)
    return _Half(side, wall, wall.end, outer_end, along(outer_end, inwards, body.arm_width_mm))


def _crotch(body: BodyTable, right: _Half) -> Point:
    """Return the point on the axis where the inner edges meet."""
    angle_deg = _arm_angle_deg(body)
    if not angle_deg > 0.0:
        raise DesignError(
            "body.stem_curve_per_mm",
            value=body.stem_curve_per_mm,
            limit="must be above 0 if the arms continue the sides of the stem: otherwise they never separate",
            remedy="increase stem_curve_per_mm, or specify body.arm_angle_deg",
        )
    x, z = right.inner_end
    if x <= 0.0:
        widest_mm = body.arm_width_mm + x / math.cos(math.radians(angle_deg))
        bound = f"must be below {widest_mm:.3f} mm" if widest_mm > 0.0 else "no width is possible"
        raise DesignError(
            "body.arm_width_mm",
            value=body.arm_width_mm,
            limit=f"{bound}: the arms do not separate before their ends",
            remedy="make the arms narrower, lengthen them, increase their angle or widen the stem",
        )
    return (0.0, z - x / math.tan(math.radians(angle_deg)))


@dataclass(frozen=True)
class _Join:
    """Joint between the lens edges and the stem; ``axis`` is the axis of the lens."""

    kind: Join
    axis: Point

    def wall(self, side: Parabola, edge: Point) -> Parabola:
        """Return the part of a side of the stem above the point where the joint begins."""
        start_mm = 0.0 if self.kind == "seam" else max(0.0, edge[1] - side.vertex[1])
        if self.kind == "smooth":
            start_mm += abs(side.vertex[0])
        if start_mm >= side.to_mm:
            raise DesignError(
                "motion",
                limit=f"the lens edge joins the stem {start_mm:.3g} mm above its base, but the stem is only "
                f"{side.to_mm:g} mm long",
                remedy="reduce the rotation angle",
            )
        wall = replace(side, from_mm=start_mm)
        if GAP_MM < math.dist(edge, wall.start) < MIN_LENGTH_MM:  # the step is too short to be a face
            return replace(wall, from_mm=start_mm + STEP_MM)
        return wall

    def face(self, edge: Point, wall: Parabola) -> Curve:
        """Return the face between the lens edge and the side of the stem."""
        if self.kind != "smooth":
            return Segment(edge, wall.start)
        third_mm = (wall.start[1] - max(edge[1], wall.vertex[1])) / 3.0
        slope = (2.0 * wall.curve_per_mm * wall.from_mm, 1.0)
        return Bezier(edge, along(edge, self.axis, third_mm), along(wall.start, slope, -third_mm), wall.start)


def _side(name: str, half: _Half, lens_edge: Point, crotch: Point, join: _Join) -> tuple[Face, ...]:
    """Return the faces from the lens edge to the crotch: upwards along the stem, and around the arm."""
    distance_mm = math.dist(lens_edge, half.wall.start)
    wall = half.wall if distance_mm <= GAP_MM else join.wall(half.wall, lens_edge)
    gap_mm = min(distance_mm, math.dist(lens_edge, wall.start))
    if gap_mm > abs(half.wall.vertex[0]):
        raise DesignError(
            "motion",
            limit=f"moves the lens edge {gap_mm:.3g} mm away from the stem; the limit is the half width of the lens, "
            f"{abs(half.wall.vertex[0]):g} mm",
            remedy="reduce the rotation angle, or use a closer pivot",
        )
    curves: list[tuple[str, Curve]] = [
        ("stem", wall),
        ("outer", Segment(half.fork, half.outer_end)),
        ("receiver", Segment(half.outer_end, half.inner_end)),
        ("inner", Segment(half.inner_end, crotch)),
    ]
    if gap_mm > GAP_MM:
        curves.insert(0, ("join", join.face(lens_edge, wall)))
    removed_mm = ArcLength(replace(wall, from_mm=0.0, to_mm=wall.from_mm)).length_mm if wall.from_mm > 0.0 else 0.0
    return tuple(
        Face(f"{part}-{name}", curve, begins_mm=removed_mm if part == "stem" else 0.0) for part, curve in curves
    )

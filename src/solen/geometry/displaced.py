"""A body deformed by a load, displaced point by point: its walls remain exact curves and carry its parts along.

The displacement is specified at points along every wall. A cubic spline through them, as a function of wall length, is
added to the exact wall. The sum is a smooth curve, which is stored as a spline within `SPLINE_MM`, like a bent wall. A
wall that moves as a rigid body remains the same kind of curve: a clamped lens stays an exact oval. Walls stay vertical:
the displacement is in the plane and the same at every height. A notch that closes begins where its walls separate
(`solen.geometry.notches`).

Receivers behind a gap move with the arm ends, and the emitter moves with the faces that carry it, each by the
best-fitting rigid motion of the faces.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Protocol

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Curve, Function, Measure, Spline, carried
from solen.errors import DesignError
from solen.geometry.body import Body, Face, Front
from solen.geometry.notches import ClosedNotch, close_notch
from solen.geometry.walls import called
from solen.plane import Point, Rigid, cross

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

SPLINE_MM = 1e-7
"""Maximum deviation of the spline from a displaced wall."""
RIGID_MM = 2e-12
"""Maximum residual of a rigid motion for a face to keep its kind of curve."""
FRONT_MM = 1e-4
"""Maximum deviation from a rigid motion for a lens that is not a cylinder: its surface in space is moved unchanged."""
LENS = "lens"
"""Name of the lens faces, which carry the emitter by default."""
GROUND = "ground"
"""Value of ``emitter_on`` for an emitter that is fixed in space."""
NEAR = 1e-6
"""Minimum distance from the ends of a curve, as a fraction of its parameter range, for a point to become a joint."""
QUARTERS = np.array([[3.0, 6.0, -1.0], [-1.0, 6.0, 3.0]]) / 8.0
"""Weights of an edge's first, middle and last nodes for a quadratic at a quarter and three quarters of the edge."""


class Moves(Protocol):
    """Displacement of one face: parameters (N,) on its curve, ascending from 0 to 1, and displacements (N, 2) in mm.

    The points are the nodes of quadratic elements: every second node is the midpoint of an edge.
    """

    @property
    def u(self) -> FloatArray: ...  # noqa: D102

    @property
    def displacement_mm(self) -> FloatArray: ...  # noqa: D102


@dataclass(frozen=True)
class Touch:
    """Part of a face between two parameters of its undeformed curve, and the index of its wall table."""

    face: str
    u_from: float
    u_to: float
    wall: int


@dataclass(frozen=True)
class Displaced:
    """A displaced body.

    Attributes
    ----------
    body
        The body, checked.
    carried
        Rigid motion of the emitter: the best fit to the motion of the faces that carry it.
    lens
        Rigid motion that best fits the faces named ``lens``; None if the body has none.
    off_mm
        Maximum deviation of a wall between its nodes from the displacement of its elements.
    closed
        Notches that have closed.
    """

    body: Body
    carried: Rigid
    lens: Rigid | None
    off_mm: float
    closed: tuple[ClosedNotch, ...] = ()


def displaced(
    body: Body, moves: Mapping[str, Moves], emitter_on: str = LENS, touches: Sequence[Touch] = ()
) -> Displaced:
    """Displace an undeformed body.

    Parameters
    ----------
    body
        The undeformed body.
    moves
        Displacements along each face, by face name; neighbours must agree at their corner.
    emitter_on
        Faces, by name or pattern, that carry the emitter; ``ground`` if it is fixed in space.
    touches
        Segments of faces in contact with an object in this state, which become separate faces.

    Raises
    ------
    DesignError
        If no face has a given name, the displaced outline intersects itself, or a lens that is not a cylinder is
        deformed.
    """
    walls = {face.name: DisplacedCurve(face.curve, moves[face.name]) for face in body.all_faces}
    front = _front(body, walls)
    notches: list[ClosedNotch] = []
    first, *others = [_outline(outline, walls, front, touches, notches) for outline in body.outlines]
    motion = Rigid() if emitter_on == GROUND else motion_of(body, walls, emitter_on, "motion.emitter_on")
    marks = {name: motion.point(at) if name == "stem-base" else at for name, at in body.marks.items()}
    moved = replace(
        body,
        faces=first,
        emitter=body.emitter.moved(motion),
        marks=marks,
        others=tuple(others),
        apart=tuple(_beside(face, body, walls) for face in body.apart),
        front=front,
    )
    has_lens = any(called(face, LENS) for face in body.all_faces)
    lens = motion_of(body, walls, LENS, "lens") if has_lens else None
    return Displaced(moved.check(), motion, lens, max(wall.off_mm for wall in walls.values()), tuple(notches))


class DisplacedCurve:
    """The curve of a face with its displacement, as a spline over its length."""

    def __init__(self, curve: Curve, moves: Moves) -> None:
        self.curve, self.u, self.moves_mm = curve, np.asarray(moves.u), np.asarray(moves.displacement_mm)
        self.measure = Measure(curve)

    @cached_property
    def rigid(self) -> Rigid | None:
        """Rigid motion of the face; None if it is deformed."""
        at = self.curve.points(self.u)
        motion = Rigid.nearest(at, at + self.moves_mm)
        return motion if np.abs(motion.points(at) - at - self.moves_mm).max() <= RIGID_MM else None

    @cached_property
    def places(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return points (N, 2) along the curve, displaced positions (N, 2), and the length (N,) at each point."""
        at = self.curve.points(self.u)
        return at, at + self.moves_mm, np.gradient(self.measure.lengths_at(self.u))

    @cached_property
    def off_mm(self) -> float:
        """Maximum deviation of the spline from the element quadratics, at the quarter points of every edge."""
        if self.rigid is not None:
            return 0.0
        ends, moves = self.measure.lengths_at(self.u[::2]), self.moves_mm
        edges = np.stack([moves[:-2:2], moves[1::2], moves[2::2]])
        spline = self._spline(self.u, moves)
        places = [ends[:-1] + share * np.diff(ends) for share in (0.25, 0.75)]
        off = spline(np.array(places)) - np.tensordot(QUARTERS, edges, 1)
        return float(np.hypot(off[..., 0], off[..., 1]).max())

    def between(self, first: Point, last: Point, cuts: FloatArray) -> list[Curve]:
        """Return the displaced curve between two corners, divided at parameters of the undeformed curve."""
        moves = self.moves_mm.copy()
        moves[0], moves[-1] = np.subtract(first, self.curve.start), np.subtract(last, self.curve.end)
        spline = self._spline(self.u, moves)
        slope = spline.derivative()

        def carry(piece: Curve, start: float, end: float) -> tuple[Function, Function, FloatArray]:
            def lengths(u: FloatArray) -> FloatArray:
                return self.measure.lengths_at(start + (end - start) * u)

            def velocity(u: FloatArray) -> FloatArray:
                there = piece.velocities(u)
                return np.asarray(there + np.hypot(*there.T)[:, None] * slope(lengths(u)))

            inside = (np.union1d(self.u, cuts) - start) / (end - start)
            knots = np.concatenate([[0.0], inside[(inside > NEAR) & (inside < 1.0 - NEAR)], [1.0]])
            return lambda u: piece.points(u) + spline(lengths(u)), velocity, knots

        controls = carried(self.curve, carry, SPLINE_MM).controls
        starts = np.array([control[0] for control in controls])
        goals = self.curve.points(cuts) + spline(self.measure.lengths_at(cuts))
        joints = [int(np.argmin(np.hypot(*(starts - goal).T))) for goal in goals]
        return [Spline.of(controls[i:k]) for i, k in pairwise([0, *joints, len(controls)])]

    def _spline(self, u: FloatArray, moves_mm: FloatArray) -> "CubicSpline":
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.measure.lengths_at(u), moves_mm)


def motion_of(body: Body, walls: Mapping[str, DisplacedCurve], pattern: str, key: str) -> Rigid:
    """Rigid motion that best fits the faces with a name; raises `DesignError`, about a key, if there are none."""
    places = [walls[face.name].places for face in body.all_faces if called(face, pattern)]
    if not places:
        known = ", ".join(face.name for face in body.all_faces)
        raise DesignError(key, value=pattern, limit=f"names no face; the faces are {known}")
    return Rigid.nearest(*(np.concatenate(each) for each in zip(*places, strict=True)))


def _front(body: Body, walls: Mapping[str, DisplacedCurve]) -> Front | None:
    """Return the moved front of a lens that is not a cylinder and stays rigid."""
    if body.front is None:
        return None
    at, goal, length = walls[body.front.interface].places
    motion = Rigid.nearest(at, goal, length)
    off_mm = float(np.hypot(*(motion.points(at) - goal).T).max())
    if off_mm > FRONT_MM:
        raise DesignError(
            "lens.shape",
            value=body.front.lens.shape,
            limit=f"is deformed by {off_mm:.2g} mm, but a surface in space must be rigid to within {FRONT_MM:g} mm",
            remedy='clamp the lens, or set lens.shape = "cartesian-oval", whose walls stay vertical',
        )
    return replace(body.front, motion=motion)


def _beside(face: Face, body: Body, walls: Mapping[str, DisplacedCurve]) -> Face:
    """Return a receiver behind a gap, carried by the end of the arm; any other separate object is fixed."""
    end = face.name.replace("receiver", "end", 1)
    if face.part != "receiver" or not any(called(other, end) for other in body.all_faces):
        return face
    return replace(face, curve=face.curve.moved(motion_of(body, walls, end, face.name)))


def _outline(
    faces: tuple[Face, ...],
    walls: Mapping[str, DisplacedCurve],
    front: Front | None,
    touches: Sequence[Touch],
    notches: list[ClosedNotch],
) -> tuple[Face, ...]:
    """Return a displaced closed outline with exactly shared corners; notches that have closed are added to the list."""
    motions = [
        front.motion if front is not None and face.name == front.interface else walls[face.name].rigid for face in faces
    ]
    corners = [_corner(face, walls[face.name], motions[i] or motions[i - 1]) for i, face in enumerate(faces)]
    moved: list[list[Face]] = []
    for i, face in enumerate(faces):
        ends, motion = (corners[i], corners[(i + 1) % len(faces)]), motions[i]
        own = sorted((touch for touch in touches if touch.face == face.name), key=lambda touch: touch.u_from)
        cuts = np.unique([u for touch in own for u in (touch.u_from, touch.u_to) if NEAR < u < 1.0 - NEAR])
        curves = walls[face.name].between(*ends, cuts) if motion is None else _moved(face.curve, motion, cuts)
        moved.append(_pieces(face, curves, [0.0, *cuts, 1.0], own))
    notches += [notch for i, face in enumerate(faces) if (notch := _joined(faces[i - 1], face, moved[i - 1], moved[i]))]
    return tuple(chain.from_iterable(moved))


def _joined(before: Face, after: Face, last: list[Face], first: list[Face]) -> ClosedNotch | None:
    """Return the notch between two faces if it has closed; the displaced segments are cut to the remaining parts."""
    if cross(before.curve.velocity_at(1.0), after.curve.velocity_at(0.0)) >= 0.0:
        return None
    found = close_notch((before.name, after.name), last[-1].curve, first[0].curve)
    if found is None:
        return None
    last[-1], first[0] = replace(last[-1], curve=found[0]), replace(first[0], curve=found[1])
    return found[2]


def _pieces(face: Face, curves: list[Curve], ends: list[float], touches: list[Touch]) -> list[Face]:
    """Segments of a displaced face, numbered from the origin of its lengths, with the wall tables of their contacts."""
    if len(curves) == 1 and not touches:
        return [replace(face, curve=curves[0])]
    pieces, count = [], len(curves)
    for i, (curve, (low, high)) in enumerate(zip(curves, pairwise(ends), strict=True)):
        middle = 0.5 * (low + high)
        wall = next((touch.wall for touch in touches if touch.u_from < middle < touch.u_to), face.wall)
        pieces.append(
            replace(face, name=f"{face.name}.{count - i if face.from_end else i + 1}", curve=curve, wall=wall)
        )
    return pieces


def _corner(face: Face, wall: DisplacedCurve, motion: Rigid | None) -> Point:
    """Return the displaced start of a face, moved with a rigid neighbour or by the displacement of the face itself."""
    if motion is not None:
        return motion.point(face.curve.start)
    x, z = np.asarray(face.curve.start) + wall.moves_mm[0]
    return (float(x), float(z))


def _moved(curve: Curve, motion: Rigid, cuts: FloatArray) -> list[Curve]:
    moved = curve if motion == Rigid() else curve.moved(motion)
    return [moved.part(*ends) for ends in pairwise([0.0, *cuts, 1.0])] if len(cuts) else [moved]

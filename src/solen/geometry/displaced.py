"""A body deformed by a load: its walls are displaced point by point and become exact curves that carry its parts along.

The displacement is specified at points along every wall. A cubic spline through them, as a function of wall length, is
added to the exact wall. The sum is a smooth curve, which is stored as a spline within `SPLINE_MM`, like a bent wall. A
wall that moves as a rigid body remains the same kind of curve: a clamped lens stays an exact oval. Walls stay vertical:
the displacement is in the plane and the same at every height. After a notch has closed, it begins where its walls
separate (`solen.geometry.notches`).

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
from solen.curve import ArcLength, Curve, Function, Spline, displaced_spline
from solen.errors import DesignError
from solen.geometry.body import Body, Face, Front
from solen.geometry.notches import ClosedNotch, close_notch
from solen.geometry.walls import has_name
from solen.plane import Point, Rigid, cross

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

SPLINE_MM = 1e-7
"""Maximum deviation of a spline from the displaced wall."""
RIGID_MM = 2e-12
"""Maximum deviation from a rigid motion of a face that remains the same kind of curve."""
FRONT_MM = 1e-4
"""Maximum deviation from a rigid motion for a lens that is not a cylinder: its surface in space is moved unchanged."""
LENS = "lens"
"""Name of the lens faces, on which the emitter is mounted by default."""
GROUND = "ground"
"""Value of ``emitter_on`` for an emitter that is fixed in space."""
END_MARGIN = 1e-6
"""Minimum distance of a joint from the ends of a curve, as a fraction of its parameter range."""
QUARTER_WEIGHTS = np.array([[3.0, 6.0, -1.0], [-1.0, 6.0, 3.0]]) / 8.0
"""Weights of the first, middle and last node of an edge that give its quadratic at a quarter (first row) and at three
quarters (second row) of the edge.
"""


class FaceDisplacement(Protocol):
    """Displacement of one face: parameters (N,) on its curve, ascending from 0 to 1, and displacements (N, 2) in mm.

    The points are the nodes of quadratic elements: every second node is the midpoint of an edge.
    """

    @property
    def u(self) -> FloatArray: ...  # noqa: D102

    @property
    def displacement_mm(self) -> FloatArray: ...  # noqa: D102


@dataclass(frozen=True)
class ContactSegment:
    """Segment of a face in contact, between two parameters of the undeformed curve, and the index of its wall table."""

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
    emitter_motion
        Rigid motion of the emitter: the best fit to the motion of the faces on which it is mounted.
    lens_motion
        Rigid motion that best fits the faces named ``lens``; None if the body has none.
    deviation_mm
        Maximum deviation of a wall between its nodes from the displacement of its elements.
    closed_notches
        Notches that have closed.
    """

    body: Body
    emitter_motion: Rigid
    lens_motion: Rigid | None
    deviation_mm: float
    closed_notches: tuple[ClosedNotch, ...] = ()


def displaced(
    body: Body,
    displacements: Mapping[str, FaceDisplacement],
    emitter_on: str = LENS,
    contacts: Sequence[ContactSegment] = (),
) -> Displaced:
    """Return the displaced body.

    Parameters
    ----------
    body
        The undeformed body.
    displacements
        Displacements along each face, keyed by face name; neighbours must agree at their corner.
    emitter_on
        Name or pattern of the faces on which the emitter is mounted; ``ground`` if it is fixed in space.
    contacts
        Segments of faces in contact with an object in this state; each becomes a face of its own.

    Raises
    ------
    DesignError
        If no face has a given name, the displaced outline intersects itself, or a lens that is not a cylinder is
        deformed.
    """
    walls = {face.name: DisplacedCurve(face.curve, displacements[face.name]) for face in body.all_faces}
    front = _front(body, walls)
    outlines = [_outline(outline, walls, front, contacts) for outline in body.outlines]
    first, *others = (faces for faces, _ in outlines)
    notches = tuple(notch for _, closed in outlines for notch in closed)
    motion = Rigid() if emitter_on == GROUND else motion_of(body, walls, emitter_on, "motion.emitter_on")
    marks = {name: motion.point(at) if name == "stem-base" else at for name, at in body.marks.items()}
    moved = replace(
        body,
        faces=first,
        emitter=body.emitter.moved(motion),
        marks=marks,
        others=tuple(others),
        separate=tuple(_separate_face(face, body, walls) for face in body.separate),
        front=front,
    )
    has_lens = any(has_name(face, LENS) for face in body.all_faces)
    lens_motion = motion_of(body, walls, LENS, "lens") if has_lens else None
    deviation_mm = max(wall.deviation_mm for wall in walls.values())
    return Displaced(moved.check(), motion, lens_motion, deviation_mm, notches)


class DisplacedCurve:
    """The curve of a face with its displacement, as a spline over its length."""

    def __init__(self, curve: Curve, displacement: FaceDisplacement) -> None:
        self.curve, self.measure = curve, ArcLength(curve)
        self.u, self.displacement_mm = np.asarray(displacement.u), np.asarray(displacement.displacement_mm)

    @cached_property
    def rigid(self) -> Rigid | None:
        """Rigid motion of the face; None if it is deformed."""
        at = self.curve.points(self.u)
        motion = Rigid.nearest(at, at + self.displacement_mm)
        return motion if np.abs(motion.points(at) - at - self.displacement_mm).max() <= RIGID_MM else None

    @cached_property
    def matched_points(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points (N, 2) along the curve, their displaced positions (N, 2), and the length (N,) that each represents."""
        at = self.curve.points(self.u)
        return at, at + self.displacement_mm, np.gradient(self.measure.lengths_at(self.u))

    @cached_property
    def deviation_mm(self) -> float:
        """Maximum deviation of the spline from the element quadratics, at the quarter points of every edge."""
        if self.rigid is not None:
            return 0.0
        ends, displacement = self.measure.lengths_at(self.u[::2]), self.displacement_mm
        edges = np.stack([displacement[:-2:2], displacement[1::2], displacement[2::2]])
        spline = self._spline(displacement)
        points = [ends[:-1] + fraction * np.diff(ends) for fraction in (0.25, 0.75)]
        deviation = spline(np.array(points)) - np.tensordot(QUARTER_WEIGHTS, edges, 1)
        return float(np.hypot(deviation[..., 0], deviation[..., 1]).max())

    def between(self, first: Point, last: Point, cuts: FloatArray) -> list[Curve]:
        """Return the displaced curve between two corners, divided at parameters of the undeformed curve."""
        displacement = self.displacement_mm.copy()
        displacement[0], displacement[-1] = np.subtract(first, self.curve.start), np.subtract(last, self.curve.end)
        spline = self._spline(displacement)
        slope = spline.derivative()

        def carry(piece: Curve, start: float, end: float) -> tuple[Function, Function, FloatArray]:
            def lengths(u: FloatArray) -> FloatArray:
                return self.measure.lengths_at(start + (end - start) * u)

            def velocity(u: FloatArray) -> FloatArray:
                undeformed = piece.velocities(u)
                return np.asarray(undeformed + np.hypot(*undeformed.T)[:, None] * slope(lengths(u)))

            inside = (np.union1d(self.u, cuts) - start) / (end - start)
            knots = np.concatenate([[0.0], inside[(inside > END_MARGIN) & (inside < 1.0 - END_MARGIN)], [1.0]])
            return lambda u: piece.points(u) + spline(lengths(u)), velocity, knots

        controls = displaced_spline(self.curve, carry, SPLINE_MM).controls
        starts = np.array([control[0] for control in controls])
        cut_points = self.curve.points(cuts) + spline(self.measure.lengths_at(cuts))
        joints = [int(np.argmin(np.hypot(*(starts - point).T))) for point in cut_points]
        return [Spline.of(controls[i:k]) for i, k in pairwise([0, *joints, len(controls)])]

    def _spline(self, displacement_mm: FloatArray) -> "CubicSpline":
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.measure.lengths_at(self.u), displacement_mm)


def motion_of(body: Body, walls: Mapping[str, DisplacedCurve], pattern: str, key: str) -> Rigid:
    """Return the rigid motion that best fits the faces that match a pattern; raise `DesignError` if none does."""
    points = [walls[face.name].matched_points for face in body.all_faces if has_name(face, pattern)]
    if not points:
        known = ", ".join(face.name for face in body.all_faces)
        raise DesignError(key, value=pattern, limit=f"matches no face; the faces are {known}")
    return Rigid.nearest(*(np.concatenate(arrays) for arrays in zip(*points, strict=True)))


def _front(body: Body, walls: Mapping[str, DisplacedCurve]) -> Front | None:
    """Return the moved front of a lens that is not a cylinder, which must remain rigid; None for a prism."""
    if body.front is None:
        return None
    points, displaced_points, length = walls[body.front.interface].matched_points
    motion = Rigid.nearest(points, displaced_points, length)
    deviation_mm = float(np.hypot(*(motion.points(points) - displaced_points).T).max())
    if deviation_mm > FRONT_MM:
        raise DesignError(
            "lens.shape",
            value=body.front.lens.shape,
            limit=f"is deformed by {deviation_mm:.2g} mm, but a lens that is not a cylinder must remain rigid to "
            f"{FRONT_MM:g} mm",
            remedy='clamp the lens, or set lens.shape = "cartesian-oval", whose walls stay vertical',
        )
    return replace(body.front, motion=motion)


def _separate_face(face: Face, body: Body, walls: Mapping[str, DisplacedCurve]) -> Face:
    """Return a receiver behind a gap, moved with the end of its arm; any other separate object is fixed."""
    end = face.name.replace("receiver", "end", 1)
    if face.part != "receiver" or not any(has_name(other, end) for other in body.all_faces):
        return face
    return replace(face, curve=face.curve.moved(motion_of(body, walls, end, face.name)))


def _outline(
    faces: tuple[Face, ...],
    walls: Mapping[str, DisplacedCurve],
    front: Front | None,
    contacts: Sequence[ContactSegment],
) -> tuple[tuple[Face, ...], list[ClosedNotch]]:
    """Return a displaced closed outline with exactly shared corners, and its notches that have closed."""
    motions = [
        front.motion if front is not None and face.name == front.interface else walls[face.name].rigid for face in faces
    ]
    corners = [_corner(face, walls[face.name], motions[i] or motions[i - 1]) for i, face in enumerate(faces)]
    moved: list[list[Face]] = []
    for i, face in enumerate(faces):
        ends, motion = (corners[i], corners[(i + 1) % len(faces)]), motions[i]
        on_face = sorted(
            (contact for contact in contacts if contact.face == face.name), key=lambda contact: contact.u_from
        )
        ends_of_contacts = [u for contact in on_face for u in (contact.u_from, contact.u_to)]
        cuts = np.unique([u for u in ends_of_contacts if END_MARGIN < u < 1.0 - END_MARGIN])
        curves = walls[face.name].between(*ends, cuts) if motion is None else _moved_curves(face.curve, motion, cuts)
        moved.append(_pieces(face, curves, [0.0, *cuts, 1.0], on_face))
    notches = [
        notch for i, face in enumerate(faces) if (notch := _close_notch(faces[i - 1], face, moved[i - 1], moved[i]))
    ]
    return tuple(chain.from_iterable(moved)), notches


def _close_notch(before: Face, after: Face, last: list[Face], first: list[Face]) -> ClosedNotch | None:
    """Cut the displaced segments that meet in a closed notch, and return the notch; None if it has not closed."""
    if cross(before.curve.velocity_at(1.0), after.curve.velocity_at(0.0)) >= 0.0:
        return None
    closed = close_notch((before.name, after.name), last[-1].curve, first[0].curve)
    if closed is None:
        return None
    before_curve, after_curve, notch = closed
    last[-1], first[0] = replace(last[-1], curve=before_curve), replace(first[0], curve=after_curve)
    return notch


def _pieces(face: Face, curves: list[Curve], ends: list[float], contacts: list[ContactSegment]) -> list[Face]:
    """Return the segments of a displaced face with their wall tables, numbered from the end where its lengths begin."""
    if len(curves) == 1 and not contacts:
        return [replace(face, curve=curves[0])]
    pieces, count = [], len(curves)
    for i, (curve, (low, high)) in enumerate(zip(curves, pairwise(ends), strict=True)):
        middle = 0.5 * (low + high)
        wall = next((contact.wall for contact in contacts if contact.u_from < middle < contact.u_to), face.wall)
        pieces.append(
            replace(face, name=f"{face.name}.{count - i if face.from_end else i + 1}", curve=curve, wall=wall)
        )
    return pieces


def _corner(face: Face, wall: DisplacedCurve, motion: Rigid | None) -> Point:
    """Return the displaced start of a face, moved with a rigid neighbour or by the displacement of the face itself."""
    if motion is not None:
        return motion.point(face.curve.start)
    x, z = np.asarray(face.curve.start) + wall.displacement_mm[0]
    return (float(x), float(z))


def _moved_curves(curve: Curve, motion: Rigid, cuts: FloatArray) -> list[Curve]:
    moved = curve if motion == Rigid() else curve.moved(motion)
    return [moved.part(*ends) for ends in pairwise([0.0, *cuts, 1.0])] if len(cuts) else [moved]

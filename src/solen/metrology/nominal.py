"""The nominal front of a lens as dense points, and the distance of other points from it.

Lens coordinates are those of the design: the vertex is the origin, x to the right, z into the material, mm. The front
runs from left to right, so the material is on its left, and deviations are positive outwards.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.curve import Curve
from solen.errors import DataError, SpecError
from solen.geometry import Body, section
from solen.lens import Lens, LensInSpace
from solen.plane import Rigid
from solen.sensor import Sensor
from solen.spec import Design

SeenFrom = Literal["top", "bottom"]
"""Face of a print: ``top`` faces away from the build plate, ``bottom`` was on it."""
TOLERANCE_MM = 1e-6
"""Maximum distance of the dense points' chords from the exact curve: a nanometre."""
SPACING_MM = 2e-3
WALL_LENGTH = 0.35
"""Length of the walls behind the front that help to find the lens, as a fraction of its width."""
CORNER_FRACTION = 0.25
"""Fraction of a wall next to the corner that is not evaluated."""
END_MM = 0.03
"""Length at each end of the front that is omitted, because near a corner the profile along a normal is not a step."""
END_FRACTION = 0.25
"""Fraction of the front at each end in which points may belong to the adjacent wall."""
SYMMETRIC_MM = 1e-4
"""Largest distance of a symmetric front from its mirror image."""
MIN_SAG_RATIO = 0.01
"""Ratio of sag to chord below which a front cannot be registered."""
VERTEX_SAMPLES = 2001
"""Number of points among which the vertex of a drawn front is searched for."""


@dataclass(frozen=True, eq=False)
class NearestPoints:
    """The nearest position on a front to each of N points.

    Attributes
    ----------
    arc_mm
        Shape (N,): arc length of the front up to that position.
    deviation_mm
        Shape (N,): distance, positive outwards.
    normals
        Shape (N, 2): outward unit normals at that position.
    beyond
        Shape (N,): whether the position is an end of the front.
    """

    arc_mm: FloatArray
    deviation_mm: FloatArray
    normals: FloatArray
    beyond: BoolArray


@dataclass(frozen=True, eq=False)
class NominalFront:
    """The designed front of a lens, and the walls that begin at its ends.

    Attributes
    ----------
    name
        Name of the design.
    front_mm
        Shape (N, 2): points of the front from left to right, within `TOLERANCE_MM` of the curve.
    left_mm, right_mm
        Shape (M, 2): walls that start at the front's ends; empty if the design has none.
    """

    name: str
    front_mm: FloatArray
    left_mm: FloatArray
    right_mm: FloatArray

    @classmethod
    def of(cls, name: str, front: Curve, left: Sequence[Curve] = (), right: Sequence[Curve] = ()) -> "NominalFront":
        """Return the outline of a front that runs from left to right, and of walls whose pieces begin at its ends.

        Raise `DataError` if the front is nearly straight.
        """
        points = _dense(front)
        chord = points[-1] - points[0]
        offset = points - points[0]
        sag = np.abs(chord[0] * offset[:, 1] - chord[1] * offset[:, 0]).max() / np.hypot(*chord)
        if sag < MIN_SAG_RATIO * np.hypot(*chord):
            limit = "has a nearly flat front, so an image cannot be registered to the design"
            raise DataError(name, limit=limit, remedy="inspect a design with a lens")
        reach = WALL_LENGTH * float(np.hypot(*chord))
        return cls(name, points, _cut(left, reach), _cut(right, reach))

    @property
    def width_mm(self) -> float:
        """Distance between the ends of the front."""
        return float(np.hypot(*(self.front_mm[-1] - self.front_mm[0])))

    @cached_property
    def normals(self) -> FloatArray:
        """Outward unit normals (N, 2) at the points of the front."""
        return outward(self.front_mm)

    def curvature_per_mm(self, arc_mm: FloatArray) -> FloatArray:
        """Return the curvature (N,) at arc lengths along the front, positive if the material is convex."""
        turned = np.unwrap(np.arctan2(self.normals[:, 1], self.normals[:, 0]))
        return np.asarray(np.interp(arc_mm, self.arc_mm, np.gradient(turned, self.arc_mm)))

    @cached_property
    def arc_mm(self) -> FloatArray:
        """Arc length of the front up to each of its points."""
        return arc_lengths(self.front_mm)

    @cached_property
    def walls(self) -> tuple["NominalFront", ...]:
        """The left and the right wall beyond their corners, each with the material on its left, as for the front."""
        trimmed = [(wall[arc_lengths(wall) > CORNER_FRACTION * _length(wall)], side) for wall, side in self._sides]
        return tuple(NominalFront(self.name, wall[::side], *_NO_WALLS) for wall, side in trimmed if len(wall) > 1)

    @property
    def _sides(self) -> tuple[tuple[FloatArray, int], ...]:
        """Left and right wall, each with 1 if its points run in the direction of the front, otherwise -1."""
        return (self.left_mm, -1), (self.right_mm, 1)

    def corner_shifts(self, enlargement: float, growth_mm: float) -> FloatArray:
        """Return the displacements (2,) of the left and right corners outwards along the front.

        They are due to a relative enlargement, and to a growth that moves front and walls outwards.
        """
        moved = [
            (enlargement * self.front_mm[at] + growth_mm * _mitre(self.normals[at], wall, side)) @ tangent
            for (wall, side), at, tangent in zip(self._sides, (0, -1), self._outward_tangents, strict=True)
        ]
        return np.array(moved)

    def on_front(self, points_mm: FloatArray, arc_mm: FloatArray, shifts_mm: FloatArray) -> BoolArray:
        """Return whether points (N, 2) with feet at arc lengths (N,) are on the front and not on a wall or a corner.

        The corners are shifted outwards along the front by ``shifts_mm`` (2,).
        """
        fraction = arc_mm / self.arc_mm[-1]
        left, right = (
            (points_mm - self.front_mm[at]) @ tangent < shift - END_MM
            for at, tangent, shift in zip((0, -1), self._outward_tangents, shifts_mm, strict=True)
        )
        return np.asarray((left | (fraction > END_FRACTION)) & (right | (fraction < 1.0 - END_FRACTION)))

    @cached_property
    def _outward_tangents(self) -> tuple[FloatArray, FloatArray]:
        """Unit vectors along the front at its left and its right end, both (2,), directed away from the front."""
        left, right = self.front_mm[0] - self.front_mm[1], self.front_mm[-1] - self.front_mm[-2]
        return left / np.hypot(*left), right / np.hypot(*right)

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether the front is its own mirror image, in which case an image does not show which side is visible."""
        mirrored = self.front_mm[::-1] * np.array([-1.0, 1.0])
        return bool(np.abs(self.nearest(mirrored).deviation_mm).max() < SYMMETRIC_MM)

    def at(self, arc_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (N, 2) and outward unit normals (N, 2) at arc lengths along the front."""
        normals = interpolated(arc_mm, self.arc_mm, self.normals)
        return interpolated(arc_mm, self.arc_mm, self.front_mm), normals / np.hypot(*normals.T)[:, None]

    def nearest(self, points_mm: FloatArray) -> NearestPoints:
        """Return the positions on the front nearest to points (N, 2) in lens coordinates."""
        _, vertex = self._tree.query(points_mm)
        last = len(self.front_mm) - 2
        before, after = np.clip(vertex - 1, 0, last), np.clip(vertex, 0, last)
        (fraction_before, square_before), (fraction_after, square_after) = (
            self._foot(points_mm, segment) for segment in (before, after)
        )
        use_after = square_after < square_before
        segment, fraction = np.where(use_after, after, before), np.where(use_after, fraction_after, fraction_before)
        start, chord = self.front_mm[segment], self.front_mm[segment + 1] - self.front_mm[segment]
        on_segment, length = np.clip(fraction, 0.0, 1.0), np.hypot(*chord.T)
        arc = self.arc_mm[segment] + on_segment * length
        offset = points_mm - start - on_segment[:, None] * chord
        normal = np.stack([chord[:, 1], -chord[:, 0]], axis=1) / length[:, None]
        beyond = ((segment == 0) & (fraction < 0.0)) | ((segment == last) & (fraction > 1.0))
        deviation = np.where(np.sum(offset * normal, axis=1) < 0.0, -1.0, 1.0) * np.hypot(*offset.T)
        return NearestPoints(arc, deviation, self.at(arc)[1], beyond)

    @cached_property
    def _tree(self) -> "cKDTree[None]":
        return cKDTree(self.front_mm)

    def _foot(self, points: FloatArray, segment: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the feet of perpendiculars as fractions of the segments, and the squared distances to the segments."""
        start, chord = self.front_mm[segment], self.front_mm[segment + 1] - self.front_mm[segment]
        fraction = np.sum((points - start) * chord, axis=1) / np.sum(chord * chord, axis=1)
        offset = points - start - np.clip(fraction, 0.0, 1.0)[:, None] * chord
        return fraction, np.sum(offset * offset, axis=1)


def nominal_front(design: Design, name: str = "", seen_from: SeenFrom | None = None) -> NominalFront:
    """Return the front of a design, with its adjacent walls.

    For a lens that varies with height, it is the front of the visible face: of the last layer if seen from the top, of
    the first layer if seen from the bottom.

    Raises
    ------
    DataError
        If the design has no lens, a nearly flat one, or a drawn body without exactly one face called lens.
    SpecError
        If the lens varies with height and the visible face is not specified.
    """
    sensor = Sensor.of(design)
    name = name or design.name
    if sensor.is_drawn:
        return _drawn_front(name, sensor.body().prism())
    if not sensor.has_lens:
        raise DataError(
            name, limit="has no lens with which an image could be compared", remedy="inspect a design with a lens"
        )
    body = section(sensor.body(), _height_mm(sensor.lens, seen_from))
    walls = {face.name: face.curve for face in body.all_faces}
    front = walls.get("lens", sensor.lens.front)
    adjacent = []
    for side, end in (("left", front.start), ("right", front.end)):
        pieces = (walls.get(f"{name}-{side}") for name in ("side", "stem"))
        adjacent.append([_starting_near(wall, end) for wall in pieces if wall is not None])
    return NominalFront.of(name, front, *adjacent)


def _height_mm(lens: Lens, seen_from: SeenFrom | None) -> float:
    """Return the height of the visible face above the mid-plane of the body; 0 for a cylinder."""
    if not isinstance(lens, LensInSpace):
        return 0.0
    if seen_from is None:
        limit = f"is missing: a {lens.shape} lens varies with height, and the image shows only one face"
        raise SpecError("--seen-from", limit=limit, remedy="set it to top or bottom")
    return lens.half_height_mm if seen_from == "bottom" else -lens.half_height_mm


_NO_WALLS = (np.zeros((0, 2)), np.zeros((0, 2)))


def _length(points: FloatArray) -> float:
    return float(np.sum(np.hypot(*np.diff(points, axis=0).T)))


def _mitre(normal: FloatArray, wall: FloatArray, side: int) -> FloatArray:
    """Return the displacement (2,) of a corner if the front and the adjacent wall, if any, move outwards by 1."""
    if len(wall) < 2:
        return normal
    wall_normal = side * outward(wall)[0]
    return np.asarray((normal + wall_normal) / (1.0 + normal @ wall_normal))


def _starting_near(wall: Curve, point: tuple[float, float]) -> Curve:
    return wall if math.dist(wall.start, point) <= math.dist(wall.end, point) else wall.reversed()


def _drawn_front(name: str, body: Body) -> NominalFront:
    """Return the front of a drawn body: its one face called lens, levelled, with its lowest point as the vertex."""
    fronts = [face for face in body.all_faces if face.part == "lens"]
    if len(fronts) != 1:
        limit = f"has {len(fronts)} faces called lens; exactly one is needed"
        raise DataError(name, limit=limit, remedy="draw the front as one path on a layer called lens")
    curve = fronts[0].curve
    (x0, z0), (x1, z1) = curve.start, curve.end
    levelled = curve.moved(Rigid.about((x0, z0), -math.degrees(math.atan2(z1 - z0, x1 - x0))))
    lowest = float(levelled.points(np.linspace(0.0, 1.0, VERTEX_SAMPLES))[:, 1].min())
    middle = 0.5 * (levelled.start[0] + levelled.end[0])
    return NominalFront.of(name, levelled.moved(Rigid(shift=(-middle, -lowest))))


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return the arc length (N,) of a polyline (N, 2) up to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def interpolated(at: FloatArray, arc: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors (M, 2) at arc lengths (M,), interpolated between vectors (N, 2) at arc lengths ``arc`` (N,)."""
    return np.stack([np.interp(at, arc, vectors[:, i]) for i in (0, 1)], axis=1)


def outward(points: FloatArray) -> FloatArray:
    """Return unit normals (N, 2), to the right of the direction of the points."""
    tangent = np.gradient(points, axis=0)
    return np.asarray(np.stack([tangent[:, 1], -tangent[:, 0]], axis=1) / np.hypot(*tangent.T)[:, None])


def _dense(curve: Curve) -> FloatArray:
    """Return points of a curve, dense enough for the tolerance and for normals between them."""
    points = curve.flattened(TOLERANCE_MM)
    count = max(int(np.ceil(arc_lengths(points)[-1] / SPACING_MM)), 64)
    if len(points) < count:
        points = curve.points(np.linspace(0.0, 1.0, count))
    return np.asarray(points, dtype=np.float64)


def _cut(curves: Sequence[Curve], reach: float) -> FloatArray:
    """Return the points of a wall up to a given length from its start."""
    if not curves:
        return np.zeros((0, 2))
    points = np.vstack([curve.points(np.linspace(0.0, 1.0, 400)[bool(i) :]) for i, curve in enumerate(curves)])
    return np.asarray(points[arc_lengths(points) <= reach])

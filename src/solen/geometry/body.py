"""A body: closed outlines of named exact curves, and the position of its emitter.

Geometry is independent of optics. An outline is directed with the material on its left: the outer one
counter-clockwise, a hole clockwise. :meth:`Body.check` verifies that each outline is closed and simple, that outlines
do not intersect and that they have this orientation, and reports the location of any fault.
"""

import math
import re
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from solen.arrays import FloatArray
from solen.curve import END_TOLERANCE_MM, Curve
from solen.errors import DesignError
from solen.lens import LensInSpace
from solen.plane import Point, Rigid

if TYPE_CHECKING:
    import shapely.geometry.base

GAP_MM = END_TOLERANCE_MM
"""Maximum gap between two faces at a corner; rays are traced with curves extended by this beyond their ends."""
Y_REMEDY = "check stem, arm and lens lengths, the arm angle and width, and the motion angles"
NEARBY_MM = 1e-2
"""The message about an intersection of outlines names the faces within this distance."""


@dataclass(frozen=True)
class Face:
    """A named segment of an outline, or of a separate object.

    ``wall`` is the index of the design's [[wall]] table that applies to it. Lengths along a face are measured from its
    start, or from its end if ``from_end`` is set; ``begins_mm`` is the length at the beginning of a trimmed face.
    """

    name: str
    curve: Curve
    wall: int | None = None
    from_end: bool = False
    begins_mm: float = 0.0

    @property
    def part(self) -> str:
        """Part to which the face belongs, the first word of its name: ``receiver`` for ``receiver-right.2``."""
        return self.part_of(self.name)

    @staticmethod
    def part_of(name: str) -> str:
        """Return the first word of a name."""
        return _words(name)[0]

    @property
    def label(self) -> str:
        """Name without part and segment number: ``right`` for ``receiver-right.2``; the part if nothing remains."""
        part, label = _words(self.name)
        return label or part


@dataclass(frozen=True)
class Pose:
    """Position and direction of an object: ``axis_deg`` counter-clockwise from +z, ``width_mm`` across the axis."""

    point: Point
    axis_deg: float
    width_mm: float = 0.0

    def moved(self, motion: Rigid) -> "Pose":
        """Return the pose after a rigid motion."""
        return replace(self, point=motion.point(self.point), axis_deg=self.axis_deg + motion.angle_deg)


@dataclass(frozen=True)
class Front:
    """A lens surface that is not a cylinder and replaces a face of the outline.

    ``interface`` is the name of that face, the middle section of the surface, with the material on its left; ``motion``
    maps the coordinates of the lens to those of the body.
    """

    interface: str
    lens: LensInSpace
    motion: Rigid


@dataclass(frozen=True)
class Body:
    """A closed outline, its emitter and its named points (``marks``: the corners of the fork, the crotch, the base).

    ``others`` are further closed outlines: holes and other bodies. Faces in air, such as mirrors and receivers behind a
    gap, are ``separate``. An emitter may be ``embedded`` in the material. If a ``front`` is set, the body is not a
    prism, and the outline is that of its middle section. ``emitters`` are all emitters of a network, of which only
    ``emitter`` emits light.
    """

    faces: tuple[Face, ...]
    emitter: Pose
    marks: dict[str, Point] = field(hash=False)
    others: tuple[tuple[Face, ...], ...] = ()
    separate: tuple[Face, ...] = ()
    embedded: bool = False
    front: Front | None = None
    emitters: tuple[tuple[str, Pose], ...] = ()

    def prism(self, remedy: str = 'set lens.shape = "cartesian-oval"') -> "Body":
        """Return the body itself; raise `DesignError` if it is not a prism, because its lens is not a cylinder."""
        if self.front is None:
            return self
        raise DesignError(
            "lens.shape",
            value=self.front.lens.shape,
            limit="is a lens that varies with height, so one outline cannot describe the body",
            remedy=remedy,
        )

    @property
    def outlines(self) -> tuple[tuple[Face, ...], ...]:
        """Faces of every closed outline."""
        return (self.faces, *self.others)

    @property
    def all_faces(self) -> tuple[Face, ...]:
        """Faces of all closed outlines."""
        return tuple(face for outline in self.outlines for face in outline)

    def face(self, name: str) -> Face:
        """Return the face with a given name; raise `KeyError` if there is none."""
        return {face.name: face for face in (*self.all_faces, *self.separate)}[name]

    def outline(self, tolerance_mm: float = 1e-3) -> FloatArray:
        """Return a closed polyline (N, 2) within ``tolerance_mm`` of the first outline; see `polyline`."""
        return polyline(self.faces, tolerance_mm)

    def area_mm2(self) -> float:
        """Return the enclosed area, exact to rounding; positive for counter-clockwise outlines."""
        from solen.geometry.measures import area_mm2

        return area_mm2(self.outlines)

    def check(self) -> "Body":
        """Return the body; raise `DesignError` if an outline is open or wrongly oriented, or if any faces intersect."""
        rings = []
        for outline in self.outlines:
            _check_closed(outline)
            rings.append(polyline(outline, 1e-4))
            self._check_simple(rings[-1])
        self._check_rings(rings)
        self._check_separate(rings)
        return self

    def _check_simple(self, outline: FloatArray) -> None:
        import shapely

        polygon = shapely.Polygon(outline)
        if not polygon.is_valid:
            reason = shapely.is_valid_reason(polygon)
            raise self._intersection_error(_position_in(reason), reason)

    def _check_rings(self, rings: list[FloatArray]) -> None:
        """Raise `DesignError` if outlines touch, or if an outline is not oriented as the outlines around it require."""
        import shapely

        lines = [shapely.LinearRing(ring) for ring in rings]
        for i, line in enumerate(lines):
            for other in lines[i + 1 :]:
                if line.intersects(other):
                    point = line.intersection(other).representative_point()
                    raise self._intersection_error((point.x, point.y))
        polygons = [shapely.Polygon(ring) for ring in rings]
        for i, ring in enumerate(rings):
            around = sum(polygons[k].contains(lines[i]) for k in range(len(rings)) if k != i)
            _check_orientation(ring, around)

    def _check_separate(self, rings: list[FloatArray]) -> None:
        """Raise `DesignError` if a separate object intersects the body."""
        import shapely

        solid = filled(rings)
        for face in self.separate:
            line = shapely.LineString(face.curve.flattened(1e-4))
            if solid.intersects(line):
                point = solid.intersection(line).representative_point()
                limit = f"must be in air, but touches the body at {point_text((point.x, point.y))}"
                raise DesignError(face.name, limit=limit, remedy="move it away, or reduce the motion angle")
        if not self.embedded and solid.intersects(shapely.Point(self.emitter.point)):
            raise DesignError(
                "emitter",
                limit=f"is inside the body at {point_text(self.emitter.point)}, but must be in front of the lens",
                remedy="increase emitter.distance_mm or reduce the motion angle",
            )

    def _intersection_error(self, point: Point | None, reason: str = "") -> DesignError:
        """Return the error that names the faces that intersect, and their position."""
        text = f": {reason}"
        if point is not None:
            near = [face.name for face in self.all_faces if _distance_mm(face.curve, point) < NEARBY_MM]
            text = f" at {point_text(point)}" + (f", where {' and '.join(near)} meet" if near else "")
        return DesignError(
            "body outline",
            limit=f"intersects itself{text}",
            remedy=Y_REMEDY if "crotch" in self.marks else "correct the design there, or reduce the motion angles",
        )


def polyline(outline: tuple[Face, ...], tolerance_mm: float) -> FloatArray:
    """Return a closed polyline (N, 2) within ``tolerance_mm`` of an outline; its last point repeats the first."""
    pieces = [face.curve.flattened(tolerance_mm)[:-1] for face in outline]
    return np.vstack([*pieces, pieces[0][:1]])


def material(body: Body, tolerance_mm: float) -> "shapely.geometry.base.BaseGeometry":
    """Return the area of a body without its holes, as a shapely geometry within ``tolerance_mm``."""
    return filled([polyline(outline, tolerance_mm) for outline in body.outlines])


def filled(rings: list[FloatArray]) -> "shapely.geometry.base.BaseGeometry":
    """Return the area within an odd number of closed polylines, as a shapely geometry."""
    import shapely

    solid: shapely.geometry.base.BaseGeometry = shapely.Polygon(rings[0])
    for ring in rings[1:]:
        solid = solid.symmetric_difference(shapely.Polygon(ring))
    return solid


def point_text(point: Point) -> str:
    """Format the coordinates of a point for error messages."""
    return f"x = {point[0]:.4g}, z = {point[1]:.4g} mm"


def _words(name: str) -> tuple[str, str]:
    """Return the first word of a face name and the remainder, without the segment number."""
    name = re.sub(r"\.\d+$", "", name)
    part = re.match(r"[^\W\d_]*", name)
    first = part.group() if part else ""
    return first, name[len(first) :].strip("-_ ")


def _check_closed(outline: tuple[Face, ...]) -> None:
    if not outline:
        raise DesignError("body outline", limit="has no faces, but must be closed")
    for face, following in pairwise((*outline, outline[0])):
        gap_mm = math.dist(face.curve.end, following.curve.start)
        if not gap_mm <= GAP_MM:
            raise DesignError(
                "body outline",
                limit=f"has a gap of {gap_mm:.3g} mm between {face.name} and {following.name}, at "
                f"{point_text(face.curve.end)}",
            )


def _check_orientation(ring: FloatArray, around: int) -> None:
    """Raise `DesignError` unless an outline has the orientation that the number of outlines around it requires."""
    is_hole = around % 2 == 1
    if (area(ring) < 0.0) != is_hole:
        required = "clockwise" if is_hole else "counter-clockwise"
        raise DesignError("body outline", limit=f"must run {required}, with the material on its left")


def _position_in(reason: str) -> Point | None:
    """Return the position in shapely's explanation of an invalid geometry; None if it contains none."""
    numbers = re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", reason)
    return (float(numbers[-2]), float(numbers[-1])) if len(numbers) >= 2 else None


def area(outline: FloatArray) -> float:
    """Return the area of a closed polyline, positive if counter-clockwise."""
    x, z = outline.T
    return float(np.sum(x[:-1] * z[1:] - x[1:] * z[:-1]) / 2)


def _distance_mm(curve: Curve, point: Point) -> float:
    import shapely

    return float(shapely.LineString(curve.flattened()).distance(shapely.Point(point)))

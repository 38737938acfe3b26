"""Drawing sent to the printer: the outlines of a body, unchanged or compensated so that they print as designed.

An outline consists of named faces. In a compensated drawing, the lens is a new curve through given points, all other
walls are displaced along their normals by a common distance (the growth of a straight wall), and the entire drawing is
scaled about the centre of the lens to compensate shrinkage. If two displaced faces no longer meet, they are trimmed or
extended to the intersection of their tangents.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Curve, Segment, Spline
from solen.errors import DesignError
from solen.geometry import Body, Face
from solen.plane import Point

FLAT_MM = 1e-4
"""Maximum distance between a curve and the polyline that replaces it."""
_MIN_SINE = 1e-3  # of the angle between tangents that are extended to their intersection
_COINCIDENT_MM = 1e-6
_MAX_MITRE = 20.0  # maximum length of an extension, divided by the gap


@dataclass(frozen=True, eq=False)
class DrawnFace:
    """Name of a face and its polyline (N, 2) in mm."""

    name: str
    points: FloatArray


def lens_face(body: Body) -> Face:
    """Return the lens face of a body; raise `DesignError` if there is not exactly one."""
    faces = [face for face in body.all_faces if face.part == "lens"]
    if len(faces) != 1:
        limit = f"must be exactly one face whose name begins with lens, but the body has {len(faces)}"
        raise DesignError("lens", limit=limit, remedy="rename or join the faces")
    return faces[0]


def as_designed(body: Body) -> list[list[DrawnFace]]:
    """Return the unchanged outlines of a body."""
    return [[DrawnFace(face.name, face.curve.flattened(FLAT_MM)) for face in outline] for outline in body.outlines]


def redrawn(
    body: Body, lens: FloatArray, wall_um: float, scale: float = 1.0, centre: Point = (0.0, 0.0)
) -> list[list[DrawnFace]]:
    """Return outlines with the given lens points and other walls displaced outwards by ``wall_um``, after scaling.

    Raises
    ------
    DesignError
        If a wall is too short for its displacement.
    """
    outlines, origin = [], np.asarray(centre)
    for outline in body.outlines:
        faces = []
        for face in outline:
            is_lens = face.part == "lens"
            points = lens if is_lens else _displaced(face.curve.flattened(FLAT_MM), wall_um * 1e-3)
            faces.append(DrawnFace(face.name, points))
        outlines.append([replace(face, points=origin + scale * (face.points - origin)) for face in _joined(faces)])
    return outlines


def rings_of(outlines: Sequence[Sequence[DrawnFace]]) -> list[FloatArray]:
    """Return drawn outlines as closed polylines, whose last point does not repeat the first."""
    return [np.vstack([face.points[:-1] for face in outline]) for outline in outlines]


def curve_of(face: DrawnFace) -> Curve:
    """Return the exact curve of a drawn face: a segment, or a spline through its points."""
    if len(face.points) == 2:
        (a, b) = ((float(x), float(z)) for x, z in face.points)
        return Segment(a, b)
    return Spline.through(face.points)


def _displaced(points: FloatArray, by_mm: float) -> FloatArray:
    """Return a polyline displaced to its right, away from the material."""
    step = np.diff(points, axis=0)
    step /= np.hypot(*step.T)[:, None]
    tangent = np.vstack([step[:1], step[:-1] + step[1:], step[-1:]])
    tangent /= np.hypot(*tangent.T)[:, None]
    return np.asarray(points + by_mm * np.column_stack([tangent[:, 1], -tangent[:, 0]]))


def _joined(faces: list[DrawnFace]) -> list[DrawnFace]:
    """Return faces trimmed or extended so that each begins at the end of the previous one."""
    points = [face.points for face in faces]
    corners = [_corner(points[i - 1], points[i], faces[i].name) for i in range(len(points))]
    joined = []
    for i, face in enumerate(faces):
        start, end = corners[i], corners[(i + 1) % len(corners)]
        joined.append(replace(face, points=_trimmed(points[i], start, end, face.name)))
    return joined


def _corner(before: FloatArray, after: FloatArray, name: str) -> FloatArray:
    """Return the intersection of the tangents at the end of one polyline and the start of the next."""
    a, b = before[-1], after[0]
    ta, tb = _unit(before[-1] - before[-2]), _unit(after[1] - after[0])
    sine = float(ta[0] * tb[1] - ta[1] * tb[0])
    gap = b - a
    if abs(sine) < _MIN_SINE or math.hypot(*gap) < _COINCIDENT_MM:
        return np.asarray(0.5 * (a + b))
    along = float(gap[0] * tb[1] - gap[1] * tb[0]) / sine
    if abs(along) > _MAX_MITRE * math.hypot(*gap):
        limit = f"is too sharp to displace its walls: {math.degrees(math.asin(sine)):.2g} deg"
        raise DesignError(f"corner before {name}", limit=limit, remedy="make the corner blunter, or round it")
    return np.asarray(a + along * ta)


def _trimmed(points: FloatArray, start: FloatArray, end: FloatArray, name: str) -> FloatArray:
    """Return a polyline cut to end at two new corners: its points beyond them are removed."""
    first, last = _unit(points[1] - points[0]), _unit(points[-1] - points[-2])
    inner = points[1:-1]
    keep = ((inner - start) @ first > _COINCIDENT_MM) & ((end - inner) @ last > _COINCIDENT_MM)
    if len(points) > 3:  # each half has one corner only, because the tangent at the other may cut a curved face
        middle = len(inner) // 2
        keep[:middle] = ((inner - start) @ first > _COINCIDENT_MM)[:middle]
        keep[middle:] = ((end - inner) @ last > _COINCIDENT_MM)[middle:]
    if float((end - start) @ (points[-1] - points[0])) <= 0.0:
        limit = "is too short: the displacement of the neighbouring walls would remove all of it"
        raise DesignError(name, limit=limit, remedy="lengthen it")
    return np.vstack([start, inner[keep], end])


def _unit(step: FloatArray) -> FloatArray:
    return np.asarray(step / math.hypot(*step))

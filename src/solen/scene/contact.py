"""Pads: other media in contact with part of a wall, each with its own edges.

A medium must be closed, so a medium that touches a wall is given a depth: its outer edge follows the wall at that
distance, and straight edges join the two. These edges are either black, and absorb light that has entered the medium,
or clear, and transmit it into the air. Neighbouring faces in one wall table share a pad if the wall between them is
smooth or turns outwards; pads from different tables meet at a common edge.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, CubicChain, Curve, Segment, Spline
from solen.errors import DesignError
from solen.geometry import Body, Face
from solen.plane import Point, cross, dot
from solen.scene.model import Behaviour, Interface, Region
from solen.spec import Wall

SMOOTH = 0.02
"""Sine of the largest corner angle that is treated as smooth: the outer edges of both faces then meet on the angle
bisector.
"""
OUTER_POINTS = 65
"""Number of points per spline along the outer edge of a curved face."""
FLAT_MM = 1e-4
"""Maximum deviation of the polylines used to check pads for overlaps."""
OVERLAP_MM2 = 1e-7
EXACT_MM = 1e-12
"""Maximum depth error with which an outer edge is treated as an exact arc."""


@dataclass(frozen=True)
class Pad:
    """The part of a pad that lies on one face."""

    face: Face
    wall: Wall
    outer: Curve

    @property
    def behaviour(self) -> Literal["absorbing", "refracting"]:
        """Behaviour of the pad edges."""
        return "absorbing" if self.wall.beyond == "black" else "refracting"

    def edge(self, curve: Curve, what: str) -> Interface:
        """Return an edge between the pad, on its left, and the air."""
        return Interface(f"{self.face.name} {what}", curve, self.wall.outside, "air", self.behaviour)


def pad_regions(walls: Sequence[Wall]) -> tuple[Region, ...]:
    """Return the media of all wall tables, each once.

    Raises
    ------
    DesignError
        If two tables give different indices or absorptions for media of the same name.
    """
    regions: dict[str, Region] = {}
    for number, wall in enumerate(walls):
        if wall.outside == "air" or wall.index is None:
            continue
        region = Region(wall.outside, wall.index, wall.absorption_per_mm)
        if regions.setdefault(wall.outside, region) != region:
            limit = "another wall table gives this medium a different index or absorption"
            raise DesignError(f"wall[{number}].outside", value=wall.outside, limit=limit, remedy="use another name")
    return tuple(regions.values())


def pad_edges(body: Body, walls: Sequence[Wall]) -> tuple[Interface, ...]:
    """Return the edges of all pads on a body, excluding the faces that the pads touch."""
    interfaces: list[Interface] = []
    pads: list[Pad] = []
    for outline in body.outlines:
        touching = [_pad(outline, i, walls) for i in range(len(outline))]
        pads += [pad for pad in touching if pad is not None]
        for i, pad in enumerate(touching):
            if pad is not None:
                interfaces += _edges(touching[i - 1], pad, touching[(i + 1) % len(touching)])
    _check_pads(body, pads)
    return tuple(interfaces)


def _pad(outline: tuple[Face, ...], i: int, walls: Sequence[Wall]) -> Pad | None:
    """Return the part of a pad on one face, or None if only air touches the face."""
    face = outline[i]
    wall = _touching(face, walls)
    if wall is None:
        return None
    before, behind = outline[i - 1], outline[(i + 1) % len(outline)]
    first = _corner(before, face) if _touching(before, walls) else None
    last = _corner(face, behind) if _touching(behind, walls) else None
    return Pad(face, wall, _outer(face, wall.depth_mm, first, last))


def _touching(face: Face, walls: Sequence[Wall]) -> Wall | None:
    wall = None if face.wall is None else walls[face.wall]
    return None if wall is None or wall.outside == "air" else wall


def _edges(before: Pad | None, pad: Pad, behind: Pad | None) -> Iterator[Interface]:
    """Yield the edges of the part of a pad on one face; an edge between two parts belongs to the second."""
    yield pad.edge(pad.outer, "outer edge")
    if before is None or not _joined(before, pad):
        yield pad.edge(Segment(pad.face.curve.start, pad.outer.start), "first edge")
    elif before.wall is not pad.wall:
        yield from _between(before, pad)
    elif before.outer.end != pad.outer.start and not _smooth(before.face, pad.face):
        yield pad.edge(Segment(before.outer.end, pad.outer.start), "corner edge")
    if behind is None or not _joined(pad, behind):
        yield pad.edge(Segment(pad.outer.end, pad.face.curve.end), "last edge")


def _joined(before: Pad, behind: Pad) -> bool:
    """Whether the pad parts on two faces join: if the wall is smooth there, or turns outwards within one wall table."""
    if _smooth(before.face, behind.face):
        return True
    if _turn(before.face, behind.face) < 0.0:
        x, z = behind.face.curve.start
        raise DesignError(
            f"wall {before.wall.outside}",
            limit=f"turns inwards from {before.face.name} to {behind.face.name} at x = {x:.4g}, z = {z:.4g} mm, "
            f"where a pad {before.wall.depth_mm:g} mm deep would overlap itself",
            remedy="end the treated part of the wall before the corner",
        )
    return before.wall is behind.wall


def _smooth(before: Face, behind: Face) -> bool:
    return abs(_turn(before, behind)) <= SMOOTH


def _turn(before: Face, behind: Face) -> float:
    """Sine of the angle by which the wall turns left between two faces; ±2 if the angle exceeds 90 degrees."""
    corner = behind.curve.start
    first, last = before.curve.normal_at(corner), behind.curve.normal_at(corner)
    sine = cross(first, last)
    return sine if dot(first, last) > 0.0 else math.copysign(2.0, sine)


def _corner(before: Face, behind: Face) -> Point | None:
    """Vector from the corner of two joined faces to the corner of their outer edges, for a depth of 1 mm."""
    if not _smooth(before, behind):
        return None
    corner = behind.curve.start
    first, last = before.curve.normal_at(corner), behind.curve.normal_at(corner)
    bisector = (first[0] + last[0], first[1] + last[1])
    return (-2.0 * bisector[0] / dot(bisector, bisector), -2.0 * bisector[1] / dot(bisector, bisector))


def _between(before: Pad, pad: Pad) -> Iterator[Interface]:
    """Yield the edge between two different pads on a smooth wall, and the exposed end of the deeper one."""
    behaviour: Behaviour = "absorbing" if "absorbing" in (before.behaviour, pad.behaviour) else "refracting"
    start, near, far = pad.face.curve.start, before.outer.end, pad.outer.start
    shallow = near if before.wall.depth_mm <= pad.wall.depth_mm else far
    sides = (pad.wall.outside, before.wall.outside)
    yield Interface(f"{pad.face.name} shared edge", Segment(start, shallow), *sides, behaviour)
    if before.wall.depth_mm < pad.wall.depth_mm:
        yield pad.edge(Segment(near, far), "first edge")
    elif before.wall.depth_mm > pad.wall.depth_mm:
        yield before.edge(Segment(near, far), "last edge")


def _outer(face: Face, depth_mm: float, first: Point | None, last: Point | None) -> Curve:
    """Return the curve ``depth_mm`` outside a face: exact for a line and an arc, otherwise a spline through points.

    At a slight corner of a smooth wall, ``first`` and ``last`` determine where the outer edge begins and ends; the
    resulting depth deviations are distributed linearly along the face.
    """
    curve = face.curve
    u = np.linspace(0.0, 1.0, OUTER_POINTS * (len(curve.controls) if isinstance(curve, CubicChain) else 1))
    points = curve.points(u)
    normals = _normals(curve, u)
    outer = points - depth_mm * normals
    shift_first = np.zeros(2) if first is None else depth_mm * (np.asarray(first) + normals[0])
    shift_last = np.zeros(2) if last is None else depth_mm * (np.asarray(last) + normals[-1])
    outer += np.outer(1.0 - u, shift_first) + np.outer(u, shift_last)
    if np.any(np.sum(np.diff(outer, axis=0) * np.diff(points, axis=0), axis=1) <= 0.0):
        limit = f"{face.name} curves inwards with a radius below {depth_mm:g} mm"
        raise DesignError("wall.depth_mm", value=depth_mm, limit=limit, remedy="reduce the depth")
    if isinstance(curve, Segment):
        return Segment((float(outer[0, 0]), float(outer[0, 1])), (float(outer[-1, 0]), float(outer[-1, 1])))
    if isinstance(curve, Arc) and max(np.abs(shift_first).max(), np.abs(shift_last).max()) < EXACT_MM:
        outwards = 1.0 if curve.sweep_deg > 0.0 else -1.0
        return Arc(curve.center, curve.radius_mm + outwards * depth_mm, curve.start_deg, curve.sweep_deg)
    return Spline.through(outer)


def _normals(curve: Curve, u: FloatArray) -> FloatArray:
    """Left unit normals (N, 2) of a curve, which point into the body."""
    x, z = curve.velocities(u).T
    return np.asarray(np.column_stack([-z, x]) / np.hypot(x, z)[:, None])


def _check_pads(body: Body, pads: Sequence[Pad]) -> None:
    """Check that each pad is in air: not in the body or another pad, and not over the emitter or a receiver."""
    if not pads:
        return
    import shapely

    from solen.geometry import material

    solid, shapes = material(body, FLAT_MM), [shapely.Polygon(_ring(pad)) for pad in pads]
    obstacles: list[tuple[str, shapely.LineString | shapely.Point]] = [
        (face.name, shapely.LineString(face.curve.flattened(FLAT_MM))) for face in body.separate
    ]
    obstacles.append(("the emitter", shapely.Point(body.emitter.point)))
    for i, (pad, shape) in enumerate(zip(pads, shapes, strict=True)):
        others = [("the body", solid), *((p.face.name, s) for p, s in list(zip(pads, shapes, strict=True))[:i])]
        touched = next((name for name, other in others if shape.intersection(other).area > OVERLAP_MM2), None)
        touched = touched or next((name for name, obstacle in obstacles if shape.intersects(obstacle)), None)
        if touched is not None or not shape.is_valid:
            raise DesignError(
                f"wall {pad.wall.outside}",
                limit=f"the pad on {pad.face.name}, {pad.wall.depth_mm:g} mm deep, reaches into {touched or 'itself'}",
                remedy="reduce depth_mm, or shorten the treated part of the wall",
            )


def _ring(pad: Pad) -> FloatArray:
    return np.vstack([pad.face.curve.flattened(FLAT_MM), pad.outer.flattened(FLAT_MM)[::-1]])

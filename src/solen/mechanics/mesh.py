"""Mesh of quadratic triangles that follows the exact outline of a body.

Points are placed on the exact curves, more densely at corners, at the ends of holds and at requested positions, and the
inside is triangulated with the same grading (`solen.mechanics.triangulation`). Edges of the outline that are missing in
the triangulation are halved until all are present. The midpoint nodes of elements along the outline are on the curve.

Public names: `mesh_of`, `MeshOptions`, `BodyMesh` and `Edges`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.errors import DesignError
from solen.geometry import Body, Face
from solen.geometry.body import filled, point_text
from solen.geometry.measures import area_mm2, perimeter_mm
from solen.mechanics.triangulation import Sizes, triangulate

ELEMENTS_ACROSS = 6.0
"""Default number of elements across the mean width of a body."""
CORNER_SIZE = 0.25
"""Element size at corners and ends of holds, relative to the size elsewhere."""
NOTCH_SIZE = 1 / 32
"""Relative element size in re-entrant corners, where the strain is unbounded."""
MIN_CORNER_DEG = 15.0
"""Smallest angle between two faces that is treated as a corner."""
SIZE_PER_RADIUS = 0.4
"""Element size relative to the radius of a curved wall."""
MAX_ROUNDS = 8
SAMPLES = 1025
MAX_TRIANGLES = 200_000


@dataclass(frozen=True)
class MeshOptions:
    """Density of the mesh of a body.

    Attributes
    ----------
    size_mm
        Size of the elements far from corners; None: a sixth of the body's mean width.
    finer
        Positions with smaller elements, each (x, z, size in mm); the size increases with the distance from them.
    """

    size_mm: float | None = None
    finer: tuple[tuple[float, float, float], ...] = ()


class Edges(NamedTuple):
    """Nodes along a face: parameters (N,) in ascending order and indices (N,); every second node is a midpoint."""

    u: FloatArray
    nodes: IndexArray


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """Quadratic triangles of a body.

    Attributes
    ----------
    mesh
        The scikit-fem mesh; corners come first among its nodes.
    points_mm
        Positions (N, 2) of all nodes.
    faces
        Nodes along each face, keyed by its name.
    """

    mesh: Any
    points_mm: FloatArray
    faces: Mapping[str, Edges]

    @property
    def corners(self) -> int:
        """Number of nodes that are triangle corners."""
        return int(self.mesh.nvertices)


def mesh_of(body: Body, options: MeshOptions, cuts: Mapping[str, Sequence[float]]) -> BodyMesh:
    """Return the mesh of a body at rest.

    Parameters
    ----------
    body
        A checked body with an outline that is the same at all heights.
    options
        Element sizes.
    cuts
        Parameters at which an edge must end, keyed by the name of the face: ends of holds and contacts of fingers.

    Raises
    ------
    DesignError
        If the sizes require too many triangles, or a corner is too sharp to be filled.
    """
    body.prism()
    sizes = _sizes_of(body, options, cuts)
    _check_count(body, sizes, options.size_mm)
    rings = [[_parameters(face, sizes, cuts.get(face.name, ())) for face in outline] for outline in body.outlines]
    for _ in range(MAX_ROUNDS):
        outline = _Outline.of(body, rings)
        points, triangles = triangulate(outline.points, outline.polygon(), sizes)
        missing = outline.missing(triangles)
        if not missing.any():
            return _quadratic(body, rings, outline, points, triangles)
        rings = outline.halved(rings, missing)
    x, z = outline.points[int(np.flatnonzero(missing)[0])]
    limit = f"no triangles fit at {point_text((x, z))}, where the walls are too close to each other"
    raise DesignError("mesh", limit=limit, remedy="separate the walls there")


def _sizes_of(body: Body, options: MeshOptions, cuts: Mapping[str, Sequence[float]]) -> Sizes:
    width_mm = 2.0 * area_mm2(body.outlines) / perimeter_mm(body.outlines)
    size_mm = options.size_mm or width_mm / ELEMENTS_ACROSS
    if not (math.isfinite(size_mm) and size_mm > 0.0):
        raise DesignError("mechanics.mesh_mm", value=size_mm, limit="must be finite and above 0")
    sizes = Sizes(size_mm)
    for outline in body.outlines:
        for before, face in pairwise((outline[-1], *outline)):
            corner_deg = _corner_deg(before, face)
            if abs(corner_deg) > MIN_CORNER_DEG:
                sizes.add(face.curve.start, (CORNER_SIZE if corner_deg > 0.0 else NOTCH_SIZE) * size_mm)
            _bound_by_radius(sizes, face)
            for u in cuts.get(face.name, ()):
                sizes.add(face.curve.point_at(u), CORNER_SIZE * size_mm)
    for x, z, finer_mm in options.finer:
        sizes.add((x, z), finer_mm)
    return sizes


def _corner_deg(before: Face, after: Face) -> float:
    """Return the angle by which the outline turns between two faces, counter-clockwise; negative in a notch."""
    (ax, az), (bx, bz) = before.curve.velocity_at(1.0), after.curve.velocity_at(0.0)
    return math.degrees(math.atan2(ax * bz - az * bx, ax * bx + az * bz))


def _bound_by_radius(sizes: Sizes, face: Face) -> None:
    """Add smaller sizes where a wall is too strongly curved for the default size."""
    u = np.linspace(0.0, 1.0, 33)
    points, heading = face.curve.points(u), np.unwrap(np.arctan2(*face.curve.velocities(u).T))
    turns, lengths = np.abs(np.diff(heading)), np.hypot(*np.diff(points, axis=0).T)
    for point, turn, length in zip(points[1:], turns, lengths, strict=True):
        if SIZE_PER_RADIUS * length < sizes.largest_mm * turn:
            sizes.add(point, SIZE_PER_RADIUS * length / turn)


def _check_count(body: Body, sizes: Sizes, size_mm: float | None) -> None:
    """Raise `DesignError` if a mesh would have too many triangles."""
    smallest = min(sizes.sizes, default=sizes.largest_mm)
    triangles = 2.3 * area_mm2(body.outlines) / sizes.largest_mm**2
    if triangles > MAX_TRIANGLES or smallest < 1e-4 * sizes.largest_mm:
        limit = (
            f"elements of {smallest:.2g} to {sizes.largest_mm:.2g} mm would need more than {MAX_TRIANGLES} triangles"
        )
        remedy = "increase it" if triangles > MAX_TRIANGLES else "increase the smallest radius of a wall or finger"
        raise DesignError("mechanics.mesh_mm", value=size_mm, limit=limit, remedy=remedy)


def _parameters(face: Face, sizes: Sizes, cuts: Sequence[float]) -> FloatArray:
    """Return the parameters (N,) of the edge ends along a face: at the cuts, and between them as the sizes require."""
    ends = np.unique([0.0, *cuts, 1.0])
    pieces = [_spaced(face, low, high, sizes)[:-1] for low, high in pairwise(ends)]
    return np.concatenate([*pieces, [1.0]])


def _spaced(face: Face, low: float, high: float, sizes: Sizes) -> FloatArray:
    u = np.linspace(low, high, SAMPLES)
    points = face.curve.points(u)
    steps = np.hypot(*np.diff(points, axis=0).T) / sizes.at(0.5 * (points[1:] + points[:-1]))
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(1, round(float(reached[-1])))
    return np.asarray(np.interp(np.linspace(0.0, reached[-1], count + 1), reached, u))


@dataclass(frozen=True, eq=False)
class _Outline:
    """Edge ends along all outlines: points (N, 2), and for each the index (N,) of the next."""

    points: FloatArray
    following: IndexArray

    @classmethod
    def of(cls, body: Body, rings: list[list[FloatArray]]) -> "_Outline":
        points, following, first = [], [], 0
        for outline, ring in zip(body.outlines, rings, strict=True):
            ring_points = np.vstack([face.curve.points(u[:-1]) for face, u in zip(outline, ring, strict=True)])
            points.append(ring_points)
            following.append(first + np.roll(np.arange(len(ring_points)), -1))
            first += len(ring_points)
        return cls(np.vstack(points), np.concatenate(following))

    def polygon(self) -> Any:
        """Area within the outlines, as a shapely geometry."""
        rings, begin = [], 0
        while begin < len(self.points):
            end = begin + int(np.argmax(self.following[begin:] == begin)) + 1
            rings.append(np.vstack([self.points[begin:end], self.points[begin : begin + 1]]))
            begin = end
        return filled(rings)

    def missing(self, triangles: IndexArray) -> BoolArray:
        """Return a mask of the outline edges (N,) that belong to no triangle."""
        sides = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
        edges = np.sort(np.column_stack([np.arange(len(self.points)), self.following]), axis=1)
        factor = max(int(triangles.max()), len(self.points)) + 1
        return np.asarray(~np.isin(edges @ [factor, 1], sides @ [factor, 1]))

    @staticmethod
    def halved(rings: list[list[FloatArray]], missing: BoolArray) -> list[list[FloatArray]]:
        """Return the parameters with the missing edges halved."""
        marks = iter(missing)
        halved: list[list[FloatArray]] = []
        for ring in rings:
            halved.append([])
            for u in ring:
                middles = [0.5 * (a + b) for a, b in pairwise(u) if next(marks)]
                halved[-1].append(np.sort(np.concatenate([u, middles])))
        return halved


def _quadratic(
    body: Body, rings: list[list[FloatArray]], outline: _Outline, points: FloatArray, triangles: IndexArray
) -> BodyMesh:
    """Return the mesh with midpoint nodes; those of outline edges are on the curves."""
    from skfem import MeshTri, MeshTri2

    used, inverse = np.unique(triangles, return_inverse=True)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    mesh = MeshTri2.from_mesh(MeshTri(points[used].T.copy(), inverse.reshape(triangles.shape).T.copy()))
    positions = mesh.doflocs.T.copy()
    facets = np.sort(mesh.facets, axis=0)
    midpoints = {(int(a), int(b)): mesh.nvertices + i for i, (a, b) in enumerate(facets.T)}
    faces: dict[str, Edges] = {}
    first = 0
    for outline_faces, ring in zip(body.outlines, rings, strict=True):
        for face, u in zip(outline_faces, ring, strict=True):
            ends = np.append(np.arange(first, first + len(u) - 1), outline.following[first + len(u) - 2])
            first += len(u) - 1
            faces[face.name] = _edges_along(face, u, number[ends], midpoints, positions)
    return BodyMesh(replace(mesh, doflocs=positions.T.copy()), positions, faces)


def _edges_along(
    face: Face, u: FloatArray, ends: IndexArray, midpoints: Mapping[tuple[int, int], int], positions: FloatArray
) -> Edges:
    """Return the nodes along a face; move the positions of its midpoint nodes to the curve."""
    middles_u = _middles(face, u)
    middles = np.array([midpoints[min(a, b), max(a, b)] for a, b in pairwise(ends.tolist())], dtype=np.intp)
    positions[middles] = face.curve.points(middles_u)
    all_u, nodes = np.empty(2 * len(u) - 1), np.empty(2 * len(u) - 1, dtype=np.intp)
    all_u[::2], all_u[1::2], nodes[::2], nodes[1::2] = u, middles_u, ends, middles
    return Edges(all_u, nodes)


def _middles(face: Face, u: FloatArray) -> FloatArray:
    """Return the parameters at which both chords of each edge are equally long, from Newton's method."""
    a, b = face.curve.points(u[:-1]), face.curve.points(u[1:])
    middle = 0.5 * (u[:-1] + u[1:])
    for _ in range(3):
        at = face.curve.points(middle)
        excess = np.hypot(*(at - a).T) - np.hypot(*(b - at).T)
        middle = middle - 0.5 * excess / np.hypot(*face.curve.velocities(middle).T)
    return np.asarray(np.clip(middle, u[:-1], u[1:]))

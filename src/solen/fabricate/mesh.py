"""Closed triangle mesh of a part: two triangles share each edge, with vertices counter-clockwise as seen from outside.

Outlines are approximated by points on the exact curves, joined by straight lines that deviate by at most a specified
tolerance; manifold3d triangulates top and bottom and makes the cuts. Points that the 32-bit numbers of an STL cannot
resolve are merged beforehand, so that every format contains the same closed surface.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.errors import DesignError, SpecError
from solen.fabricate.lens_parts import FacedPart
from solen.fabricate.part import Part, Prism

if TYPE_CHECKING:
    from manifold3d import Manifold

MIN_TOLERANCE_MM, MAX_TOLERANCE_MM = 1e-4, 1.0
"""Minimum and maximum tolerance of a mesh."""
WELD_MM = 1e-5
"""Points closer together than this are merged."""
WELD_ULPS = 8.0
"""Minimum distance of points in spacings of 32-bit numbers, which exceeds `WELD_MM` far from the origin."""
BATCH = 100_000
"""Number of triangles or vertices that are processed at a time."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of a closed surface that deviates from the exact solid by at most ``tolerance_mm``.

    ``vertices`` (N, 3) are in mm; ``triangles`` (M, 3) are vertex indices, counter-clockwise as seen from outside.
    """

    vertices: FloatArray
    triangles: IntArray
    tolerance_mm: float

    @cached_property
    def volume_mm3(self) -> float:
        """Enclosed volume: the sum of the tetrahedra between the triangles and the centre of the mesh."""
        return sum(float(volumes.sum()) for _, volumes in self.six_volumes()) / 6.0

    def six_volumes(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield six times the tetrahedron volumes, one batch of triangles at a time."""
        centre = self.vertices.mean(axis=0)
        for batch, (a, b, c) in self.corners():
            yield batch, np.asarray(np.einsum("ij,ij->i", a - centre, np.cross(b - centre, c - centre)))

    def corners(self) -> Iterator[tuple[slice, FloatArray]]:
        """Yield the corners (3, m, 3) of one batch of triangles at a time, which limits the memory for a large mesh."""
        for first in range(0, len(self.triangles), BATCH):
            batch = slice(first, first + BATCH)
            yield batch, self.vertices[self.triangles[batch].T]

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Extent along X, Y and Z."""
        x, y, z = np.ptp(self.vertices, axis=0).tolist()
        return (x, y, z)

    def open_edges(self) -> int:
        """Return the number of edges without exactly two consistently oriented triangles; 0 if the mesh is closed."""
        edges = self._directed_edges()
        edges.sort()
        if np.all(edges[1:] != edges[:-1]):
            reversed_edges = self._directed_edges(backwards=True)
            reversed_edges.sort()
            if np.array_equal(edges, reversed_edges):
                return 0
        edges, counts = np.unique(edges, return_counts=True)
        reversed_edges = edges % len(self.vertices) * len(self.vertices) + edges // len(self.vertices)
        at = np.minimum(np.searchsorted(edges, reversed_edges), len(edges) - 1)
        paired = (counts == 1) & (edges[at] == reversed_edges) & (counts[at] == 1)
        return int(np.count_nonzero(~paired))

    def _directed_edges(self, *, backwards: bool = False) -> IntArray:
        """Return every directed edge of every triangle, encoded as an integer."""
        count, sides = len(self.triangles), [(0, 1), (1, 2), (2, 0)]
        edges = np.empty(3 * count, np.int64)
        for number, (start, end) in enumerate(sides):
            first, second = (end, start) if backwards else (start, end)
            part = edges[number * count : (number + 1) * count]
            np.multiply(self.triangles[:, first], len(self.vertices), out=part)
            part += self.triangles[:, second]
        return edges


def mesh_of(part: Part, tolerance_mm: float) -> Mesh:
    """Return a mesh of a part that deviates from its exact walls by at most ``tolerance_mm``; top and bottom are exact.

    Raises
    ------
    SpecError
        If the tolerance is out of range, or so coarse that outlines would intersect.
    """
    weld_mm = _weld_mm(part)
    finest_mm = max(MIN_TOLERANCE_MM, 2.0 * weld_mm)
    if not finest_mm <= tolerance_mm <= MAX_TOLERANCE_MM:
        limit = f"must be {finest_mm:g} to {MAX_TOLERANCE_MM:g} mm for this part"
        raise SpecError("--tolerance-mm", value=tolerance_mm, limit=limit)
    solid = _joined([_manifold(prism, tolerance_mm, weld_mm) for prism in part.prisms])
    if isinstance(part, FacedPart):
        solid -= _of_triangles(*part.hollow.surface(tolerance_mm), part.name)
    for cut in part.cuts:
        solid -= _manifold(cut.tool, tolerance_mm, weld_mm)
    return closed_mesh(solid.simplify(weld_mm), tolerance_mm, part.name)


def closed_mesh(solid: Any, tolerance_mm: float, name: str) -> Mesh:
    """Return the mesh of a manifold3d solid; raise `DesignError` if it is empty or not closed."""
    surface = solid.to_mesh64()
    mesh = Mesh(np.array(surface.vert_properties[:, :3]), np.array(surface.tri_verts, dtype=np.int64), tolerance_mm)
    if not len(mesh.triangles) or mesh.open_edges():
        limit = f"has no closed mesh within {tolerance_mm:g} mm"
        raise DesignError(name, limit=limit, remedy="simplify the outline")
    return mesh


def _weld_mm(part: Part) -> float:
    farthest = max(float(np.abs(prism.rings(MAX_TOLERANCE_MM)[0]).max()) for prism in part.prisms)
    return max(WELD_MM, WELD_ULPS * float(np.spacing(np.float32(farthest))))


def _joined(solids: "list[Manifold]") -> "Manifold":
    from manifold3d import Manifold, OpType

    return Manifold.batch_boolean(solids, OpType.Add) if len(solids) > 1 else solids[0]


def _manifold(prism: Prism, tolerance_mm: float, weld_mm: float) -> "Manifold":
    """Return the manifold3d solid of a prism."""
    rings = [_welded(ring, weld_mm) for ring in prism.rings(tolerance_mm - weld_mm)]
    _check_disjoint(prism, rings, tolerance_mm)
    return _of_triangles(*_prism_surface(rings, prism.from_mm, prism.to_mm), prism.name)


def _of_triangles(vertices: FloatArray, triangles: IntArray, name: str) -> "Manifold":
    """Return the manifold3d solid of closed triangles."""
    from manifold3d import Error, Manifold, Mesh64

    solid = Manifold(Mesh64(vertices, triangles.astype(np.uint64)))
    if solid.status() != Error.NoError:
        raise DesignError(name, limit=f"has no closed surface (manifold3d: {solid.status().name})")
    return solid


def _welded(ring: FloatArray, weld_mm: float) -> FloatArray:
    """Return the corners (N, 2) of a closed polyline, without those too close to the previous corner."""
    corners = ring[:-1]
    kept = [0]
    for i in range(1, len(corners)):
        if np.hypot(*(corners[i] - corners[kept[-1]])) > weld_mm:
            kept.append(i)
    while len(kept) > 1 and np.hypot(*(corners[kept[-1]] - corners[0])) <= weld_mm:
        kept.pop()
    return corners[kept]


def _check_disjoint(prism: Prism, rings: list[FloatArray], tolerance_mm: float) -> None:
    """Raise `SpecError` if polylines intersect at this tolerance although the curves do not."""
    import shapely

    polygons = [shapely.Polygon(ring) for ring in rings if len(ring) > 2]
    simple = len(polygons) == len(rings) and all(polygon.is_valid for polygon in polygons)
    if not simple or any(a.exterior.intersects(b.exterior) for a, b in combinations(polygons, 2)):
        limit = f"is too coarse for the outlines of {prism.name}, which would intersect"
        raise SpecError("--tolerance-mm", value=tolerance_mm, limit=limit, remedy="use a smaller tolerance")


def _prism_surface(rings: list[FloatArray], from_mm: float, to_mm: float) -> tuple[FloatArray, IntArray]:
    """Return the vertices of a prism, the lower ones first, and the triangles of its closed surface."""
    from manifold3d import triangulate

    corners = np.vstack(rings)
    count = len(corners)
    cap = np.asarray(triangulate(rings), dtype=np.int64)
    corner = np.arange(count)
    starts = np.cumsum([0, *(len(ring) for ring in rings)])
    following = corner + 1
    following[starts[1:] - 1] = starts[:-1]
    low = np.column_stack([corner, following, following + count])
    high = np.column_stack([corner, following + count, corner + count])
    vertices = np.vstack([np.column_stack([corners, np.full(count, height)]) for height in (from_mm, to_mm)])
    return vertices, np.vstack([cap[:, ::-1], cap + count, low, high])

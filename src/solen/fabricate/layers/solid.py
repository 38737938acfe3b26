"""Solids to be sliced: exact outlines at each height, or a closed mesh, with minimum coordinates at the origin.

A part that is printed flat needs no mesh: its outlines change only at its horizontal faces, so all layers between two
such faces are identical. Any other part is a mesh, which `solen.fabricate.layers.cut` slices; manifold3d unites
overlapping shells beforehand.
"""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DataError, DesignError, SpecError
from solen.fabricate.layers.cut import Cutter, Shells
from solen.fabricate.lens_parts import FacedPart
from solen.fabricate.mesh import Mesh, mesh_of
from solen.fabricate.part import Part, Prism
from solen.fabricate.raster import rings_of
from solen.geometry import section
from solen.geometry.body import filled

Rings = Sequence[FloatArray]

PLAN_MM = 1e-4
"""Tolerance of the polylines of a plan, far below the size of a pixel."""
MESH_MM = 2e-4
"""Tolerance of a mesh of the surface."""
MIN_OVERLAP = 1e-6
"""Minimum overlap of shells as a fraction of the mesh volume; a smaller overlap is treated as contact."""
LEVEL_MM = 1e-5
"""A face is horizontal if the heights of its vertices differ by less than this."""


@dataclass(frozen=True, eq=False)
class Solid(ABC):
    """A solid in its orientation on the plate, which is at Z = 0; its minimum X and Y are 0.

    Attributes
    ----------
    size_mm
        Extent along X, Y and Z.
    origin_mm
        X and Y of the origin of the part.
    volume_mm3
        Volume of the solid.
    heights_mm
        Heights of the horizontal faces, in ascending order.
    """

    size_mm: tuple[float, float, float]
    origin_mm: tuple[float, float]
    volume_mm3: float
    heights_mm: tuple[float, ...]

    @property
    def exposures_s(self) -> tuple[float, ...]:
        """Exposure times of images that are exposed one after the other at one height; empty for a stack."""
        return ()

    @abstractmethod
    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """Return a number that identical sections share (or None), and the rings of the section, holes clockwise."""


@dataclass(frozen=True, eq=False)
class Plan(Solid):
    """Outlines that are constant between heights: ``rings[numbers[i]]`` from ``heights_mm[i]`` to the next height."""

    numbers: tuple[int, ...]
    rings: tuple[Rings, ...]

    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """See `Solid.section`."""
        index = bisect_right(self.heights_mm, z_mm) - 1
        if not 0 <= index < len(self.numbers):
            return None, []
        number = self.numbers[index]
        return number, self.rings[number]


@dataclass(frozen=True, eq=False)
class Sections(Solid):
    """A part that is printed flat and whose smooth lens varies with height: exact sections, computed on demand."""

    part: FacedPart
    rotation: FloatArray

    @classmethod
    def of(cls, part: FacedPart, rotation: FloatArray) -> "Sections":
        """Return the solid of a part rotated about the normal of the plate by a matrix (2, 2)."""
        hollow, (blank,) = part.hollow, part.prisms
        half, nearest = hollow.lens.half_width_mm, hollow.lens.nearest_mm
        behind = [ring[ring[:, 1] >= nearest] for ring in blank.rings(PLAN_MM)]
        points = np.vstack([*behind, [(-half, nearest), (half, nearest)]]) @ rotation.T
        corner, (x, y) = points.min(axis=0), np.ptp(points, axis=0).tolist()
        cuts = [cut.removed for cut in part.cuts]
        levels = {0.0, blank.to_mm} | {height for cut in cuts for height in (cut.from_mm, cut.to_mm)}
        origin = (-float(corner[0]), -float(corner[1]))
        return cls((x, y, blank.to_mm), origin, part.volume_mm3, tuple(sorted(levels)), part, rotation)

    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """See `Solid.section`."""
        hollow = self.part.hollow
        if not 0.0 <= z_mm < self.size_mm[2]:
            return None, []
        outlines = section(hollow.body, hollow.lens.half_height_mm - z_mm).check().outlines
        prism = Prism("section", outlines, 0.0, self.size_mm[2])
        tools = [cut.tool for cut in self.part.cuts if cut.tool.from_mm < z_mm < cut.tool.to_mm]
        return None, [ring @ self.rotation.T + self.origin_mm for ring in _rings([prism], tools)]


@dataclass(frozen=True, eq=False)
class Exposures(Solid):
    """Parts of one layer that are exposed one after the other, each for its own time, without a lift in between.

    With ``greys`` (0 to 1 for each part), all parts are exposed together for the first of these times, each with its
    grey level.
    """

    names: tuple[str, ...]
    rings: tuple[Rings, ...]
    seconds: tuple[float, ...]
    greys: tuple[float, ...] = ()

    @property
    def exposures_s(self) -> tuple[float, ...]:
        """See `Solid.exposures_s`."""
        return self.seconds[:1] if self.greys else self.seconds

    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """Return the section of all parts together; see `Solid.section`."""
        inside = 0.0 <= z_mm < self.size_mm[2]
        return None, [ring for rings in self.rings for ring in rings] if inside else []


@dataclass(frozen=True, eq=False)
class Slices(Solid):
    """A closed mesh that is sliced on demand; ``overlap_mm3`` is the overlap of its shells before they were united."""

    cutter: Cutter
    overlap_mm3: float = 0.0

    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """See `Solid.section`."""
        return None, self.cutter.rings(z_mm)


def fine_mesh(part: Part) -> Mesh:
    """Return the mesh of a part within `MESH_MM`; raise `DesignError` if there is none."""
    try:
        return mesh_of(part, MESH_MM)
    except SpecError as error:  # of the tolerance, which is not an option here
        limit = f"has no closed mesh within {MESH_MM:g} mm"
        raise DesignError(part.name, limit=limit, remedy="simplify the outline") from error


def solid_of(part: Part, rotation: FloatArray) -> Solid:
    """Return the solid of a part rotated by a matrix (3, 3): exact outlines if Z stays vertical, otherwise `Slices`.

    Raises
    ------
    DesignError
        If the mesh cannot be made.
    """
    if rotation[2, 2] == 1.0 and isinstance(part, FacedPart):
        return Sections.of(part, rotation[:2, :2])
    if rotation[2, 2] == 1.0:
        return _plan(part, rotation[:2, :2])
    return mesh_solid(fine_mesh(part), rotation)


def exposures_of(part: Part, seconds: Sequence[float], greys: Sequence[float] = ()) -> Exposures:
    """Return the prisms of a single-layer part with separate exposures, or with grey levels in one exposure."""
    outlines = [[np.asarray(ring) for ring in prism.rings(PLAN_MM)] for prism in part.prisms]
    points = np.vstack([ring for rings in outlines for ring in rings])
    corner, height = points.min(axis=0), max(prism.to_mm - prism.from_mm for prism in part.prisms)
    x, y = np.ptp(points, axis=0).tolist()
    origin = (-float(corner[0]), -float(corner[1]))
    return Exposures(
        size_mm=(x, y, height),
        origin_mm=origin,
        volume_mm3=part.volume_mm3,
        heights_mm=(0.0, height),
        names=tuple(prism.name for prism in part.prisms),
        rings=tuple([ring - corner for ring in rings] for rings in outlines),
        seconds=tuple(seconds),
        greys=tuple(greys),
    )


def mesh_solid(mesh: Mesh, rotation: FloatArray, name: str = "mesh") -> Slices:
    """Return the solid of a mesh rotated by a matrix (3, 3).

    Raises
    ------
    DataError
        If the mesh is empty, open or inside out, or has no volume.
    """
    _check_closed(mesh, name)
    vertices = mesh.vertices @ rotation.T
    corner = vertices.min(axis=0)
    vertices -= corner
    rotated = Mesh(vertices, mesh.triangles, mesh.tolerance_mm)
    united = _united(rotated, name) if Shells.of(rotated).may_overlap else rotated
    x, y, z = vertices.max(axis=0).tolist()
    origin = (-float(corner[0]), -float(corner[1]))
    overlap_mm3 = max(mesh.volume_mm3 - united.volume_mm3, 0.0)
    levels = _levels(vertices, mesh.triangles)
    return Slices((x, y, z), origin, united.volume_mm3, levels, Cutter(united), overlap_mm3)


def _united(mesh: Mesh, name: str) -> Mesh:
    """Return a mesh with its overlapping shells united; the mesh itself if none overlap."""
    from manifold3d import Error, Manifold, Mesh64, OpType

    solid = Manifold(Mesh64(np.ascontiguousarray(mesh.vertices), mesh.triangles.astype(np.uint64)))
    if solid.status() != Error.NoError:
        limit = f"its surface is not closed (manifold3d: {solid.status().name})"
        raise DataError(name, limit=limit, remedy="repair the mesh")
    united = Manifold.batch_boolean(solid.decompose(), OpType.Add)
    if united.volume() >= solid.volume() * (1.0 - MIN_OVERLAP):
        return mesh
    surface = united.to_mesh64()
    return Mesh(np.array(surface.vert_properties[:, :3]), np.array(surface.tri_verts, dtype=np.int64), 0.0)


def _levels(vertices: FloatArray, triangles: NDArray[np.int64]) -> tuple[float, ...]:
    """Return the heights of the horizontal triangles."""
    z = vertices[triangles, 2]
    level = z[np.ptp(z, axis=1) < LEVEL_MM, 0]
    return tuple(np.unique((level / LEVEL_MM).round() * LEVEL_MM).tolist())


def _check_closed(mesh: Mesh, name: str) -> None:
    if not len(mesh.triangles):
        raise DataError(name, limit="contains no triangles")
    if count := mesh.open_edges():
        limit = f"is not watertight: {count} edges do not belong to exactly two triangles with consistent orientation"
        raise DataError(name, limit=limit, remedy="repair the mesh")
    if not mesh.volume_mm3 > 0.0:
        limit = "encloses no volume" if mesh.volume_mm3 == 0.0 else f"is inside out: {mesh.volume_mm3:.4g} mm³"
        raise DataError(name, limit=limit, remedy="repair the mesh")


def _plan(part: Part, rotation: FloatArray) -> Plan:
    """Return the plan of a part rotated about the normal of the build plate by a 2 × 2 rotation matrix."""
    tools = [cut.tool for cut in part.cuts]
    heights = sorted({height for prism in (*part.prisms, *tools) for height in (prism.from_mm, prism.to_mm)})
    bottom, top = min(prism.from_mm for prism in part.prisms), max(prism.to_mm for prism in part.prisms)
    heights = [height for height in heights if bottom <= height <= top]
    known: dict[tuple[tuple[int, ...], tuple[int, ...]], int] = {}
    sections: list[list[FloatArray]] = []
    numbers = []
    for low, high in pairwise(heights):
        indices = (_indices_between(part.prisms, low, high), _indices_between(tools, low, high))
        if indices not in known:
            known[indices] = len(sections)
            rings = _rings([part.prisms[i] for i in indices[0]], [tools[i] for i in indices[1]])
            sections.append([ring @ rotation.T for ring in rings])
        numbers.append(known[indices])
    points = np.vstack([ring for rings in sections for ring in rings])
    corner = points.min(axis=0)
    x, y = np.ptp(points, axis=0).tolist()
    return Plan(
        size_mm=(x, y, top - bottom),
        origin_mm=(-float(corner[0]), -float(corner[1])),
        volume_mm3=part.volume_mm3,
        heights_mm=tuple(height - bottom for height in heights),
        numbers=tuple(numbers),
        rings=tuple([ring - corner for ring in rings] for rings in sections),
    )


def _indices_between(prisms: Sequence[Prism], low: float, high: float) -> tuple[int, ...]:
    """Return the indices of the prisms that contain the height range from ``low`` to ``high``."""
    middle = 0.5 * (low + high)
    return tuple(i for i, prism in enumerate(prisms) if prism.from_mm < middle < prism.to_mm)


def _rings(prisms: Sequence[Prism], tools: Sequence[Prism]) -> list[FloatArray]:
    """Return the rings of prisms minus tools; empty without a prism."""
    if not prisms:
        return []
    import shapely

    area = shapely.union_all([filled(prism.rings(PLAN_MM)) for prism in prisms])
    if tools:
        area = shapely.difference(area, shapely.union_all([filled(tool.rings(PLAN_MM)) for tool in tools]))
    if area.is_empty:
        raise DesignError("layers", limit="cuts remove the whole part at some heights")
    return rings_of(area)

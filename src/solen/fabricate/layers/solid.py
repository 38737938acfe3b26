"""Solids to be sliced: exact outlines by height, or a closed mesh, with the lowest corner at the origin.

A part that is printed flat needs no mesh: its plan only changes at its horizontal faces, so all layers between two of
these are identical. Any other part is a mesh, sliced by `solen.fabricate.layers.cut`; overlapping shells are first
united by manifold3d.
"""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DataError, DesignError
from solen.fabricate.layers.cut import Cutter, Shells
from solen.fabricate.lens_parts import FacedPart
from solen.fabricate.mesh import Mesh, mesh_of
from solen.fabricate.part import Part, Prism
from solen.fabricate.raster import rings_of
from solen.geometry import section
from solen.geometry.body import filled

Rings = Sequence[FloatArray]

PLAN_MM = 1e-4
"""Tolerance for approximating the outlines of a plan: about a thousandth of the finest pixel."""
MESH_MM = 2e-4
"""Tolerance for approximating the surface by a mesh."""
OVERLAP = 1e-6
"""Fraction of the mesh volume above which shells overlap rather than touch."""
LEVEL_MM = 1e-5
"""A face is horizontal if the heights of its corners differ by less than this."""


@dataclass(frozen=True, eq=False)
class Solid(ABC):
    """A solid in its printed position: above the plate, which is at Z = 0, with its minimum X and Y at 0.

    Attributes
    ----------
    size_mm
        Extent along X, Y and Z.
    origin_mm
        X and Y of the part's own origin.
    volume_mm3
        Volume of the solid.
    heights_mm
        Heights of the horizontal faces, ascending.
    """

    size_mm: tuple[float, float, float]
    origin_mm: tuple[float, float]
    volume_mm3: float
    heights_mm: tuple[float, ...]

    @property
    def exposures_s(self) -> tuple[float, ...]:
        """Exposures of images that are shown in sequence at one height; empty for a stack of layers."""
        return ()

    @abstractmethod
    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """Rings at a height, holes clockwise, and a number shared by identical sections, or None if unknown."""


@dataclass(frozen=True, eq=False)
class Plan(Solid):
    """Outlines that apply from one height to the next: ``rings[numbers[i]]`` from ``heights_mm[i]`` upwards."""

    numbers: tuple[int, ...]
    rings: tuple[Rings, ...]

    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """See `Solid.section`."""
        at = bisect_right(self.heights_mm, z_mm) - 1
        if not 0 <= at < len(self.numbers):
            return None, []
        number = self.numbers[at]
        return number, self.rings[number]


@dataclass(frozen=True, eq=False)
class Sections(Solid):
    """A part lying flat whose smooth lens varies with height: sections of the exact face, made on demand."""

    part: FacedPart
    turn: FloatArray

    @classmethod
    def of(cls, part: FacedPart, turn: FloatArray) -> "Sections":
        """Return the solid of a part rotated about the plate normal by a matrix (2, 2)."""
        hollow, (blank,) = part.hollow, part.prisms
        half, nearest = hollow.lens.half_width_mm, hollow.lens.nearest_mm
        behind = [ring[ring[:, 1] >= nearest] for ring in blank.rings(PLAN_MM)]
        points = np.vstack([*behind, [(-half, nearest), (half, nearest)]]) @ turn.T
        corner, (x, y) = points.min(axis=0), np.ptp(points, axis=0).tolist()
        cuts = [cut.takes for cut in part.cuts]
        levels = {0.0, blank.to_mm} | {height for cut in cuts for height in (cut.from_mm, cut.to_mm)}
        origin = (-float(corner[0]), -float(corner[1]))
        return cls((x, y, blank.to_mm), origin, part.volume_mm3, tuple(sorted(levels)), part, turn)

    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """See `Solid.section`."""
        hollow = self.part.hollow
        if not 0.0 <= z_mm < self.size_mm[2]:
            return None, []
        outlines = section(hollow.body, hollow.lens.half_height_mm - z_mm).check().outlines
        here = Prism("section", outlines, 0.0, self.size_mm[2])
        tools = [cut.tool for cut in self.part.cuts if cut.tool.from_mm < z_mm < cut.tool.to_mm]
        return None, [ring @ self.turn.T + self.origin_mm for ring in _rings([here], tools)]


@dataclass(frozen=True, eq=False)
class Exposures(Solid):
    """Parts of one layer exposed in sequence, each for its own time, without a lift in between.

    If ``greys`` (0 to 1 for each part) is specified, all parts are exposed together for the first of these times, each
    with its grey level.
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
        """Return the section with all parts together; see `Solid.section`."""
        inside = 0.0 <= z_mm < self.size_mm[2]
        return None, [ring for rings in self.rings for ring in rings] if inside else []


@dataclass(frozen=True, eq=False)
class Slices(Solid):
    """A closed mesh that is sliced on demand; ``overlap_mm3`` is the overlap of its shells before union."""

    cutter: Cutter
    overlap_mm3: float = 0.0

    def section(self, z_mm: float) -> tuple[int | None, Rings]:
        """See `Solid.section`."""
        return None, self.cutter.rings(z_mm)


def solid_of(part: Part, rotation: FloatArray, tolerance_mm: float = MESH_MM) -> Solid:
    """Solid of a part rotated by a matrix (3, 3): a `Plan` if its Z axis stays vertical, otherwise `Slices`.

    Raises
    ------
    DesignError, SpecError
        If the mesh cannot be made.
    """
    if rotation[2, 2] == 1.0 and isinstance(part, FacedPart):
        return Sections.of(part, rotation[:2, :2])
    if rotation[2, 2] == 1.0:
        return _plan(part, rotation[:2, :2])
    return mesh_solid(mesh_of(part, tolerance_mm), rotation)


def exposures_of(part: Part, seconds: Sequence[float], greys: Sequence[float] = ()) -> Exposures:
    """Prisms of a single-layer part, with individual exposures, or exposed together with individual grey levels."""
    rings = [[np.asarray(ring) for ring in prism.rings(PLAN_MM)] for prism in part.prisms]
    points = np.vstack([ring for one in rings for ring in one])
    corner, height = points.min(axis=0), max(prism.to_mm - prism.from_mm for prism in part.prisms)
    x, y = np.ptp(points, axis=0).tolist()
    origin = (-float(corner[0]), -float(corner[1]))
    placed = tuple([ring - corner for ring in one] for one in rings)
    names = tuple(prism.name for prism in part.prisms)
    return Exposures(
        (x, y, height), origin, part.volume_mm3, (0.0, height), names, placed, tuple(seconds), tuple(greys)
    )


def mesh_solid(mesh: Mesh, rotation: FloatArray, name: str = "mesh") -> Slices:
    """Return the solid of a mesh rotated by a matrix (3, 3).

    Raises
    ------
    DataError
        If the mesh is empty, open or inside out, or has no volume.
    """
    _check_closed(mesh, name)
    turned = mesh.vertices @ rotation.T
    corner = turned.min(axis=0)
    turned -= corner
    placed = Mesh(turned, mesh.triangles, mesh.tolerance_mm)
    united = _united(placed, name) if Shells.of(placed).may_overlap else placed
    x, y, z = turned.max(axis=0).tolist()
    origin = (-float(corner[0]), -float(corner[1]))
    twice_mm3 = max(mesh.volume_mm3 - united.volume_mm3, 0.0)
    levels = _levels(turned, mesh.triangles)
    return Slices((x, y, z), origin, united.volume_mm3, levels, Cutter(united), twice_mm3)


def _united(mesh: Mesh, name: str) -> Mesh:
    """Unite the overlapping shells of a mesh; return the mesh unchanged if none overlap."""
    from manifold3d import Error, Manifold, Mesh64, OpType

    solid = Manifold(Mesh64(np.ascontiguousarray(mesh.vertices), mesh.triangles.astype(np.uint64)))
    if solid.status() != Error.NoError:
        raise DataError(name, value=solid.status().name, limit="its surface is not closed", remedy="repair the mesh")
    united = Manifold.batch_boolean(solid.decompose(), OpType.Add)
    if united.volume() >= solid.volume() * (1.0 - OVERLAP):
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
        raise DataError(name, value="no triangle", limit="is empty")
    if count := mesh.open_edges():
        limit = "must be watertight: each edge must belong to exactly two triangles with consistent orientation"
        raise DataError(name, value=f"{count} open edges", limit=limit, remedy="repair the mesh")
    if not mesh.volume_mm3 > 0.0:
        limit = "encloses no volume" if mesh.volume_mm3 == 0.0 else "is inside out"
        raise DataError(name, value=f"{mesh.volume_mm3:.4g} mm³", limit=limit, remedy="repair the mesh")


def _plan(part: Part, turn: FloatArray) -> Plan:
    """Return the plan of a part rotated about the plate normal by a matrix (2, 2)."""
    tools = [cut.tool for cut in part.cuts]
    heights = sorted({height for prism in (*part.prisms, *tools) for height in (prism.from_mm, prism.to_mm)})
    bottom, top = min(prism.from_mm for prism in part.prisms), max(prism.to_mm for prism in part.prisms)
    heights = [height for height in heights if bottom <= height <= top]
    known: dict[tuple[tuple[int, ...], tuple[int, ...]], int] = {}
    sections: list[list[FloatArray]] = []
    numbers = []
    for low, high in pairwise(heights):
        there = (_across(part.prisms, low, high), _across(tools, low, high))
        if there not in known:
            known[there] = len(sections)
            rings = _rings([part.prisms[i] for i in there[0]], [tools[i] for i in there[1]])
            sections.append([ring @ turn.T for ring in rings])
        numbers.append(known[there])
    points = np.vstack([ring for rings in sections for ring in rings])
    corner = points.min(axis=0)
    placed = tuple([ring - corner for ring in rings] for rings in sections)
    x, y = np.ptp(points, axis=0).tolist()
    levels = tuple(height - bottom for height in heights)
    origin = (-float(corner[0]), -float(corner[1]))
    return Plan((x, y, top - bottom), origin, part.volume_mm3, levels, tuple(numbers), placed)


def _across(prisms: Sequence[Prism], low: float, high: float) -> tuple[int, ...]:
    """Return the numbers of the prisms that extend from one height to the next."""
    middle = 0.5 * (low + high)
    return tuple(i for i, prism in enumerate(prisms) if prism.from_mm < middle < prism.to_mm)


def _rings(prisms: Sequence[Prism], tools: Sequence[Prism]) -> list[FloatArray]:
    """Return the rings of prisms minus tools; without a prism there is air."""
    if not prisms:
        return []
    import shapely

    area = shapely.union_all([filled(prism.rings(PLAN_MM)) for prism in prisms])
    if tools:
        area = shapely.difference(area, shapely.union_all([filled(tool.rings(PLAN_MM)) for tool in tools]))
    if area.is_empty:
        raise DesignError("layers", value="nothing is left of the part", limit="between two of its heights")
    return rings_of(area)

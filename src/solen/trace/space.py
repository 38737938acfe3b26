"""Integration in space: over the angles, the width and the height of emitters in extruded scenes.

Upright walls conserve the component of a ray along y, so a ray is a ray of the plane with one more number, and the
heights at which it may start are an interval carried along (`solen.trace.kernel.prism`): that integral is exact. The
integral over the place across the chip is taken along a path, edge by edge (`solen.trace.kernel.paths`): through a lens
light changes its receiver with its place on the chip, all but independently of its angle. What remains is a function of
two angles that has kinks and hardly a jump: it is integrated over cells, each a product of two Lobatto–Kronrod rules,
the cell of the largest error halved along its worse angle. A point has no places; its path runs over the angle in
projection.

With dΩ = dφ d(sin ψ) for the angle φ in projection and ψ out of the plane, all directions count alike but for the
pattern. The difference of the two rules is many times the error; by how much is learned from what halving cells
changes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.scene import Scene
from solen.scene.sources import Ambient, Emitter
from solen.scene.sources.pattern import CosinePower, Isotropic, PatternTable
from solen.trace.cells import COARSE, FINE, POINT, Bounds, Cell, Over, accounted, divided
from solen.trace.cone import COARSE_TOLERANCE, DOUBLE, Integral, weighted_sum
from solen.trace.kernel import paths
from solen.trace.kernel.cells import Light, new_nodes, over_cells
from solen.trace.kernel.family import FamilyInSpace
from solen.trace.kernel.nearest import Walls, walls_of
from solen.trace.kernel.prism import MORE_COLUMNS
from solen.trace.kernel.step import Rules
from solen.trace.tables import Tables
from solen.trace.tail import Tail

FIRST_CELLS, FIRST_LINES = 4, 6
"""Cells along the angle in projection to begin with; of a point, stretches of the angle out of the plane."""
FIRST_FACE = (0.5, 1)
"""Least weight and most hits of what is followed exactly where following all of it does not do: light that is trapped
comes through strips too narrow to be seen."""
CHIP_TOLERANCE = 1e-4
PATH_SHARE, ROUGHEST_PATH, SOFT = 30.0, 0.03, 0.1
"""Along a chip's width: second difference of the powers that Simpson's rule is trusted with, times six, and share of
the width at which an edge is left, both per tolerance and at most; and share of the width up to which nothing is looked
for between two equal rays."""
DENSITY_SHARE, LEAST_DENSITY = 0.05, 1e-6
"""Along the angle of a point: second difference that Simpson's rule is trusted with, times six, per tolerance and at
least, as a path has room for some thousand rays alone. What that leaves is a thousandth of what is stated."""
NARROW_SHARE, SOFT_RAD = 0.1, 0.001
"""Width at which an edge is left, per tolerance, and up to which nothing is looked for, of the angle of a point in
radians."""


def why_not_in_space(scene: Scene) -> str:
    """Why an extruded scene cannot be integrated; empty where it can."""
    if any(interface.behaviour == "lens" for interface in scene.interfaces):
        return "an ideal lens in space"
    others = [type(source).__name__ for source in scene.sources if source.emission() is None]
    others += [type(source).__name__ for source in scene.sources if isinstance(source, Ambient)]
    return f"a source {others[0]}" if others else ""


@dataclass(frozen=True, eq=False)
class LightInSpace:
    """An emitter in a compiled extruded scene."""

    walls: Walls
    ends: FloatArray
    columns: int
    source: Emitter
    families: tuple[FamilyInSpace, ...]
    """one for each colour"""
    weights: tuple[float, ...]
    mirrored: bool
    """whether light that goes up and light that goes down do the same"""
    jumps: bool
    """whether it is too sharp a function of the angle out of the plane: at the height of a receiver"""

    @classmethod
    def of(cls, scene: Scene, source: Emitter, tables: Tables, rules: Rules) -> "LightInSpace":
        """Light of one emitter of a scene; `DesignError` where its cone has no width."""
        if not source.cone_deg > 0.0:
            raise DesignError("cone_deg", value=source.cone_deg, limit="must be above 0 to integrate over it")
        extrusion = scene.extrusion
        if extrusion is None:
            raise AssertionError("a scene of the plane is integrated in the plane")
        ends = np.array(sorted({p for i in scene.interfaces for p in (i.curve.start, i.curve.end)})).reshape(-1, 2).T
        far_mm = 100.0 * float(np.ptp(ends, axis=1).max(initial=1.0)) if ends.size else 1.0
        axis, half_width = math.radians(source.axis_deg), 0.5 * source.width_mm
        power, theta, relative = _pattern(source)
        across = (-math.cos(axis), -math.sin(axis)) if source.width_mm > 0.0 else (0.0, 0.0)
        bottom, top = source.y_mm - 0.5 * source.height_mm, source.y_mm + 0.5 * source.height_mm
        family = FamilyInSpace(
            *source.point, *across, axis, 0.0, 0.0, 0.0, bottom, top,
            source.s_share, 1.0 - source.s_share, 0, rules, far_mm, 0.5 * extrusion.thickness_mm,
            extrusion.index_above, extrusion.index_below, -half_width, half_width, power, theta, relative,
        )  # fmt: skip
        whole = math.fsum(weight for _, weight in source.spectrum)
        colours = [(scene.wavelengths_nm.index(nm), weight / whole) for nm, weight in source.spectrum] or [(0, 1.0)]
        heights = {i.height_mm for i in scene.interfaces if i.height_mm is not None}
        even = source.y_mm == 0.0 and extrusion.index_above == extrusion.index_below
        return cls(
            walls_of(tables),
            np.ascontiguousarray(ends),
            len(scene.receivers) + MORE_COLUMNS,
            source,
            tuple(family._replace(colour=colour) for colour, _ in colours),
            tuple(weight for _, weight in colours),
            even and all(low == -high for low, high in heights),
            bool(heights),
        )

    @property
    def whole(self) -> float:
        """Integral of the relative intensity over all directions, in sr."""
        return self.source.pattern.space_integral_sr(self.source.half_rad)

    def integral(self, tolerance: float, rules: Rules, most_legs: int) -> Integral:
        """Integrate over all colours; each ends after so many straight stretches."""
        if self.jumps and rules.max_hits > 1:
            return Integral(np.zeros(self.columns + 2 - MORE_COLUMNS), 0.0, 1.0, np.zeros(4, np.int64))
        families = [family._replace(rules=rules) for family in self.families]
        found = [self._colour(family, tolerance, most_legs) for family in families]
        return found[0] if len(found) == 1 else weighted_sum(found, list(self.weights))

    def levels(self, _: float) -> Sequence[tuple[float, int]]:
        """Least weight and most hits of what is followed exactly where following all of it does not do."""
        return (FIRST_FACE,)

    def tail(self, rules: Rules) -> Tail:
        """What is left beyond the rules."""
        families = [family._replace(rules=rules) for family in self.families]
        return Tail(self.walls, self.source, True, self.columns, families.__getitem__)

    def _colour(self, family: FamilyInSpace, tolerance: float, most_legs: int) -> Integral:
        room = paths.path_room(self.columns)
        return _integrated(self.over(family, tolerance, room), self.first_cells, tolerance, most_legs, room)

    @property
    def first_cells(self) -> list[Bounds]:
        """What the domain is divided into to begin with."""
        sides = [(0.0, 0.5 * math.pi)] if self.mirrored else [(-0.5 * math.pi, 0.0), (0.0, 0.5 * math.pi)]
        if self.source.width_mm > 0.0:
            strips = pairwise(np.linspace(-1.0, 1.0, FIRST_CELLS + 1).tolist())
            return [(*strip, *side) for strip in strips for side in sides]
        lines = [part for low, high in sides for part in pairwise(np.linspace(low, high, FIRST_LINES + 1).tolist())]
        return [(0.0, 1.0, *line) for line in lines]

    def over(self, family: FamilyInSpace, tolerance: float, room: paths.PathRoom, closeness: float = 1.0) -> Over:
        """Integral over cells in one colour; the smaller ``closeness``, the closer are the paths followed."""
        half, width = self.source.half_rad, self.source.width_mm
        scale = (2.0 if self.mirrored else 1.0) / self.whole
        if width > 0.0:
            rough = closeness * min(PATH_SHARE * tolerance, ROUGHEST_PATH)
            steps = (rough, rough * width, SOFT * width)
            across = along = COARSE if tolerance >= COARSE_TOLERANCE else FINE
        else:
            close = closeness * tolerance
            steps = (max(DENSITY_SHARE * close, LEAST_DENSITY) * self.whole, NARROW_SHARE * close, SOFT_RAD)
            across, along = POINT, FINE
        cosine, sine = math.cos(half), math.sin(min(half, 0.5 * math.pi))
        light = Light(family, self.ends, cosine, sine, width == 0.0, scale / (width or 1.0), *steps)
        nodes = new_nodes(self.columns, len(along.nodes))

        def over(bounds: Sequence[Bounds]) -> list[Cell]:
            sums, errors = np.empty((len(bounds), 3, self.columns)), np.empty((len(bounds), 3))
            over_cells(DOUBLE, self.walls, light, room, nodes, across, along, np.array(bounds), sums, errors)
            return [
                Cell(of, value[0], value[1:], (q, t), inner, len(across.nodes) * len(along.nodes))
                for of, value, (q, t, inner) in zip(bounds, sums, errors.tolist(), strict=True)
            ]

        return over


def _integrated(
    over: Over,
    first: Sequence[Bounds],
    tolerance: float,
    most_legs: int,
    room: paths.PathRoom,
) -> Integral:
    """Sum over cells, halved until the error is within the tolerance."""
    room.counts[:] = 0
    cells, u = divided(over, first, tolerance, most_legs, room.counts)
    rays, legs, undefined = (int(count) for count in room.counts[:3])
    counts = np.array([rays, legs, undefined, sum(cell.paths for cell in cells or ())])
    if cells is None:
        return Integral(np.zeros(room.value.shape[1] + 2 - MORE_COLUMNS), 0.0, 1.0, counts)
    whole = accounted(cells.value)
    value = cells.value / max(whole, 1.0)  # more than all light is an error of the quadrature
    error = max(u - max(1.0 - whole, 0.0), 0.0)  # what is lacking is in u already
    share, missed, leaked = value[: 2 - MORE_COLUMNS], float(value[-3]), float(value[-2])
    return Integral(share, error, max(1.0 - whole, 0.0), counts, missed, leaked)


def _pattern(source: Emitter) -> tuple[float, FloatArray, FloatArray]:
    """Exponent of the cosine, or a table of angles in radians and relative intensities."""
    nothing = np.empty(0)
    match source.pattern:
        case Isotropic():
            return 0.0, nothing, nothing
        case CosinePower(exponent=exponent):
            return exponent, nothing, nothing
        case PatternTable(angle_deg=angle_deg, relative=relative):
            return 0.0, np.radians(angle_deg), np.array(relative)

"""Integration in space: over the angles, the width and the height of emitters in extruded scenes.

Vertical walls conserve the y-component of a ray's direction, so a ray in space is a ray in the plane with one more
parameter. The heights at which it may start form an interval that is followed as a unit (`solen.trace.kernel.prism`);
the integral over height is therefore exact. The integral over the position across the chip follows a path, edge by edge
(`solen.trace.kernel.paths`): behind a lens, the receiver that light reaches depends on its position on the chip and
hardly on its angle. The remaining function of two angles has kinks but hardly any jumps. It is integrated over cells,
each with a product of two Lobatto–Kronrod rules, and the cell with the largest error is halved along the angle with the
larger error. A point emitter has no positions; its path covers the projected angle.

With dΩ = dφ d(sin ψ), where φ is the projected angle and ψ the out-of-plane angle, all directions have equal weight
except for the emission pattern.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.scene import Scene
from solen.scene.sources import Emitter
from solen.scene.sources.pattern import CosinePower, Isotropic, PatternTable
from solen.trace.cells import COARSE, FINE, POINT, Bounds, Cell, Integrator, accounted, divided
from solen.trace.cone import COARSE_TOLERANCE, DOUBLE, Integral, weighted_sum
from solen.trace.kernel import paths
from solen.trace.kernel.cells import Light, integrate_cells, new_nodes
from solen.trace.kernel.family import FamilyInSpace
from solen.trace.kernel.nearest import Walls, walls_of
from solen.trace.kernel.prism import EXTRA_COLUMNS
from solen.trace.kernel.step import Rules
from solen.trace.tables import Tables
from solen.trace.tail import Tail

FIRST_CELLS, FIRST_INTERVALS = 4, 6
"""Initial number of cells along the projected angle; for a point, initial number of intervals of the out-of-plane
angle.
"""
FIRST_INTERFACE = (0.5, 1)
"""Minimum weight and maximum number of interfaces if not all light can be followed exactly: trapped light arrives
through strips that are too narrow to be resolved.
"""
CHIP_TOLERANCE = 1e-4
PATH_FACTOR, MAX_PATH_ERROR, MIN_SEARCH = 30.0, 0.03, 0.1
"""Path resolution across the width of a chip. The first number gives, per unit of tolerance, both the accepted second
difference of the powers (six times the error of Simpson's rule) and the fraction of the width below which an edge is no
longer refined; the second number limits both. The third is the fraction of the width below which the interval between
two rays with equal trees is not searched for hidden edges.
"""
DENSITY_FACTOR, MIN_DENSITY = 0.05, 1e-6
"""Path resolution along the angle of a point: accepted second difference of the powers (six times the error of
Simpson's rule) per unit of tolerance, and its minimum, because a path can store only a few thousand rays. The
resulting error is a thousandth of the reported one.
"""
NARROW_FACTOR, MIN_SEARCH_RAD = 0.1, 0.001
"""Path resolution along the angle of a point: width below which an edge is no longer refined, per unit of tolerance,
and width in radians below which an interval is not searched for hidden edges.
"""


@dataclass(frozen=True, eq=False)
class LightInSpace:
    """An emitter in a compiled extruded scene."""

    walls: Walls
    ends: FloatArray
    columns: int
    source: Emitter
    families: tuple[FamilyInSpace, ...]
    """rays at each wavelength"""
    weights: tuple[float, ...]
    mirrored: bool
    """whether the scene is symmetric about the mid-plane of the slab"""
    jumps: bool
    """whether the power jumps as a function of the out-of-plane angle, because a receiver is lower than the body"""

    @classmethod
    def of(cls, scene: Scene, source: Emitter, tables: Tables, rules: Rules) -> "LightInSpace":
        """Prepare one emitter of a scene; raise `DesignError` if its cone has no width."""
        if not source.cone_deg > 0.0:
            raise DesignError("cone_deg", value=source.cone_deg, limit="must be above 0 for integration")
        extrusion = scene.extrusion
        if extrusion is None:
            raise AssertionError("a planar scene is integrated in the plane")
        ends = np.array(sorted({p for i in scene.interfaces for p in (i.curve.start, i.curve.end)})).reshape(-1, 2).T
        far_mm = 100.0 * float(np.ptp(ends, axis=1).max(initial=1.0)) if ends.size else 1.0
        axis, half_width = math.radians(source.axis_deg), 0.5 * source.width_mm
        exponent, theta, relative = _pattern(source)
        along = (-math.cos(axis), -math.sin(axis)) if source.width_mm > 0.0 else (0.0, 0.0)
        bottom, top = source.y_mm - 0.5 * source.height_mm, source.y_mm + 0.5 * source.height_mm
        family = FamilyInSpace(
            *source.point, *along, axis, 0.0, 0.0, 0.0, bottom, top,
            source.s_share, 1.0 - source.s_share, 0, rules, far_mm, 0.5 * extrusion.thickness_mm,
            extrusion.index_above, extrusion.index_below, -half_width, half_width, exponent, theta, relative,
        )  # fmt: skip
        total = math.fsum(weight for _, weight in source.spectrum)
        colours = [(scene.wavelengths_nm.index(nm), weight / total) for nm, weight in source.spectrum] or [(0, 1.0)]
        heights = {i.height_mm for i in scene.interfaces if i.height_mm is not None}
        symmetric = source.y_mm == 0.0 and extrusion.index_above == extrusion.index_below
        return cls(
            walls_of(tables),
            np.ascontiguousarray(ends),
            len(scene.receivers) + EXTRA_COLUMNS,
            source,
            tuple(family._replace(colour=colour) for colour, _ in colours),
            tuple(weight for _, weight in colours),
            symmetric and all(low == -high for low, high in heights),
            bool(heights),
        )

    @property
    def whole(self) -> float:
        """Integral of the relative intensity over all directions, in sr."""
        return self.source.pattern.space_integral_sr(self.source.half_rad)

    def integral(self, tolerance: float, rules: Rules, max_segments: int) -> Integral:
        """Integrate over all wavelengths, with at most ``max_segments`` ray segments for each."""
        if self.jumps and rules.max_hits > 1:
            return Integral(np.zeros(self.columns + 2 - EXTRA_COLUMNS), 0.0, 1.0, np.zeros(4, np.int64))
        families = [family._replace(rules=rules) for family in self.families]
        integrals = [self._colour(family, tolerance, max_segments) for family in families]
        return integrals[0] if len(integrals) == 1 else weighted_sum(integrals, list(self.weights))

    def levels(self, _: float) -> Sequence[tuple[float, int]]:
        """Return minimum weights and maximum numbers of interfaces, for light that cannot all be followed exactly."""
        return (FIRST_INTERFACE,)

    def tail(self, rules: Rules) -> Tail:
        """Return the light beyond the limits of the integration, which is sampled."""
        families = [family._replace(rules=rules) for family in self.families]
        return Tail(self.walls, self.source, True, self.columns, families.__getitem__)

    def _colour(self, family: FamilyInSpace, tolerance: float, max_segments: int) -> Integral:
        buffers = paths.path_buffers(self.columns)
        integrate = self.integrator(family, tolerance, buffers)
        return _integrated(integrate, self.first_cells, tolerance, max_segments, buffers)

    @property
    def first_cells(self) -> list[Bounds]:
        """Initial cells of the domain."""
        sides = [(0.0, 0.5 * math.pi)] if self.mirrored else [(-0.5 * math.pi, 0.0), (0.0, 0.5 * math.pi)]
        if self.source.width_mm > 0.0:
            strips = pairwise(np.linspace(-1.0, 1.0, FIRST_CELLS + 1).tolist())
            return [(*strip, *side) for strip in strips for side in sides]
        intervals = [
            part for low, high in sides for part in pairwise(np.linspace(low, high, FIRST_INTERVALS + 1).tolist())
        ]
        return [(0.0, 1.0, *interval) for interval in intervals]

    def integrator(
        self, family: FamilyInSpace, tolerance: float, buffers: paths.PathBuffers, path_factor: float = 1.0
    ) -> Integrator:
        """Return the integrator over cells at one wavelength; a smaller ``path_factor`` resolves paths more finely."""
        half, width = self.source.half_rad, self.source.width_mm
        scale = (2.0 if self.mirrored else 1.0) / self.whole
        if width > 0.0:
            path_error = path_factor * min(PATH_FACTOR * tolerance, MAX_PATH_ERROR)
            steps = (path_error, path_error * width, MIN_SEARCH * width)
            across = along = COARSE if tolerance >= COARSE_TOLERANCE else FINE
        else:
            path_tolerance = path_factor * tolerance
            steps = (
                max(DENSITY_FACTOR * path_tolerance, MIN_DENSITY) * self.whole,
                NARROW_FACTOR * path_tolerance,
                MIN_SEARCH_RAD,
            )
            across, along = POINT, FINE
        cosine, sine = math.cos(half), math.sin(min(half, 0.5 * math.pi))
        light = Light(family, self.ends, cosine, sine, width == 0.0, scale / (width or 1.0), *steps)
        nodes = new_nodes(self.columns, len(along.nodes))

        def integrate(bounds: Sequence[Bounds]) -> list[Cell]:
            sums, errors = np.empty((len(bounds), 3, self.columns)), np.empty((len(bounds), 3))
            integrate_cells(DOUBLE, self.walls, light, buffers, nodes, across, along, np.array(bounds), sums, errors)
            return [
                Cell(cell, value[0], value[1:], (q, t), path, len(across.nodes) * len(along.nodes))
                for cell, value, (q, t, path) in zip(bounds, sums, errors.tolist(), strict=True)
            ]

        return integrate


def _integrated(
    integrate: Integrator,
    initial: Sequence[Bounds],
    tolerance: float,
    max_segments: int,
    buffers: paths.PathBuffers,
) -> Integral:
    """Integrate over cells, which are halved until the error is within the tolerance."""
    buffers.counts[:] = 0
    cells, u = divided(integrate, initial, tolerance, max_segments, buffers.counts)
    rays, segments, undefined = (int(count) for count in buffers.counts[:3])
    counts = np.array([rays, segments, undefined, sum(cell.paths for cell in cells or ())])
    if cells is None:
        return Integral(np.zeros(buffers.value.shape[1] + 2 - EXTRA_COLUMNS), 0.0, 1.0, counts)
    total = accounted(cells.value)
    value = cells.value / max(total, 1.0)  # a sum above 1 is a quadrature error
    error = max(u - max(1.0 - total, 0.0), 0.0)  # the missing power is already part of u
    powers, missed, leaked = value[: 2 - EXTRA_COLUMNS], float(value[-3]), float(value[-2])
    return Integral(powers, error, max(1.0 - total, 0.0), counts, missed, leaked)


def _pattern(source: Emitter) -> tuple[float, FloatArray, FloatArray]:
    """Return the exponent of the cosine, and a table (may be empty) of angles in radians and relative intensities."""
    no_table = np.empty(0)
    match source.pattern:
        case Isotropic():
            return 0.0, no_table, no_table
        case CosinePower(exponent=exponent):
            return exponent, no_table, no_table
        case PatternTable(angle_deg=angle_deg, relative=relative):
            return 0.0, np.radians(angle_deg), np.array(relative)

"""Integration in space: over the angles, the width and the height of emitters in extruded scenes.

Upright walls conserve the component of a ray along y, so a ray is a ray of the plane with one more number, and the
heights at which it may start are an interval carried along (`solen.trace.kernel.prism`): that integral is exact. The
integral over the place across the chip is taken along a path, edge by edge (`solen.trace.kernel.paths`): through a lens
light changes its receiver with its place on the chip, all but independently of its angle. What remains is a function of
two angles that has kinks but no jumps: it is integrated over cells, each a product of two Gauss–Kronrod rules, the cell
of the largest error halved along its worse angle. A point has no places; its path runs over the angle in projection.

With dΩ = dφ d(sin ψ) for the angle φ in projection and ψ out of the plane, all directions count alike but for the
pattern. The difference of the two rules is many times the error; by how much is learned from what halving cells
changes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.scene import Scene
from solen.scene.sources import Ambient, Emitter
from solen.scene.sources.pattern import CosinePower, Isotropic, PatternTable
from solen.trace.cone import COARSE, COARSE_TOLERANCE, DOUBLE, RULE, Integral, weighted_sum
from solen.trace.kernel import adapt, paths
from solen.trace.kernel.prism import STACK_IN_SPACE, WIDTH_IN_SPACE, FamilyInSpace
from solen.trace.kernel.step import Rules
from solen.trace.tables import Tables

FIRST_CELLS, FIRST_LINES = 4, 6
"""Cells along the angle in projection to begin with; of a point, stretches of the angle out of the plane."""
MOST_PATHS = 400_000
"""Paths after which the integration ends, with whatever it has reached."""
KEPT_RAYS, KEPT_LEGS, KEPT_STRETCHES = 4096, 400_000, 2048
LEARNED, PRIOR_RATIO = 4.0, 0.35
"""Weight and value of what is assumed of error over difference before any cell was halved."""
SPARE, FUTILE = 0.8, 0.1
"""Shares of the tolerance: where cells are halved no further; where what is lacking was not lost between cells."""
CAUTION = 3.5
"""Factor on the error learned from halving: it is a root mean square over few cells."""
CHANGE_SHARE, LEAST_SHARE = 0.5, 0.05
"""Least difference of a half: shares of what halving changed, and of the difference before; rules agree by chance."""
CHIP_TOLERANCE = 1e-4
FLATNESS = 1e-3
"""Second difference of the powers along a chip's width that Simpson's rule is trusted with, times six."""
NARROW, SOFT = 1e-3, 0.51
"""Shares of a chip's width at which an edge is left, and up to which a stretch of one tree stays whole."""
NARROW_RAD, SOFT_RAD = 1e-5, 0.01
"""The same for the angle of a point in radians, for a tolerance of 1e-4."""


def why_not_in_space(scene: Scene) -> str:
    """Why an extruded scene cannot be integrated; empty where it can."""
    if any(interface.behaviour == "lens" for interface in scene.interfaces):
        return "an ideal lens in space"
    others = [type(source).__name__ for source in scene.sources if source.emission() is None]
    others += [type(source).__name__ for source in scene.sources if isinstance(source, Ambient)]
    return f"a source {others[0]}" if others else ""


class Cell(NamedTuple):
    """A part of the domain with its integral.

    ``errors`` are differences of two rules along each coordinate, ``inner`` is the error of the paths.
    """

    bounds: tuple[float, ...]
    value: FloatArray
    errors: tuple[float, ...]
    inner: float
    paths: int
    ended: bool

    @property
    def error(self) -> float:
        """Differences of both rules."""
        return sum(self.errors)


@dataclass(frozen=True, eq=False)
class LightInSpace:
    """An emitter in a compiled extruded scene."""

    tables: Tables
    ends: FloatArray
    columns: int
    source: Emitter
    families: tuple[FamilyInSpace, ...]
    """one for each colour"""
    weights: tuple[float, ...]
    mirrored: bool
    """whether light that goes up and light that goes down do the same"""

    @classmethod
    def of(cls, scene: Scene, source: Emitter, tables: Tables, rules: Rules) -> "LightInSpace":
        """Light of one emitter of a scene; `DesignError` where its cone has no width."""
        if not source.cone_deg > 0.0:
            raise DesignError("cone_deg", value=source.cone_deg, limit="must be above 0 to integrate over it")
        extrusion = scene.extrusion
        if extrusion is None:
            raise AssertionError("a scene of the plane is integrated in the plane")
        ends = np.array([p for i in scene.interfaces for p in (i.curve.start, i.curve.end)]).reshape(-1, 2)
        far_mm = 100.0 * float(np.ptp(ends, axis=0).max(initial=1.0)) if len(ends) else 1.0
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
            tables,
            ends,
            len(scene.receivers) + 4,
            source,
            tuple(family._replace(colour=colour) for colour, _ in colours),
            tuple(weight for _, weight in colours),
            even and all(low == -high for low, high in heights),
        )

    @property
    def whole(self) -> float:
        """Integral of the relative intensity over all directions, in sr."""
        return self.source.pattern.space_integral_sr(self.source.half_rad)

    def integral(self, tolerance: float, _: int = 0) -> Integral:
        """Integrate over all colours."""
        found = [self._colour(family, tolerance) for family in self.families]
        return found[0] if len(found) == 1 else weighted_sum(found, list(self.weights))

    def _colour(self, family: FamilyInSpace, tolerance: float) -> Integral:
        half = self.source.half_rad
        domain = Domain(
            self.tables,
            self.ends,
            family,
            (math.cos(half), math.sin(min(half, 0.5 * math.pi))),
            COARSE if tolerance >= COARSE_TOLERANCE else RULE,
            (2.0 if self.mirrored else 1.0) / self.whole,
            _room(self.columns),
        )
        sides = [(0.0, 0.5 * math.pi)] if self.mirrored else [(-0.5 * math.pi, 0.0), (0.0, 0.5 * math.pi)]
        if self.source.width_mm > 0.0:
            strips = pairwise(np.linspace(-1.0, 1.0, FIRST_CELLS + 1).tolist())
            cells = [(*strip, *side) for strip in strips for side in sides]
            return _integrated(partial(domain.chip, width=self.source.width_mm), cells, tolerance, domain.room)
        halves = [part for low, high in sides for part in pairwise(np.linspace(low, high, FIRST_LINES + 1).tolist())]
        steps = (0.05 * tolerance * self.whole, NARROW_RAD * tolerance / CHIP_TOLERANCE, SOFT_RAD)
        return _integrated(partial(domain.point, steps=steps), halves, tolerance, domain.room)


class Domain(NamedTuple):
    """The angles that an emitter's light in one colour is integrated over."""

    tables: Tables
    ends: FloatArray
    family: FamilyInSpace
    cone: tuple[float, float]
    """cosine of half the cone, and the largest sine out of the plane"""
    rule: adapt.Rule
    scale: float
    room: paths.PathRoom

    def chip(self, bounds: tuple[float, ...], width: float) -> Cell:
        """Cell of the angle in projection (a share of the largest one) and t, over the width of a chip."""
        nodes, kronrod, gauss = self.rule.nodes, self.rule.kronrod, self.rule.gauss
        columns = self.room.value.shape[1]
        grid = np.empty((len(nodes), len(nodes), columns))
        off, ended = paths.over_places(
            DOUBLE, self.tables, self.family, self.room, self.ends, self.cone, nodes, np.array(bounds),
            (FLATNESS, NARROW * width, SOFT * width), np.empty(columns), grid,
        )  # fmt: skip
        scale = 0.25 * (bounds[1] - bounds[0]) * (bounds[3] - bounds[2]) * self.scale / width
        inner = np.einsum("ijd,j->id", grid, kronrod)
        value = scale * (kronrod @ inner)
        across = value - scale * (kronrod @ np.einsum("ijd,j->id", grid, gauss))
        errors = (_most(across), _most(value - scale * (gauss @ inner)))
        return Cell(bounds, value, errors, scale * off * 4.0 / len(nodes) ** 2, len(nodes) ** 2, ended)

    def point(self, bounds: tuple[float, ...], steps: tuple[float, float, float]) -> Cell:
        """Cell of t alone, over the angle in projection."""
        nodes, columns = self.rule.nodes, self.room.value.shape[1]
        grid = np.empty((len(nodes), columns))
        off, ended = paths.over_angles(
            DOUBLE, self.tables, self.family, self.room, self.ends, self.cone, nodes, np.array(bounds), steps,
            np.empty(columns), grid,
        )  # fmt: skip
        scale = 0.5 * (bounds[1] - bounds[0]) * self.scale
        value = scale * (self.rule.kronrod @ grid)
        error = _most(value - scale * (self.rule.gauss @ grid))
        return Cell(bounds, value, (error,), scale * off * 2.0 / len(nodes), len(nodes), ended)


def _integrated(
    over: Callable[[tuple[float, ...]], Cell],
    first: Sequence[tuple[float, ...]],
    tolerance: float,
    room: paths.PathRoom,
) -> Integral:
    """Sum over cells, halved until the error is within the tolerance."""
    room.counts[:] = 0
    cells = [over(bounds) for bounds in first]
    paths_so_far, changes, differences, u = sum(cell.paths for cell in cells), 0.0, 0.0, math.inf
    while all(cell.ended for cell in cells):
        ratio = math.sqrt((changes + LEARNED * PRIOR_RATIO**2 * tolerance**2) / (differences + LEARNED * tolerance**2))
        of_cells = _u(cells, CAUTION * ratio)
        whole = math.fsum(math.fsum(cell.value[:-2]) for cell in cells)
        u = max(of_cells, abs(1.0 - whole))  # all light goes somewhere: what the sum lacks is an error that is known
        if u <= SPARE * tolerance or of_cells <= FUTILE * tolerance or paths_so_far >= MOST_PATHS:
            break
        worst = max(range(len(cells)), key=lambda i: cells[i].error)
        cell = cells.pop(worst)
        along = 2 * int(np.argmax(cell.errors))
        middle = 0.5 * (cell.bounds[along] + cell.bounds[along + 1])
        lower, upper = list(cell.bounds), list(cell.bounds)
        lower[along + 1], upper[along] = middle, middle
        halves = [over(tuple(lower)), over(tuple(upper))]
        change = _most(cell.value - halves[0].value - halves[1].value)
        changes += change**2
        differences += cell.error**2
        least = [LEAST_SHARE * error for error in cell.errors]
        least[along // 2] = max(least[along // 2], CHANGE_SHARE * change)
        cells += [half._replace(errors=tuple(map(max, half.errors, least))) for half in halves]
        paths_so_far += sum(half.paths for half in halves)
    ended = all(cell.ended for cell in cells)
    value = np.sum([cell.value for cell in cells], axis=0)
    value /= max(math.fsum(value[:-2]), 1.0)  # more than all light is an error of the quadrature
    missing = 1.0 - math.fsum(value[:-2])  # cut off on the way, or an error that is in u already
    rays, legs, undefined = (int(count) for count in room.counts[:3])
    error = max(u - max(missing, 0.0), 0.0) if ended else math.inf
    counts = np.array([rays, legs, undefined, paths_so_far])
    value *= ended
    return Integral(value[:-2], error, 0.0, counts, ended, float(value[-2]), float(value[-1]))


def _u(cells: list[Cell], ratio: float) -> float:
    squares = math.fsum((ratio * cell.error) ** 2 + cell.inner**2 for cell in cells)
    return math.sqrt(squares)


def _most(differences: FloatArray) -> float:
    return float(np.max(np.abs(differences)))


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


def _room(columns: int) -> paths.PathRoom:
    n = KEPT_RAYS
    return paths.PathRoom(
        u=np.empty(n),
        tree=np.empty(n, np.uint64),
        path=np.empty(n, np.uint64),
        value=np.empty((n, columns)),
        first=np.empty(n, np.int64),
        many=np.empty(n, np.int64),
        legs=np.empty((KEPT_LEGS, 6)),
        waiting=np.empty((KEPT_STRETCHES, 2), np.int64),
        stack=np.empty((STACK_IN_SPACE, WIDTH_IN_SPACE)),
        counts=np.zeros(4, np.int64),
    )

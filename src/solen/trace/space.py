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

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.scene import Scene
from solen.scene.sources import Ambient, Emitter
from solen.scene.sources.pattern import CosinePower, Isotropic, PatternTable
from solen.trace.cone import COARSE_TOLERANCE, DOUBLE, Integral, weighted_sum
from solen.trace.kernel import paths
from solen.trace.kernel.prism import MORE_COLUMNS, FamilyInSpace
from solen.trace.kernel.step import Rules
from solen.trace.tables import Tables
from solen.trace.tail import Tail

FIRST_CELLS, FIRST_LINES = 4, 6
"""Cells along the angle in projection to begin with; of a point, stretches of the angle out of the plane."""
LEARNED, PRIOR_RATIO = 4.0, 0.35
"""Weight and value of what is assumed of error over difference before any cell was halved."""
FIRST_FACE = (0.5, 1)
"""Least weight and most hits of what is followed exactly where following all of it does not do: light that is trapped
comes through strips too narrow to be seen."""
TRAPPED = 0.3
"""Share of the legs that the first cells may take: with more, light is trapped and halving cells does not help."""
LONG_WAY = 8.0
"""Mean number of legs of a ray from which on light is trapped: rules over so many strips agree on a wrong value."""
SPARE, FUTILE = 0.98, 0.1
"""Shares of the tolerance: where cells are halved no further; where what is lacking was not lost between cells."""
NEAR, MORE_LEGS = 3.0, 5
"""Within so many tolerances it goes on to so many times the legs: what is left of light is dearer to sample."""
CAUTION = 2.5
"""Factor on the error learned from halving: it is a root mean square over few cells."""
CHANGE_SHARE, LEAST_SHARE = 0.5, 0.05
"""Least difference of a half: shares of what halving changed, and of the difference before; rules agree by chance."""
CHIP_TOLERANCE = 1e-4
DIFFERENCE_CLOSENESS, DIFFERENCE_SHARE, DIFFERENCE_FLOOR = 0.003, 3e-4, 1e-6
"""Of derivatives: how much closer paths are followed; what an error may be, as a share of the largest one, and as a
change of a power over the step."""
PATH_SHARE, ROUGHEST_PATH, SOFT = 30.0, 0.03, 0.1
"""Along a chip's width: second difference of the powers that Simpson's rule is trusted with, times six, and share of
the width at which an edge is left, both per tolerance and at most; and share of the width up to which nothing is looked
for between two equal rays."""
NARROW_RAD, SOFT_RAD = 1e-5, 0.001
"""Width at which an edge is left, and up to which nothing is looked for, of the angle of a point in radians, for a
tolerance of 1e-4."""


def why_not_in_space(scene: Scene) -> str:
    """Why an extruded scene cannot be integrated; empty where it can."""
    if any(interface.behaviour == "lens" for interface in scene.interfaces):
        return "an ideal lens in space"
    others = [type(source).__name__ for source in scene.sources if source.emission() is None]
    others += [type(source).__name__ for source in scene.sources if isinstance(source, Ambient)]
    return f"a source {others[0]}" if others else ""


class Cell(NamedTuple):
    """A part of the domain with its integral.

    ``apart`` are differences of two rules along each coordinate and ``errors`` what each of them may be off by,
    ``inner`` is the error of the paths.
    """

    bounds: tuple[float, ...]
    value: FloatArray
    apart: tuple[FloatArray, ...]
    errors: tuple[float, ...]
    inner: float
    paths: int

    @property
    def error(self) -> float:
        """Differences of both rules."""
        return sum(self.errors)

    def minus(self, other: "Cell", scale: float) -> "Cell":
        """Difference of two integrals over the same part, times ``scale``."""
        apart = tuple(scale * (mine - its) for mine, its in zip(self.apart, other.apart, strict=True))
        value, inner = scale * (self.value - other.value), scale * math.hypot(self.inner, other.inner)
        return Cell(self.bounds, value, apart, tuple(map(_most, apart)), inner, self.paths + other.paths)


Over = Callable[[tuple[float, ...]], Cell]


class Cells:
    """Cells of a domain with their sums, which change with each of them; the one of the largest error is at hand."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self._heap = [(-cell.error, n, cell) for n, cell in enumerate(cells)]
        heapq.heapify(self._heap)
        self._many = len(cells)
        self._sum()

    def __iter__(self) -> Iterator[Cell]:
        return (cell for _, _, cell in self._heap)

    def u(self, ratio: float) -> float:
        """Error of the sum, where that of a cell is so many times the difference of its rules."""
        of_rules, of_paths = np.maximum(self._squares, 0.0)
        return math.sqrt(ratio**2 * of_rules + of_paths)

    def worst(self) -> Cell:
        """Take out the cell of the largest error."""
        cell = heapq.heappop(self._heap)[-1]
        self._count(cell, -1.0)
        return cell

    def add(self, cell: Cell) -> None:
        """Put in a cell."""
        heapq.heappush(self._heap, (-cell.error, self._many, cell))
        self._many += 1
        self._count(cell, 1.0)
        if self._many & (self._many - 1) == 0:  # now and then anew: what is left may be small beside what was taken out
            self._sum()

    def _sum(self) -> None:
        """Sums from all cells."""
        cells = list(self)
        self._squares = np.array([math.fsum(cell.error**2 for cell in cells), math.fsum(c.inner**2 for c in cells)])
        self.value: FloatArray = np.sum([cell.value for cell in cells], axis=0)

    def _count(self, cell: Cell, sign: float) -> None:
        self.value = self.value + sign * cell.value
        self._squares += sign * np.array([cell.error**2, cell.inner**2])


class Rule(NamedTuple):
    """Nodes in [−1, 1] (N,) and weights (3, N) of three rules on them, from the best to the roughest."""

    nodes: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, *halves: Sequence[float]) -> "Rule":
        """Rule of an odd number of nodes, from the right halves of its columns, the middle first."""
        nodes, *weights = (np.array([*half[:0:-1], *half]) for half in halves)
        nodes[: len(nodes) // 2] *= -1.0
        return cls(nodes, np.array(weights))

    def between(self, low: float, high: float) -> FloatArray:
        """Nodes (N,) of a stretch; the first and the last are its ends, to the last bit."""
        inner = 0.5 * (low + high) + 0.5 * (high - low) * self.nodes[1:-1]
        return np.array([low, *inner, high])

    def integrals(self, grid: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Integral (D,) of values (N, D) at the nodes, the difference of the best two rules, and the largest one.

        That is at least a share of what the rougher two differ by: where the function jumps two rules may agree by
        chance.
        """
        fine, coarse, rough = self.weights @ grid
        apart = fine - coarse
        return fine, apart, max(_most(apart), LEAST_SHARE * _most(coarse - rough))


# Lobatto's rules with Kronrod's extensions (Gander & Gautschi, BIT 40, 2000): with nodes at the ends of a cell, what
# begins at its border is seen.
_FOUR, _SEVEN = (0.0, 1 / 5**0.5, (2 / 3) ** 0.5, 1.0), (16 / 35, 125 / 294, 72 / 245, 11 / 210)
COARSE = Rule.of(_FOUR, _SEVEN, (0.0, 5 / 6, 0.0, 1 / 6), (4 / 3, 0.0, 0.0, 1 / 3))
FINE = Rule.of(
    (0.0, 0.236383199662150, _FOUR[1], 0.641853342345781, _FOUR[2], 0.942882415695480, 1.0),
    (0.242611071901408, 0.224926465333340, 0.199773405226859, 0.188821573960182, 0.155071987336585,
     0.0942738402188500, 0.0158271919734802),
    (_SEVEN[0], 0.0, _SEVEN[1], 0.0, _SEVEN[2], 0.0, _SEVEN[3]),
    (0.0, 0.0, 5 / 6, 0.0, 0.0, 0.0, 1 / 6),
)  # fmt: skip


class Slopes(NamedTuple):
    """Changes of powers per unit of a parameter, what they may be off by, and the cells of each colour."""

    value: FloatArray
    u: float
    cells: list[list[tuple[float, ...]]]


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
        return Tail(self.tables, self.source, True, self.columns, families.__getitem__)

    def _colour(self, family: FamilyInSpace, tolerance: float, most_legs: int) -> Integral:
        room = paths.path_room(self.columns)
        return _integrated(self.over(family, tolerance, room), self.first_cells, tolerance, most_legs, room)

    @property
    def first_cells(self) -> list[tuple[float, ...]]:
        """What the domain is divided into to begin with."""
        sides = [(0.0, 0.5 * math.pi)] if self.mirrored else [(-0.5 * math.pi, 0.0), (0.0, 0.5 * math.pi)]
        if self.source.width_mm > 0.0:
            strips = pairwise(np.linspace(-1.0, 1.0, FIRST_CELLS + 1).tolist())
            return [(*strip, *side) for strip in strips for side in sides]
        return [part for low, high in sides for part in pairwise(np.linspace(low, high, FIRST_LINES + 1).tolist())]

    def over(self, family: FamilyInSpace, tolerance: float, room: paths.PathRoom, closeness: float = 1.0) -> Over:
        """Integral over a cell in one colour; the smaller ``closeness``, the closer are the paths followed."""
        half, width = self.source.half_rad, self.source.width_mm
        if width > 0.0:
            rough = closeness * min(PATH_SHARE * tolerance, ROUGHEST_PATH)
            steps = (rough, rough * width, SOFT * width)
        else:
            narrow = NARROW_RAD * tolerance / CHIP_TOLERANCE
            steps = (closeness * 0.05 * tolerance * self.whole, closeness * narrow, SOFT_RAD)
        domain = Domain(
            self.tables,
            self.ends,
            family,
            (math.cos(half), math.sin(min(half, 0.5 * math.pi))),
            COARSE if tolerance >= COARSE_TOLERANCE and width > 0.0 else FINE,
            (2.0 if self.mirrored else 1.0) / self.whole,
            steps,
            room,
            {},
        )
        return partial(domain.chip, width=width) if width > 0.0 else domain.point

    def slopes(self, lower: "LightInSpace", step: float, rules: Rules, most_legs: int) -> Slopes:
        """Change of the powers (D + 5,) per unit of a parameter, from the ``lower`` scene to this one in two ``step``.

        Both scenes are integrated over the same cells, halved by what the rules find of the difference: an error that
        both have alike drops out. They begin with the cells of one of them, which are small where the light parts: a
        difference may be nothing anywhere else.
        """
        value, squares, cells_of = np.zeros(self.columns), 0.0, []
        for mine, its, weight in zip(self.families, lower.families, self.weights, strict=True):
            room = paths.path_room(self.columns)
            room.counts[:] = 0
            pair = [
                light.over(family._replace(rules=rules), CHIP_TOLERANCE, room, DIFFERENCE_CLOSENESS)
                for light, family in ((self, mine), (lower, its))
            ]

            def over(bounds: tuple[float, ...], pair: list[Over] = pair) -> Cell:
                return pair[0](bounds).minus(pair[1](bounds), 0.5 / step)

            floor = DIFFERENCE_FLOOR / step
            plain = self.over(mine._replace(rules=rules), CHIP_TOLERANCE, room)
            begun, _ = divided(plain, self.first_cells, CHIP_TOLERANCE, most_legs, room)
            first = [over(bounds) for bounds in ([cell.bounds for cell in begun] if begun else self.first_cells)]
            for cells, u in refined(over, first):
                if u <= max(DIFFERENCE_SHARE * _most(cells.value), floor) or room.counts[1] >= most_legs:
                    break
            value += weight * cells.value
            squares += (weight * u) ** 2
            cells_of.append([cell.bounds for cell in cells])
        return Slopes(value, math.sqrt(squares), cells_of)

    def slopes_again(self, lower: "LightInSpace", step: float, rules: Rules, before: Slopes) -> FloatArray:
        """As `slopes`, over the cells found before."""
        value = np.zeros(self.columns)
        for i, weight in enumerate(self.weights):
            room = paths.path_room(self.columns)
            for light, sign in ((self, 1.0), (lower, -1.0)):
                family = light.families[i]._replace(rules=rules)
                over = light.over(family, CHIP_TOLERANCE, room, DIFFERENCE_CLOSENESS)
                for bounds in before.cells[i]:
                    value += sign * 0.5 / step * weight * over(bounds).value
        return value


class Domain(NamedTuple):
    """The angles that an emitter's light in one colour is integrated over."""

    tables: Tables
    ends: FloatArray
    family: FamilyInSpace
    cone: tuple[float, float]
    """cosine of half the cone, and the largest sine out of the plane"""
    rule: Rule
    scale: float
    steps: tuple[float, float, float]
    """density, narrow and soft of `paths.integrate_path`"""
    room: paths.PathRoom
    known: dict[tuple[float, float], FloatArray]
    """integrals at nodes (D + 6,): cells side by side, and halves of cells, have some of them in common"""

    def chip(self, bounds: tuple[float, ...], width: float) -> Cell:
        """Cell of the angle in projection (a share of the largest one) and t, over the width of a chip."""
        grid, off = self._grid(self.rule.between(*bounds[:2]), self.rule.between(*bounds[2:]))
        scale, fine, many = 0.25 * (bounds[1] - bounds[0]) * (bounds[3] - bounds[2]), self.rule.weights[0], off.size
        scale *= self.scale / width
        over_t, over_q = (fine @ grid.reshape(len(fine), -1)).reshape(len(fine), -1), fine @ grid
        _, apart_q, error_q = self.rule.integrals(scale * over_t)
        value, apart_t, error_t = self.rule.integrals(scale * over_q)
        inner = scale * 4.0 / many * float(np.linalg.norm(off))
        return Cell(bounds, value, (apart_q, apart_t), (error_q, error_t), inner, many)

    def point(self, bounds: tuple[float, ...]) -> Cell:
        """Cell of t alone, over the angle in projection."""
        grid, off = self._grid(np.zeros(1), self.rule.between(*bounds), point=True)
        scale, many = 0.5 * (bounds[1] - bounds[0]) * self.scale, off.size
        value, apart, error = self.rule.integrals(scale * grid[:, 0])
        inner = scale * 2.0 / many * float(np.linalg.norm(off))
        return Cell(bounds, value, (apart,), (error,), inner, many)

    def _grid(self, q: FloatArray, t: FloatArray, *, point: bool = False) -> tuple[FloatArray, FloatArray]:
        """Integrals (T, Q, D + 5) at nodes and what each may be off by (T, Q); those known are not computed again."""
        columns = self.room.value.shape[1]
        grid, wanted = np.empty((len(t), len(q), columns + 1)), np.ones((len(t), len(q)), np.bool_)
        nodes = list(enumerate(product(t.tolist(), q.tolist())))
        rows, of_row = grid.reshape(-1, columns + 1), wanted.reshape(-1)
        for n, node in nodes:
            if node in self.known:
                rows[n], of_row[n] = self.known[node], False
        paths.over_nodes(
            DOUBLE, self.tables, self.family, self.room, self.ends, self.cone, point, q, t, wanted, self.steps,
            np.empty(columns), grid,
        )  # fmt: skip
        self.known.update((node, rows[n]) for n, node in nodes if of_row[n])
        return np.ascontiguousarray(grid[..., :-1]), grid[..., -1]


def _integrated(
    over: Over,
    first: Sequence[tuple[float, ...]],
    tolerance: float,
    most_legs: int,
    room: paths.PathRoom,
) -> Integral:
    """Sum over cells, halved until the error is within the tolerance."""
    room.counts[:] = 0
    cells, u = divided(over, first, tolerance, most_legs, room)
    rays, legs, undefined = (int(count) for count in room.counts[:3])
    counts = np.array([rays, legs, undefined, sum(cell.paths for cell in cells or ())])
    if cells is None:
        return Integral(np.zeros(room.value.shape[1] + 2 - MORE_COLUMNS), 0.0, 1.0, counts)
    whole = accounted(cells.value)
    value = cells.value / max(whole, 1.0)  # more than all light is an error of the quadrature
    error = max(u - max(1.0 - whole, 0.0), 0.0)  # what is lacking is in u already
    share, missed, leaked = value[: 2 - MORE_COLUMNS], float(value[-3]), float(value[-2])
    return Integral(share, error, max(1.0 - whole, 0.0), counts, missed, leaked)


def divided(
    over: Over, first: Sequence[tuple[float, ...]], tolerance: float, most_legs: int, room: paths.PathRoom
) -> tuple[Cells | None, float]:
    """Cells of the domain for a tolerance, and the error of their sum; none where light is trapped."""
    beginning: list[Cell] = []
    for bounds in first:
        beginning.append(over(bounds))
        if room.counts[1] > TRAPPED * most_legs:
            return None, 1.0
    if room.counts[1] > LONG_WAY * room.counts[0]:
        return None, 1.0
    for cells, of_cells in refined(over, beginning):
        lacking = abs(1.0 - accounted(cells.value))  # all light goes somewhere: this is an error that is known
        u = max(of_cells, lacking)
        most = (MORE_LEGS if u <= NEAR * tolerance else 1) * most_legs
        if u <= SPARE * tolerance or of_cells <= FUTILE * tolerance or room.counts[1] >= most:
            break
    return cells, u


def refined(over: Over, first: Sequence[Cell]) -> Iterator[tuple[Cells, float]]:
    """Cells and the error of their sum, the cell of the largest error halved each time."""
    ratios, halved, cells = LEARNED * PRIOR_RATIO**2, LEARNED, Cells(first)
    while True:
        yield cells, cells.u(CAUTION * math.sqrt(ratios / halved))
        cell = cells.worst()
        along = 0 if cell.errors[0] == max(cell.errors) else 1
        low, high = cell.bounds[2 * along : 2 * along + 2]
        middle, before, after = 0.5 * (low + high), cell.bounds[: 2 * along], cell.bounds[2 * along + 2 :]
        halves = [over((*before, *half, *after)) for half in ((low, middle), (middle, high))]
        change = _most(cell.value - halves[0].value - halves[1].value)
        ratios, halved = ratios + (change / cell.error) ** 2, halved + 1.0
        least = [LEAST_SHARE * error for error in cell.errors]
        least[along] = max(least[along], CHANGE_SHARE * change)
        for half in halves:
            cells.add(half._replace(errors=tuple(map(max, half.errors, least))))


def accounted(value: FloatArray) -> float:
    """All that is known of where light goes: to receivers, escaped, absorbed, and what is unfinished."""
    return math.fsum(value[: 2 - MORE_COLUMNS]) + float(value[-1])


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

"""Integration over cells of two angles: the cell with the largest error is halved until the tolerance is reached.

The difference of two rules on a cell is many times its error. The ratio of error to difference is estimated from the
changes observed when cells are halved. All light must be accounted for: any power missing from the sum also counts as
error.
"""

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.cells import MIN_SHARE, Rule
from solen.trace.kernel.prism import MORE_COLUMNS

LEARNED, PRIOR_RATIO = 4.0, 0.35
"""Weight and value of the prior for the ratio of error to difference, before any cell is halved."""
TRAPPED = 0.3
"""Maximum fraction of the ray segments that the initial cells may use. If they use more, light is trapped and halving
cells does not help.
"""
LONG_WAY = 8.0
"""Mean number of segments per ray above which light is considered trapped: with so many strips, rules agree on a wrong
value.
"""
SPARE, FUTILE = 0.98, 0.1
"""Fractions of the tolerance: the uncertainty at which halving stops, and the quadrature error below which any missing
power is not due to the division into cells.
"""
NEAR, MORE_LEGS = 3.0, 5
"""If the uncertainty is within the first factor times the tolerance, the segment limit is multiplied by the second
factor, because sampling would be slower.
"""
CAUTION = 2.5
"""Safety factor on the error estimated from halving, which is a root mean square over few cells."""
CHANGE_SHARE = 0.5
"""Minimum difference of each half, as a fraction of the change caused by halving the cell."""
Bounds = tuple[float, float, float, float]
"""Start and end of the projected angle, as fractions of its maximum, then start and end of the out-of-plane angle t."""


# Lobatto rules with Kronrod extensions (Gander & Gautschi, BIT 40, 2000): nodes at the ends of a cell detect
# features that begin at the cell boundary.
_FOUR, _SEVEN = (0.0, 1 / 5**0.5, (2 / 3) ** 0.5, 1.0), (16 / 35, 125 / 294, 72 / 245, 11 / 210)
COARSE = Rule.of(_FOUR, _SEVEN, (0.0, 5 / 6, 0.0, 1 / 6), (4 / 3, 0.0, 0.0, 1 / 3))
FINE = Rule.of(
    (0.0, 0.236383199662150, _FOUR[1], 0.641853342345781, _FOUR[2], 0.942882415695480, 1.0),
    (0.242611071901408, 0.224926465333340, 0.199773405226859, 0.188821573960182, 0.155071987336585,
     0.0942738402188500, 0.0158271919734802),
    (_SEVEN[0], 0.0, _SEVEN[1], 0.0, _SEVEN[2], 0.0, _SEVEN[3]),
    (0.0, 0.0, 5 / 6, 0.0, 0.0, 0.0, 1 / 6),
)  # fmt: skip


POINT = Rule(np.zeros(1), np.full((3, 1), 2.0))
"""Rule for a point emitter: the path covers the projected angle, so only the out-of-plane angle remains."""


class Cell(NamedTuple):
    """A part of the domain with its integral.

    ``apart`` (2, D) contains the differences of two rules along each coordinate, ``errors`` the corresponding error
    estimates, and ``inner`` the error of the path integrals.
    """

    bounds: Bounds
    value: FloatArray
    apart: FloatArray
    errors: tuple[float, float]
    inner: float
    paths: int

    @property
    def error(self) -> float:
        """Sum of the rule differences along both coordinates."""
        return self.errors[0] + self.errors[1]

    def minus(self, other: "Cell", scale: float) -> "Cell":
        """Difference of two integrals over the same part, multiplied by ``scale``."""
        value, apart = scale * (self.value - other.value), scale * (self.apart - other.apart)
        inner = scale * math.hypot(self.inner, other.inner)
        return Cell(self.bounds, value, apart, (_most(apart[0]), _most(apart[1])), inner, self.paths + other.paths)


Over = Callable[[Sequence[Bounds]], list[Cell]]
"""Function that integrates over cells."""


class Cells:
    """Cells of a domain, with running sums and fast access to the cell with the largest error."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self._heap = [(-cell.error, n, cell) for n, cell in enumerate(cells)]
        heapq.heapify(self._heap)
        self._many = len(cells)
        self._sum()

    def __iter__(self) -> Iterator[Cell]:
        return (cell for _, _, cell in self._heap)

    def u(self, ratio: float) -> float:
        """Error of the sum, if the error of each cell is ``ratio`` times its rule difference."""
        of_rules, of_paths = np.maximum(self._squares, 0.0)
        return math.sqrt(ratio**2 * of_rules + of_paths)

    def worst(self) -> Cell:
        """Remove and return the cell with the largest error."""
        cell = heapq.heappop(self._heap)[-1]
        self._count(cell, -1.0)
        return cell

    def add(self, cell: Cell) -> None:
        """Add a cell."""
        heapq.heappush(self._heap, (-cell.error, self._many, cell))
        self._many += 1
        self._count(cell, 1.0)
        if self._many & (self._many - 1) == 0:  # occasionally, as rounding errors of removed cells accumulate
            self._sum()

    def _sum(self) -> None:
        """Compute the sums from all cells."""
        cells = list(self)
        self._squares = np.array([math.fsum(cell.error**2 for cell in cells), math.fsum(c.inner**2 for c in cells)])
        self.value: FloatArray = np.sum([cell.value for cell in cells], axis=0)

    def _count(self, cell: Cell, sign: float) -> None:
        self.value = self.value + sign * cell.value
        self._squares += sign * np.array([cell.error**2, cell.inner**2])


def divided(
    over: Over, first: Sequence[Bounds], tolerance: float, most_legs: int, counts: IntArray
) -> tuple[Cells | None, float]:
    """Divide the domain into cells to reach a tolerance; return them (None for trapped light) and their total error."""
    beginning: list[Cell] = []
    for bounds in first:
        beginning += over([bounds])
        if counts[1] > TRAPPED * most_legs:
            return None, 1.0
    if counts[1] > LONG_WAY * counts[0]:
        return None, 1.0
    for cells, of_cells in refined(over, beginning):
        lacking = abs(1.0 - accounted(cells.value))  # all light has a fate, so this error is known
        u = max(of_cells, lacking)
        most = (MORE_LEGS if u <= NEAR * tolerance else 1) * most_legs
        if u <= SPARE * tolerance or of_cells <= FUTILE * tolerance or counts[1] >= most:
            break
    return cells, u


def refined(over: Over, first: Sequence[Cell], caution: float = CAUTION) -> Iterator[tuple[Cells, float]]:
    """Yield the cells and the error of their sum, halving the cell with the largest error after each yield.

    ``caution`` is a safety factor on the error estimated from halving.
    """
    ratios, many, cells = LEARNED * PRIOR_RATIO**2, LEARNED, Cells(first)
    while True:
        yield cells, cells.u(caution * math.sqrt(ratios / many))
        cell = cells.worst()
        halves = over(halved(cell.bounds, 0 if cell.errors[0] > cell.errors[1] else 1))
        change = _most(cell.value - halves[0].value - halves[1].value)
        if cell.error > 0.0:
            ratios, many = ratios + (change / cell.error) ** 2, many + 1.0
        q, t = (MIN_SHARE * error for error in cell.errors)
        if cell.errors[0] > cell.errors[1]:
            q = max(q, CHANGE_SHARE * change)
        else:
            t = max(t, CHANGE_SHARE * change)
        for half in halves:
            cells.add(half._replace(errors=(max(half.errors[0], q), max(half.errors[1], t))))


def halved(bounds: Bounds, along: int) -> list[Bounds]:
    """Return both halves of a cell, divided in the projected angle if ``along`` is 0, else in the other angle."""
    q, q_end, t, t_end = bounds
    if along == 0:
        middle = 0.5 * (q + q_end)
        return [(q, middle, t, t_end), (middle, q_end, t, t_end)]
    middle = 0.5 * (t + t_end)
    return [(q, q_end, t, middle), (q, q_end, middle, t_end)]


def accounted(value: FloatArray) -> float:
    """Fraction of the light that is accounted for: detected, escaped, absorbed or unfinished."""
    return math.fsum(value[: 2 - MORE_COLUMNS]) + float(value[-1])


def _most(differences: FloatArray) -> float:
    return float(np.max(np.abs(differences)))

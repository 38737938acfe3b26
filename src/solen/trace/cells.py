"""Integration over cells of two angles: the cell with the largest error is halved until the tolerance is reached.

The difference of two rules on a cell is many times its error. The ratio of error to difference is estimated from the
changes observed when cells are halved. All light must be accounted for, so any power missing from the sum is also an
error.
"""

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.cells import MIN_FRACTION, Rule
from solen.trace.kernel.prism import EXTRA_COLUMNS

PRIOR_WEIGHT, PRIOR_RATIO = 4.0, 0.35
"""Weight and value of the prior for the ratio of error to difference, before any cell is halved."""
MAX_INITIAL_FRACTION = 0.3
"""Maximum fraction of the ray segments that the initial cells may use. If they use more, light is trapped and halving
cells does not help.
"""
MAX_MEAN_SEGMENTS = 8.0
"""Mean number of segments per ray above which light is considered trapped: it arrives in so many narrow strips that two
rules may agree on a wrong value.
"""
STOP_FRACTION, NEGLIGIBLE_FRACTION = 0.98, 0.1
"""Fractions of the tolerance: the uncertainty at which halving stops, and the quadrature error below which any missing
power is not due to the division into cells.
"""
NEARLY_REACHED, EXTRA_EFFORT = 3.0, 5
"""If the uncertainty is below the first factor times the tolerance, the segment limit is multiplied by the second,
because sampling would take longer.
"""
SAFETY_FACTOR = 2.5
"""Factor on the error estimated from halving, which is an RMS over few cells."""
CHANGE_FRACTION = 0.5
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

    ``differences`` (2, D) are those of two rules along each coordinate, ``errors`` the corresponding error estimates,
    and ``path_error`` is the error of the path integrals.
    """

    bounds: Bounds
    value: FloatArray
    differences: FloatArray
    errors: tuple[float, float]
    path_error: float
    paths: int

    @property
    def error(self) -> float:
        """Sum of the error estimates along both coordinates."""
        return self.errors[0] + self.errors[1]

    def minus(self, other: "Cell", scale: float) -> "Cell":
        """Return the difference of two integrals over the same part, multiplied by ``scale``."""
        value, differences = scale * (self.value - other.value), scale * (self.differences - other.differences)
        errors = (_largest(differences[0]), _largest(differences[1]))
        path_error = scale * math.hypot(self.path_error, other.path_error)
        return Cell(self.bounds, value, differences, errors, path_error, self.paths + other.paths)


Integrator = Callable[[Sequence[Bounds]], list[Cell]]
"""Function that integrates over cells."""


class Cells:
    """Cells of a domain, with running sums and fast access to the cell with the largest error."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self._heap = [(-cell.error, n, cell) for n, cell in enumerate(cells)]
        heapq.heapify(self._heap)
        self._added = len(cells)
        self._sum()

    def __iter__(self) -> Iterator[Cell]:
        return (cell for _, _, cell in self._heap)

    def total_error(self, ratio: float) -> float:
        """Return the error of the sum, if the error of each cell is ``ratio`` times its estimate."""
        rules, paths = np.maximum(self._squares, 0.0)
        return math.sqrt(ratio**2 * rules + paths)

    def pop_largest(self) -> Cell:
        """Remove and return the cell with the largest error."""
        cell = heapq.heappop(self._heap)[-1]
        self._count(cell, -1.0)
        return cell

    def add(self, cell: Cell) -> None:
        """Add a cell."""
        heapq.heappush(self._heap, (-cell.error, self._added, cell))
        self._added += 1
        self._count(cell, 1.0)
        if self._added & (self._added - 1) == 0:  # occasionally, as rounding errors accumulate
            self._sum()

    def _sum(self) -> None:
        """Compute the sums from all cells."""
        cells = list(self)
        squares = (math.fsum(cell.error**2 for cell in cells), math.fsum(cell.path_error**2 for cell in cells))
        self._squares = np.array(squares)
        self.value: FloatArray = np.sum([cell.value for cell in cells], axis=0)

    def _count(self, cell: Cell, sign: float) -> None:
        self.value = self.value + sign * cell.value
        self._squares += sign * np.array([cell.error**2, cell.path_error**2])


def divided(
    integrate: Integrator, bounds: Sequence[Bounds], tolerance: float, max_segments: int, counts: IntArray
) -> tuple[Cells | None, float]:
    """Divide the domain into cells to reach a tolerance; return them (None for trapped light) and their total error.

    ``bounds`` are those of the initial cells; ``counts`` are updated by the integrator.
    """
    initial: list[Cell] = []
    for cell_bounds in bounds:
        initial += integrate([cell_bounds])
        if counts[1] > MAX_INITIAL_FRACTION * max_segments:
            return None, 1.0
    if counts[1] > MAX_MEAN_SEGMENTS * counts[0]:
        return None, 1.0
    for cells, error in refined(integrate, initial):
        missing = abs(1.0 - accounted(cells.value))  # all light has a fate, so this error is known
        u = max(error, missing)
        limit = (EXTRA_EFFORT if u <= NEARLY_REACHED * tolerance else 1) * max_segments
        if u <= STOP_FRACTION * tolerance or error <= NEGLIGIBLE_FRACTION * tolerance or counts[1] >= limit:
            break
    return cells, u


def refined(
    integrate: Integrator, initial: Sequence[Cell], safety_factor: float = SAFETY_FACTOR
) -> Iterator[tuple[Cells, float]]:
    """Yield the cells and the error of their sum; halve the cell with the largest error after each yield."""
    ratios, weight, cells = PRIOR_WEIGHT * PRIOR_RATIO**2, PRIOR_WEIGHT, Cells(initial)
    while True:
        yield cells, cells.total_error(safety_factor * math.sqrt(ratios / weight))
        cell = cells.pop_largest()
        halves = integrate(halved(cell.bounds, 0 if cell.errors[0] > cell.errors[1] else 1))
        change = _largest(cell.value - halves[0].value - halves[1].value)
        if cell.error > 0.0:
            ratios, weight = ratios + (change / cell.error) ** 2, weight + 1.0
        q, t = (MIN_FRACTION * error for error in cell.errors)
        if cell.errors[0] > cell.errors[1]:
            q = max(q, CHANGE_FRACTION * change)
        else:
            t = max(t, CHANGE_FRACTION * change)
        for half in halves:
            cells.add(half._replace(errors=(max(half.errors[0], q), max(half.errors[1], t))))


def halved(bounds: Bounds, along: int) -> list[Bounds]:
    """Return both halves of a cell, divided in the projected angle if ``along`` is 0, otherwise in the other angle."""
    q, q_end, t, t_end = bounds
    if along == 0:
        middle = 0.5 * (q + q_end)
        return [(q, middle, t, t_end), (middle, q_end, t, t_end)]
    middle = 0.5 * (t + t_end)
    return [(q, q_end, t, middle), (q, q_end, middle, t_end)]


def accounted(value: FloatArray) -> float:
    """Return the fraction of the light that is accounted for: detected, escaped, absorbed or unfinished."""
    return math.fsum(value[: 2 - EXTRA_COLUMNS]) + float(value[-1])


def _largest(differences: FloatArray) -> float:
    return float(np.max(np.abs(differences)))

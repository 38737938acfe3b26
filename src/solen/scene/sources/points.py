"""Points that fill the unit cube uniformly, by number or at random.

One or two coordinates use a rank-1 lattice whose first coordinate has equal steps; in one dimension this is the
midpoint rule. Three or more coordinates use ``COPIES`` Sobol' nets in turn, each with a fixed random digital shift. A
lattice in many dimensions can be poor along the one direction that matters, and then both of its halves have the same
error. Independent copies do not have this problem, so their standard deviation gives the uncertainty of their mean
(decision 31).

Scrambled nets are identical to those of `scipy.stats.qmc.Sobol` with the same generator. They are computed here because
importing scipy takes longer than tracing with them, and so that they do not change with future versions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from solen.arrays import FloatArray, IntArray

POLYNOMIALS: tuple[tuple[int, int, tuple[int, ...]], ...] = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
)
"""Degree, inner coefficients and initial direction numbers of the second and further coordinates: S. Joe and F. Y. Kuo,
Constructing Sobol' sequences with better two-dimensional projections, SIAM J. Sci. Comput. 30 (2008), table D6.
"""
MAX_DIMENSIONS = 1 + len(POLYNOMIALS)
SCRAMBLED_DIGITS = 30
COPIES = 16
DIGITS = 52
"""Binary digits of a point: the largest number for which double precision can represent an added half."""


def copies(dimensions: int) -> int:
    """Return the number of independent nets among which the points are divided; 1 if they form one lattice."""
    return COPIES if dimensions > 2 else 1


def points(number: FloatArray, count: int, dimensions: int) -> FloatArray:
    """Return points (N, dimensions) in [0, 1) for the numbers (N,) in a set of ``count`` points.

    Consecutive numbers belong to consecutive copies, in turn.
    """
    if copies(dimensions) == 1:
        return _lattice(number, count, dimensions)
    index = np.asarray(number, dtype=np.int64)
    net = plain(dimensions, DIGITS).at(index // COPIES)
    return np.asarray(((net ^ _shifts(dimensions)[index % COPIES]) + 0.5) * 2.0**-DIGITS)


def sample(dimensions: int, seed: tuple[int, ...]) -> Callable[[int, int], FloatArray]:
    """Return a function for the points (stop − start, dimensions) of a scrambled Sobol' sequence.

    The points are in Gray-code order, and equal those of scipy's ``qmc.Sobol`` with ``default_rng(seed)``.
    """
    net = scrambled(dimensions, np.random.default_rng(seed).spawn(1)[0])

    def at(start: int, stop: int) -> FloatArray:
        number = np.arange(start, stop)
        return np.asarray(net.at(number ^ (number >> 1)) * 2.0**-SCRAMBLED_DIGITS)

    return at


def _lattice(number: FloatArray, count: int, dimensions: int) -> FloatArray:
    """Return points with equal steps in the first coordinate and golden-ratio steps in the second, if there is one."""
    first = ((number + 0.5) / count)[:, None]
    if dimensions == 1:
        return first
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / dimensions)
    powers = ratio ** -np.arange(1.0, dimensions)
    return np.hstack([first, ((number + 0.5)[:, None] * powers + 0.5) % 1.0])


@lru_cache(maxsize=MAX_DIMENSIONS)
def _shifts(dimensions: int) -> IntArray:
    """Return digital shifts (COPIES, dimensions), from raw numbers that are the same in every version of numpy."""
    raw = np.random.PCG64(31).random_raw((COPIES, MAX_DIMENSIONS))
    return np.asarray(raw[:, :dimensions] >> np.uint64(64 - DIGITS), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Net:
    """A digital net: direction numbers (dimensions, digits), one per binary digit, and a digital shift (dimensions,).

    All entries are integers below 2^digits.
    """

    directions: IntArray
    shift: IntArray

    def at(self, index: IntArray) -> IntArray:
        """Return the points (N, dimensions) with these numbers (N,), as integers below 2^digits."""
        values = np.empty((len(self.shift), len(index)), dtype=np.int64)
        values[:] = self.shift[:, None]
        for byte in range((int(index.max(initial=0)).bit_length() + 7) // 8):
            value = (index >> (8 * byte)) & 255
            for coordinate, table in enumerate(self._tables[byte]):
                values[coordinate] ^= np.take(table, value)
        return values.T

    @cached_property
    def _tables(self) -> list[list[IntArray]]:
        """Contribution of each value of a byte of the point number, indexed by byte and coordinate."""
        digits = self.directions.shape[1]
        starts = range(0, digits, 8)
        return [[_table(row[start : start + 8].tolist()) for row in self.directions] for start in starts]


def _table(directions: list[int]) -> IntArray:
    table = [0]
    for direction in directions:
        table += [value ^ direction for value in table]
    return np.array(table, dtype=np.int64)


@lru_cache(maxsize=2 * MAX_DIMENSIONS)
def plain(dimensions: int, digits: int) -> Net:
    """Return the unscrambled Sobol' net."""
    directions = np.array([_directions(i, digits) for i in range(dimensions)], dtype=np.int64)
    return Net(directions, np.zeros(dimensions, dtype=np.int64))


def scrambled(dimensions: int, generator: np.random.Generator) -> Net:
    """Return a scrambled Sobol' net of `SCRAMBLED_DIGITS` digits: a random linear scramble and a random digital shift.

    Each coordinate is scrambled with its own lower triangular binary matrix (J. Matoušek, On the L2-discrepancy for
    anchored boxes, J. Complexity 14, 1998).
    """
    digits = SCRAMBLED_DIGITS
    powers = 1 << np.arange(digits, dtype=np.int64)
    shift = generator.integers(2, size=(dimensions, digits), dtype=np.uint32).astype(np.int64) @ powers
    matrices = np.tril(generator.integers(2, size=(dimensions, digits, digits), dtype=np.uint32).astype(np.int64))
    matrices[:, np.arange(digits), np.arange(digits)] = 1
    bits = (plain(dimensions, digits).directions[:, :, None] >> np.arange(digits - 1, -1, -1)) & 1
    scrambled_bits = (bits @ matrices.transpose(0, 2, 1)) & 1
    return Net(scrambled_bits @ powers[::-1], shift)


def _directions(coordinate: int, digits: int) -> list[int]:
    """Return the direction numbers of a coordinate, one per binary digit."""
    if coordinate == 0:
        return [1 << (digits - 1 - bit) for bit in range(digits)]
    degree, inner, first = POLYNOMIALS[coordinate - 1]
    directions = list(first)
    for bit in range(degree, digits):
        new = directions[bit - degree] ^ (directions[bit - degree] << degree)
        for k in range(1, degree):
            if (inner >> (degree - 1 - k)) & 1:
                new ^= directions[bit - k] << k
        directions.append(new)
    return [number << (digits - 1 - bit) for bit, number in enumerate(directions)]

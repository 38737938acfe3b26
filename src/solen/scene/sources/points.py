"""Points that fill the unit cube evenly, by their number.

One or two coordinates: a rank-1 lattice whose first coordinate has equal steps, so that one dimension is the midpoint
rule. Three and more: ``COPIES`` Sobol' nets, dealt in turn, each with its digits shifted by numbers that are drawn once
and for all. A lattice of many dimensions can be poor in a direction that matters, and its halves are then wrong alike;
independent copies are not, so how far they are apart says how far their mean can be trusted (decision 31).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Whole = NDArray[np.int64]

COPIES = 16
DIGITS = 52
"""Binary digits of a point: as many as leave room for a half in double precision."""
POLYNOMIALS: tuple[tuple[int, int, tuple[int, ...]], ...] = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
)
"""Degree, inner coefficients and first numbers of the coordinates from the second on: S. Joe and F. Y. Kuo,
Constructing Sobol' sequences with better two-dimensional projections, SIAM J. Sci. Comput. 30 (2008), table D6."""
MOST_DIMENSIONS = 1 + len(POLYNOMIALS)


def copies(dimensions: int) -> int:
    """Independent copies that the points of so many coordinates are dealt to; 1 where they are one lattice."""
    return COPIES if dimensions > 2 else 1


def points(number: Real, many: int, dimensions: int) -> Real:
    """Points (N, dimensions) in [0, 1) by their numbers (N,), of so ``many``.

    Those numbered 0, 1, 2, … belong to copy 0, 1, 2, … and so on in turn.
    """
    if copies(dimensions) == 1:
        return _lattice(number, many, dimensions)
    whole = np.asarray(number, dtype=np.int64)
    shift = _shifts(dimensions)[whole % COPIES]
    return np.asarray(((_net(whole // COPIES, dimensions) ^ shift) + 0.5) * 2.0**-DIGITS)


def _lattice(number: Real, many: int, dimensions: int) -> Real:
    """The first coordinate in equal steps, a second one in steps of the golden ratio."""
    first = ((number + 0.5) / many)[:, None]
    if dimensions == 1:
        return first
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / dimensions)
    powers = ratio ** -np.arange(1.0, dimensions)
    return np.hstack([first, ((number + 0.5)[:, None] * powers + 0.5) % 1.0])


def _net(index: Whole, dimensions: int) -> Whole:
    """Points of the Sobol' sequence as whole numbers (N, dimensions) below 2^DIGITS.

    Eight binary digits of the index are looked up at a time.
    """
    found = np.zeros((dimensions, len(index)), dtype=np.int64)
    for byte in range((int(index.max(initial=0)).bit_length() + 7) // 8):
        value = (index >> (8 * byte)) & 255
        for coordinate in range(dimensions):
            found[coordinate] ^= np.take(_table(coordinate, byte), value)
    return found.T


@lru_cache(maxsize=64)
def _table(coordinate: int, byte: int) -> Whole:
    """What each value of one byte of the index contributes to a coordinate (256,)."""
    directions = _directions(coordinate)[8 * byte : 8 * byte + 8]
    table = [0]
    for direction in directions + (0,) * (8 - len(directions)):
        table += [known ^ direction for known in table]
    return np.array(table, dtype=np.int64)


@lru_cache(maxsize=MOST_DIMENSIONS)
def _directions(coordinate: int) -> tuple[int, ...]:
    """Numbers that a coordinate's binary digits are made of, as whole numbers below 2^DIGITS (DIGITS of them)."""
    if coordinate == 0:
        return tuple(1 << (DIGITS - 1 - bit) for bit in range(DIGITS))
    degree, inner, first = POLYNOMIALS[coordinate - 1]
    found = list(first)
    for bit in range(degree, DIGITS):
        new = found[bit - degree] ^ (found[bit - degree] << degree)
        for k in range(1, degree):
            if (inner >> (degree - 1 - k)) & 1:
                new ^= found[bit - k] << k
        found.append(new)
    return tuple(number << (DIGITS - 1 - bit) for bit, number in enumerate(found))


@lru_cache(maxsize=MOST_DIMENSIONS)
def _shifts(dimensions: int) -> Whole:
    """Digital shifts (COPIES, dimensions); the generator's raw numbers are the same in every version of numpy."""
    raw = np.random.PCG64(31).random_raw((COPIES, MOST_DIMENSIONS))
    return np.asarray(raw[:, :dimensions] >> np.uint64(64 - DIGITS), dtype=np.int64)

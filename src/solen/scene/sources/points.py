"""Points that fill the unit cube evenly, by their number, or by chance.

One or two coordinates: a rank-1 lattice whose first coordinate has equal steps, so that one dimension is the midpoint
rule. Three and more: ``COPIES`` Sobol' nets, dealt in turn, each with its digits shifted by numbers that are drawn once
and for all. A lattice of many dimensions can be poor in a direction that matters, and its halves are then wrong alike;
independent copies are not, so how far they are apart says how far their mean can be trusted (decision 31).
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.scene.sources.net import MOST_DIMENSIONS, SCRAMBLED_DIGITS, plain, scrambled

COPIES = 16
DIGITS = 52
"""Binary digits of a point: as many as leave room for a half in double precision."""


def copies(dimensions: int) -> int:
    """Independent copies that the points of so many coordinates are dealt to; 1 where they are one lattice."""
    return COPIES if dimensions > 2 else 1


def points(number: FloatArray, many: int, dimensions: int) -> FloatArray:
    """Points (N, dimensions) in [0, 1) by their numbers (N,), of so ``many``.

    Those numbered 0, 1, 2, … belong to copy 0, 1, 2, … and so on in turn.
    """
    if copies(dimensions) == 1:
        return _lattice(number, many, dimensions)
    whole = np.asarray(number, dtype=np.int64)
    net = plain(dimensions, DIGITS).at(whole // COPIES)
    return np.asarray(((net ^ _shifts(dimensions)[whole % COPIES]) + 0.5) * 2.0**-DIGITS)


def sample(dimensions: int, seed: tuple[int, ...]) -> Callable[[int, int], FloatArray]:
    """A scrambled Sobol' sequence: gives its points (stop - start, dimensions) from one number up to another.

    They come in the order of a Gray code, and are those that scipy's ``qmc.Sobol`` draws of ``default_rng(seed)``.
    """
    net = scrambled(dimensions, np.random.default_rng(seed).spawn(1)[0])

    def at(start: int, stop: int) -> FloatArray:
        number = np.arange(start, stop)
        return np.asarray(net.at(number ^ (number >> 1)) * 2.0**-SCRAMBLED_DIGITS)

    return at


def _lattice(number: FloatArray, many: int, dimensions: int) -> FloatArray:
    """The first coordinate in equal steps, a second one in steps of the golden ratio."""
    first = ((number + 0.5) / many)[:, None]
    if dimensions == 1:
        return first
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / dimensions)
    powers = ratio ** -np.arange(1.0, dimensions)
    return np.hstack([first, ((number + 0.5)[:, None] * powers + 0.5) % 1.0])


@lru_cache(maxsize=MOST_DIMENSIONS)
def _shifts(dimensions: int) -> IntArray:
    """Digital shifts (COPIES, dimensions); the generator's raw numbers are the same in every version of numpy."""
    raw = np.random.PCG64(31).random_raw((COPIES, MOST_DIMENSIONS))
    return np.asarray(raw[:, :dimensions] >> np.uint64(64 - DIGITS), dtype=np.int64)

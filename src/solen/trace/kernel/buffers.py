"""Working memory for a block of rays."""

from typing import Any, NamedTuple

import numpy as np

from solen.arrays import IntArray
from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.rows import Floats, Tags

BLOCK = 256
"""Number of rays in a block: enough to fill vector registers, few enough to remain in the first-level cache."""
X, Z, DX, DZ, S, P, MIN_POWER, U, OPTICAL = range(9)
REGION, LAST, HIT, BRANCH, NUMBER, PARENT, COLOUR = range(7)


class Rays(NamedTuple):
    """A block of rays (BLOCK,): position, direction, the curve at the origin, and its parameter there."""

    x: Floats
    z: Floats
    dx: Floats
    dz: Floats
    last: Tags
    u: Floats


class BlockHits(NamedTuple):
    """The nearest hit of each ray in a block (BLOCK,), and working memory."""

    distance: Floats
    curve: Tags
    u: Floats
    work: Floats
    int_work: Tags


class Loads(NamedTuple):
    """The load of each ray in a block (BLOCK,); see `solen.trace.kernel.step.Load`."""

    s: Floats
    p: Floats
    min_power: Floats
    optical: Floats
    region: Tags
    colour: Tags
    hits: Tags


class Rows(NamedTuple):
    """Rays to be traced (N,)."""

    x: Floats
    z: Floats
    dx: Floats
    dz: Floats
    s: Floats
    p: Floats
    colour: IntArray


class Buffers(NamedTuple):
    """Working memory for N rays."""

    state: Floats
    """(9, BLOCK) rows X to OPTICAL of the rays in the current block"""
    tags: Tags
    """(7, BLOCK) rows REGION to COLOUR"""
    hit: BlockHits
    waiting_state: Floats
    """(capacity, 9) waiting branches"""
    waiting_tags: Tags
    """(capacity, 7)"""
    branches: IntArray
    """(N,) number of branches of each ray so far, initially 1"""


@compiled
def copy_ray(state: Floats, tags: Tags, i: int, j: int) -> None:
    """Copy ray i of a block to position j."""
    for row in range(len(state)):
        state[row, j] = state[row, i]
    for row in range(len(tags)):
        tags[row, j] = tags[row, i]


@compiled
def resume(
    state: Floats, tags: Tags, n: int, waiting_state: Floats, waiting_tags: Tags, waiting: int
) -> tuple[int, int]:
    """Add waiting branches to a block of n rays; return the number of rays and the number of branches still waiting."""
    while n < BLOCK and waiting > 0:
        waiting -= 1
        for row in range(len(state)):
            state[row, n] = waiting_state[waiting, row]
        for row in range(len(tags)):
            tags[row, n] = waiting_tags[waiting, row]
        n += 1
    return n, waiting


def tag_of(dtype: type[np.floating[Any]]) -> type[np.signedinteger[Any]]:
    """Return the integer type with the same width as a floating-point type."""
    return np.int64 if dtype is np.float64 else np.int32


def block_buffers(dtype: type[np.floating[Any]]) -> BlockHits:
    """Allocate memory for the hits of a block."""
    tag = tag_of(dtype)
    return BlockHits(
        np.empty(BLOCK, dtype),
        np.empty(BLOCK, tag),
        np.empty(BLOCK, dtype),
        np.empty((13, BLOCK + 1), dtype),
        np.empty(BLOCK + 1, tag),
    )


def new_buffers(rays: int, dtype: type[np.floating[Any]], capacity: int = 64 * BLOCK) -> Buffers:
    """Allocate working memory for this many rays, and for ``capacity`` waiting branches."""
    return Buffers(
        np.empty((9, BLOCK), dtype),
        np.empty((7, BLOCK), tag_of(dtype)),
        block_buffers(dtype),
        np.empty((capacity, 9), dtype),
        np.empty((capacity, 7), tag_of(dtype)),
        np.ones(rays, np.int64),
    )

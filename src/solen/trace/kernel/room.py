"""Where the rays of a block are kept, and room to work in."""

from typing import Any, NamedTuple

import numpy as np

from solen.arrays import IntArray
from solen.trace.kernel.rows import Floats, Tags

BLOCK = 256
"""Rays carried side by side: enough to fill vector registers, few enough to stay in the nearest cache."""
X, Z, DX, DZ, S, P, LEAST, AT, OPTICAL = range(9)
REGION, LAST, HIT, BRANCH, NUMBER, PARENT, COLOUR = range(7)


class Rays(NamedTuple):
    """A block of rays (BLOCK,): where they are, where they go, the curve they stand on and the parameter there."""

    x: Floats
    z: Floats
    dx: Floats
    dz: Floats
    last: Tags
    at: Floats


class Found(NamedTuple):
    """What lies ahead of each ray of a block, and room to work in."""

    distance: Floats
    curve: Tags
    place: Floats
    work: Floats
    pick: Tags


class Carried(NamedTuple):
    """What the rays of a block carry (BLOCK,); see `solen.trace.kernel.step.Load`."""

    s: Floats
    p: Floats
    least: Floats
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


class Space(NamedTuple):
    """Room to work in, for N rays."""

    state: Floats
    """(9, BLOCK)"""
    tags: Tags
    """(7, BLOCK)"""
    found: Found
    waiting_state: Floats
    """(capacity, 9) branches that wait"""
    waiting_tags: Tags
    """(capacity, 7)"""
    branches: IntArray
    """(N,) branches of each ray so far; ones to begin with"""


def tag_of(dtype: type[np.floating[Any]]) -> type[np.signedinteger[Any]]:
    """Whole numbers as wide as a floating-point type."""
    return np.int64 if dtype is np.float64 else np.int32


def room_of_block(dtype: type[np.floating[Any]]) -> Found:
    """Room for what lies ahead of the rays of a block."""
    tag = tag_of(dtype)
    return Found(
        np.empty(BLOCK, dtype),
        np.empty(BLOCK, tag),
        np.empty(BLOCK, dtype),
        np.empty((13, BLOCK + 1), dtype),
        np.empty(BLOCK + 1, tag),
    )


def room(rays: int, dtype: type[np.floating[Any]], capacity: int = 64 * BLOCK) -> Space:
    """Room for as many rays and as many waiting branches."""
    return Space(
        np.empty((9, BLOCK), dtype),
        np.empty((7, BLOCK), tag_of(dtype)),
        room_of_block(dtype),
        np.empty((capacity, 9), dtype),
        np.empty((capacity, 7), tag_of(dtype)),
        np.ones(rays, np.int64),
    )

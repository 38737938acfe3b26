"""One ray with all its branches, ray by ray: what adaptive integration looks at, launch angle by launch angle.

The same steps as `solen.trace.kernel.loop`, one ray at a time. The *tree* of a ray is the sequence of interfaces that
it and its branches meet, folded into one number: neighbouring rays of one tree are told apart by nothing but geometry.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.trace.kernel.compiled import called
from solen.trace.kernel.nearest import corner_step, nearest, normal_at, other_side
from solen.trace.kernel.rows import SEGMENT, Floats, Precision
from solen.trace.kernel.surface import COUNT, at_surface, end_fate, scrambled
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON, TRUNCATED
from solen.trace.tables import Tables

STACK = 64
"""Branches that can wait: the weaker of two goes first, so they are at most the logarithm of the least weight."""
WIDTH = 13
LEG_COLUMNS = 5
NO_ROOM = -1


class Family(NamedTuple):
    """Rays of one point source: where it is, its axis in radians, the shares of s and p, how they are followed."""

    x: float
    z: float
    axis: float
    s: float
    p: float
    colour: int
    splitting: int
    min_weight: float
    max_hits: int
    far: float
    """where an escaping ray's last leg ends, mm"""


@called
def trace_tree(  # noqa: C901  one loop, as in `solen.trace.kernel.loop`
    k: Precision,
    tables: Tables,
    family: Family,
    angle: float,
    value: NDArray[np.float64],
    legs: NDArray[np.float64],
    stack: Floats,
) -> tuple[int, np.uint64, bool]:
    """Trace the ray of power 1 at an angle (radians) from the axis.

    ``value`` (D + 2,) becomes its power by receiver, escaped and absorbed; ``legs`` (capacity, 5) the corners of its
    legs: start and end, and 1 where it ends on a curved face. Returns how many legs (−1: no room), its tree, and
    whether a branch was undefined.
    """
    receivers = len(value) - 2
    for d in range(len(value)):
        value[d] = 0.0
    tree, many, waiting, undefined = np.uint64(0), 0, 0, False
    x, z = family.x, family.z
    dx, dz = -math.sin(family.axis + angle), math.cos(family.axis + angle)
    s, p, least = family.s, family.p, family.min_weight * (family.s + family.p)
    region, last, hits, at = -1, -1, 0, k.zero
    running = True
    while True:
        if not running:
            if waiting == 0:
                return many, tree, undefined
            waiting -= 1
            w = stack[waiting]
            x, z, dx, dz, s, p, at = w[0], w[1], w[2], w[3], w[4], w[5], w[6]
            region, last, hits = int(w[7]), int(w[8]), int(w[9])
            running = True
        if many == len(legs):
            return NO_ROOM, tree, undefined
        length, c, place = nearest(k, tables, x, z, dx, dz, last, at)
        power = s + p
        reach = length if c >= 0 else family.far
        px, pz = x + reach * dx, z + reach * dz
        here, there, fate, from_right, nx, nz = -1, -1, ESCAPED, False, k.zero, k.zero
        if c >= 0:
            nx, nz = normal_at(k, tables.kind[c], tables.shape, c, px, pz, place)
            from_right = dx * nx + dz * nz > 0.0
            here = tables.right[c] if from_right else tables.left[c]
            there = tables.left[c] if from_right else tables.right[c]
            stray = region != -1 and region != here
            if length <= k.corner and last >= 0 and (stray or other_side(k, tables, last, at, c, x, z, dx, dz)):
                step = corner_step(k, x, z)
                x, z, last, at = x + step * dx, z + step * dz, c, place
                continue
            fate = TRUNCATED if stray else GOES_ON
            undefined = undefined or stray
        loss = tables.absorption[family.colour, region if c < 0 else here] if max(region, here) >= 0 else k.zero
        kept = k.one
        if family.splitting != COUNT and loss > 0.0 and fate != TRUNCATED:
            kept = math.exp(-loss * length) if c >= 0 else k.zero
            value[receivers + 1] += power * (k.one - kept)
        if fate == GOES_ON:
            worn_out = hits + 1 >= family.max_hits or kept * power < least
            fate = end_fate(tables.behaviour[c], from_right, worn_out)
        legs[many, 0], legs[many, 1], legs[many, 2], legs[many, 3] = x, z, px, pz
        legs[many, 4] = 1.0 if c >= 0 and tables.kind[c] != SEGMENT else 0.0
        many += 1
        owner = tables.owner[c] if c >= 0 else -1
        tree = scrambled(tree ^ np.uint64((owner + 2) * 8 + fate) ^ (np.uint64(hits) << np.uint64(40)))
        s, p = kept * s, kept * p
        if fate != GOES_ON:
            if fate == DETECTED:
                value[tables.receiver[c]] += s + p
            elif fate in (ESCAPED, ABSORBED):
                value[receivers + (0 if fate == ESCAPED else 1)] += s + p
            running = False
            continue
        tx, tz, bx, bz, back_s, back_p = at_surface(
            k, tables.behaviour[c], family.splitting, dx, dz, nx, nz,
            tables.refractive_index[family.colour, here], tables.refractive_index[family.colour, there], s, p,
        )  # fmt: skip
        on_s, on_p = s - back_s, p - back_p
        on, back = on_s + on_p, back_s + back_p
        both = on >= least and back >= least
        if not (on >= least or back >= least):
            running = False
            continue
        goes_back = back <= on if both else back >= least
        if both:
            if waiting == len(stack):
                return NO_ROOM, tree, undefined
            w = stack[waiting]
            w[0], w[1], w[6], w[8], w[9] = px, pz, place, c, hits + 1
            if goes_back:
                w[2], w[3], w[4], w[5], w[7] = tx, tz, on_s, on_p, there
            else:
                w[2], w[3], w[4], w[5], w[7] = bx, bz, back_s, back_p, here
            waiting += 1
            tree = scrambled(tree ^ np.uint64(1 if goes_back else 2))
        if goes_back:
            dx, dz, s, p, region = bx, bz, back_s, back_p, here
        else:
            dx, dz, s, p, region = tx, tz, on_s, on_p, there
        x, z, last, at, hits = px, pz, c, place, hits + 1

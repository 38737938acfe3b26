"""One ray with all its branches, ray by ray: what adaptive integration looks at, launch angle by launch angle.

The steps are those of `solen.trace.kernel.step`, one ray at a time. The *tree* of a ray is the sequence of interfaces
that it and its branches meet, folded into one number: neighbouring rays of one tree differ in nothing but
geometry.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.nearest import nearest
from solen.trace.kernel.rows import SEGMENT, Floats, Precision
from solen.trace.kernel.step import Rules, corner_step, escape, leave, meet
from solen.trace.kernel.surface import scrambled
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON
from solen.trace.tables import Tables

STACK = 64
"""Branches that can wait: the weaker of two goes first, so they are at most the logarithm of the least weight."""
WIDTH = 10
LEG_COLUMNS = 5
NO_ROOM = -1


class Family(NamedTuple):
    """Rays of one point source: where it is, its axis in radians, the shares of s and p, how they are followed.

    They go from the angle ``low`` to ``high``, in radians from the axis; what one carries counts
    (``base`` + ``slope`` angle) cos(angle)^``power`` times.
    """

    x: float
    z: float
    axis: float
    s: float
    p: float
    colour: int
    rules: Rules
    far: float
    """where an escaping ray's last leg ends, mm"""
    low: float
    high: float
    base: float
    slope: float
    power: float


@compiled
def intensity(family: Family, angle: float) -> float:
    """How much the ray at an angle counts."""
    value = family.base + family.slope * angle
    return value if family.power == 0.0 else value * math.cos(angle) ** family.power


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
    s, p, least = family.s, family.p, family.rules.min_weight * (family.s + family.p)
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
        power, owner, bent = s + p, -1, 0.0
        here, there, nx, nz = -1, -1, k.zero, k.zero
        if c < 0:
            _, fate = escape(k, tables, family.rules, region, family.colour)
            px, pz, kept = x + family.far * dx, z + family.far * dz, k.one
        else:
            px, pz, nx, nz, here, there, stray, corner, _, kept, fate = meet(
                k, tables, family.rules, c, length, place, x, z, dx, dz, last, at,
                region, family.colour, hits, power, least,
            )  # fmt: skip
            if corner:
                step = corner_step(k, x, z)
                x, z, last, at = x + step * dx, z + step * dz, c, place
                continue
            undefined = undefined or stray
            owner, bent = tables.owner[c], 0.0 if tables.kind[c] == SEGMENT else 1.0
            value[receivers + 1] += power * (k.one - kept)
        legs[many, 0], legs[many, 1], legs[many, 2], legs[many, 3] = x, z, px, pz
        legs[many, 4] = bent
        many += 1
        tree = scrambled(tree ^ np.uint64((owner + 2) * 8 + fate) ^ (np.uint64(hits) << np.uint64(40)))
        s, p = kept * s, kept * p
        if fate != GOES_ON:
            if fate == DETECTED:
                value[tables.receiver[c]] += s + p
            elif fate in (ESCAPED, ABSORBED):
                value[receivers + (0 if fate == ESCAPED else 1)] += s + p
            running = False
            continue
        tx, tz, on_s, on_p, bx, bz, back_s, back_p, lost, _, both, ends, goes_back = leave(
            k,
            tables,
            family.rules,
            tables.treatments,
            c,
            family.colour,
            here,
            there,
            0,
            hits,
            px,
            pz,
            dx,
            dz,
            nx,
            nz,
            s,
            p,
            least,
        )
        value[receivers + 1] += lost
        if ends:
            running = False
            continue
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

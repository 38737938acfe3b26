"""One ray with all its branches, for adaptive integration over the launch angle.

The steps are those of `solen.trace.kernel.step`, one ray at a time. The *tree* of a ray is the sequence of interfaces
that the ray and its branches meet, hashed into one number: neighbouring rays with equal trees differ only in geometry.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.trace.kernel.compiled import compiled, linked
from solen.trace.kernel.nearest import Ray, nearest
from solen.trace.kernel.rows import SEGMENT, Floats, Precision
from solen.trace.kernel.step import Load, Meeting, Rules, carried_on, escape, leave, meet, part, weakened
from solen.trace.kernel.surface import scrambled
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON
from solen.trace.tables import Tables

STACK = 64
"""Maximum number of waiting branches. The weaker of two branches is followed first, so the number is at most the
logarithm of the inverse minimum weight.
"""
WIDTH = 10
LEG_COLUMNS = 5
NO_ROOM = -1


class Family(NamedTuple):
    """Rays from one point source: position, axis in radians, fractions of s and p, and rules.

    Launch angles are from ``low`` to ``high``, in radians from the axis; the weight of a ray is (``base`` + ``slope``
    angle) cos(angle)^``power``.
    """

    x: float
    z: float
    axis: float
    s: float
    p: float
    colour: int
    rules: Rules
    far: float
    """length of the last leg of an escaping ray, mm"""
    low: float
    high: float
    base: float
    slope: float
    power: float


@compiled
def intensity(family: Family, angle: float) -> float:
    """Weight of the ray at an angle."""
    value = family.base + family.slope * angle
    return value if family.power == 0.0 else value * math.cos(angle) ** family.power


@linked
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

    ``value`` (D + 2,) receives the power at each receiver, followed by the escaped and absorbed power. Each row of
    ``legs`` (capacity, 5) receives the start and end of a leg, and 1 if it ends on a curved face. Returns the number of
    legs (−1 if there is no room), the tree of the ray, and whether a branch was undefined.
    """
    receivers = len(value) - 2
    for d in range(len(value)):
        value[d] = 0.0
    tree, many, waiting, undefined = np.uint64(0), 0, 0, False
    towards = family.axis + angle
    ray = Ray(family.x, family.z, -math.sin(towards), math.cos(towards), -1, k.zero)
    least = family.rules.min_weight * (family.s + family.p)
    load = Load(family.s, family.p, least, 0.0, -1, family.colour, 0, 0)
    running = True
    while True:
        if not running:
            if waiting == 0:
                return many, tree, undefined
            waiting -= 1
            w = stack[waiting]
            ray = Ray(w[0], w[1], w[2], w[3], int(w[8]), w[6])
            load = Load(w[4], w[5], least, 0.0, int(w[7]), family.colour, 0, int(w[9]))
            running = True
        if many == len(legs):
            return NO_ROOM, tree, undefined
        hit, hits = nearest(k, tables, ray), load.hits
        power, owner, bent = load.s + load.p, -1, 0.0
        if hit.curve < 0:
            _, fate = escape(k, tables, family.rules, load.region, family.colour)
            met = Meeting(
                ray.x + family.far * ray.dx, ray.z + family.far * ray.dz, k.zero, k.zero, -1, -1, False, False, k.zero,
                k.one, fate,
            )  # fmt: skip
        else:
            met = meet(k, tables, family.rules, ray, hit, load)
            if met.corner:
                ray = carried_on(k, ray, hit)
                continue
            undefined = undefined or met.undefined
            owner, bent = tables.owner[hit.curve], 0.0 if tables.kind[hit.curve] == SEGMENT else 1.0
            value[receivers + 1] += power * (k.one - met.kept)
        legs[many, 0], legs[many, 1], legs[many, 2], legs[many, 3] = ray.x, ray.z, met.x, met.z
        legs[many, 4] = bent
        many += 1
        tree = scrambled(tree ^ np.uint64((owner + 2) * 8 + met.fate) ^ (np.uint64(hits) << np.uint64(40)))
        load = weakened(load, met.kept, k.zero)
        if met.fate != GOES_ON:
            if met.fate == DETECTED:
                value[tables.receiver[hit.curve]] += load.s + load.p
            elif met.fate in (ESCAPED, ABSORBED):
                value[receivers + (0 if met.fate == ESCAPED else 1)] += load.s + load.p
            running = False
            continue
        gone = leave(k, tables, family.rules, tables.treatments, ray, hit.curve, met, load)
        value[receivers + 1] += gone.lost
        if gone.ends:
            running = False
            continue
        if gone.both:
            if waiting == len(stack):
                return NO_ROOM, tree, undefined
            other, its = part(hit, met, gone.parts, load, not gone.goes_back)
            w = stack[waiting]
            w[0], w[1], w[2], w[3], w[8], w[6] = other
            w[4], w[5], w[7], w[9] = its.s, its.p, its.region, its.hits
            waiting += 1
            tree = scrambled(tree ^ np.uint64(1 if gone.goes_back else 2))
        ray, load = part(hit, met, gone.parts, load, gone.goes_back)

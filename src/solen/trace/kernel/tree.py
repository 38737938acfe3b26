"""One ray with all its branches, for adaptive integration over the launch angle.

The steps are those of `solen.trace.kernel.step`, one ray at a time. The *tree* of a ray is a hash of the sequence of
interfaces that the ray and its branches meet: neighbouring rays with equal trees differ only in geometry.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.trace.kernel.compiled import compiled, linked
from solen.trace.kernel.nearest import Ray, nearest
from solen.trace.kernel.rows import SEGMENT, Floats, Precision
from solen.trace.kernel.step import Arrival, Load, Rules, attenuated, escape, leave, meet, part, past_corner
from solen.trace.kernel.surface import scrambled
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON
from solen.trace.tables import Tables

STACK = 64
"""Maximum number of waiting branches. The weaker of two branches is followed first, so there are at most as many as the
binary logarithm of the inverse minimum weight.
"""
WIDTH = 10
SEGMENT_COLUMNS = 5
NO_ROOM = -1


class Family(NamedTuple):
    """Rays from one point source: position, axis in radians, fractions of s and p, and rules.

    Launch angles extend from ``low`` to ``high``, in radians from the axis; the weight of a ray is (``base`` +
    ``slope`` · angle) cos(angle)^``power``.
    """

    x: float
    z: float
    axis: float
    s: float
    p: float
    colour: int
    rules: Rules
    escape_mm: float
    """length assigned to the last segment of an escaping ray, mm"""
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
    segments: NDArray[np.float64],
    stack: Floats,
) -> tuple[int, np.uint64, bool]:
    """Trace the ray of power 1 at an angle (radians) from the axis.

    ``value`` (D + 2,) receives the power at each receiver, followed by the escaped and absorbed power. Each row of
    ``segments`` (capacity, 5) receives the start and end of a segment, and 1 if it ends on a curved face. Returns the
    number of segments (−1 if there is no room), the tree of the ray, and whether a branch was undefined.
    """
    receivers = len(value) - 2
    for d in range(len(value)):
        value[d] = 0.0
    tree, count, waiting, undefined = np.uint64(0), 0, 0, False
    towards = family.axis + angle
    ray = Ray(family.x, family.z, -math.sin(towards), math.cos(towards), -1, k.zero)
    min_power = family.rules.min_weight * (family.s + family.p)
    load = Load(family.s, family.p, min_power, 0.0, -1, family.colour, 0, 0)
    running = True
    while True:
        if not running:
            if waiting == 0:
                return count, tree, undefined
            waiting -= 1
            w = stack[waiting]
            ray = Ray(w[0], w[1], w[2], w[3], int(w[8]), w[6])
            load = Load(w[4], w[5], min_power, 0.0, int(w[7]), family.colour, 0, int(w[9]))
            running = True
        if count == len(segments):
            return NO_ROOM, tree, undefined
        hit, hits = nearest(k, tables, ray), load.hits
        power, owner, on_curve = load.s + load.p, -1, 0.0
        if hit.curve < 0:
            _, fate = escape(k, tables, family.rules, load.region, family.colour)
            x, z = ray.x + family.escape_mm * ray.dx, ray.z + family.escape_mm * ray.dz
            arrival = Arrival(x, z, k.zero, k.zero, -1, -1, False, False, k.zero, k.one, fate)
        else:
            arrival = meet(k, tables, family.rules, ray, hit, load)
            if arrival.corner:
                ray = past_corner(k, ray, hit)
                continue
            undefined = undefined or arrival.undefined
            owner, on_curve = tables.owner[hit.curve], 0.0 if tables.kind[hit.curve] == SEGMENT else 1.0
            value[receivers + 1] += power * (k.one - arrival.kept)
        segments[count, 0], segments[count, 1], segments[count, 2], segments[count, 3] = (
            ray.x,
            ray.z,
            arrival.x,
            arrival.z,
        )
        segments[count, 4] = on_curve
        count += 1
        tree = scrambled(tree ^ np.uint64((owner + 2) * 8 + arrival.fate) ^ (np.uint64(hits) << np.uint64(40)))
        load = attenuated(load, arrival.kept, k.zero)
        if arrival.fate != GOES_ON:
            if arrival.fate == DETECTED:
                value[tables.receiver[hit.curve]] += load.s + load.p
            elif arrival.fate in (ESCAPED, ABSORBED):
                value[receivers + (0 if arrival.fate == ESCAPED else 1)] += load.s + load.p
            running = False
            continue
        departure = leave(k, tables, family.rules, tables.treatments, ray, hit.curve, arrival, load)
        value[receivers + 1] += departure.absorbed
        if departure.ends:
            running = False
            continue
        if departure.both:
            if waiting == len(stack):
                return NO_ROOM, tree, undefined
            other, other_load = part(hit, arrival, departure.parts, load, not departure.reflected_first)
            w = stack[waiting]
            w[0], w[1], w[2], w[3], w[8], w[6] = other
            w[4], w[5], w[7], w[9] = other_load.s, other_load.p, other_load.region, other_load.hits
            waiting += 1
            tree = scrambled(tree ^ np.uint64(1 if departure.reflected_first else 2))
        ray, load = part(hit, arrival, departure.parts, load, departure.reflected_first)

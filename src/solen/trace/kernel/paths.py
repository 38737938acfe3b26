"""The integral of what a ray gives along a path of one parameter, in space: adaptive, with its edges found by secants.

Between two rays of one tree the powers are smooth: Simpson's rule serves, checked against the trapezium. Where trees
differ there is an edge. It is where the beam passes an end of a curve, at a leg that begins alike for both rays: the
secant of the distance to that end predicts it, and two rays about the prediction confirm it. Equal trees prove nothing:
a strip of other light may lie between. So a ray is traced at every end that the beam passes, of trees that are equal
too.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.adapt import holds
from solen.trace.kernel.compiled import called, compiled, linked
from solen.trace.kernel.family import FamilyInSpace, Heading, heading
from solen.trace.kernel.nearest import Walls
from solen.trace.kernel.prism import NO_DRAW, STACK_IN_SPACE, WIDTH_IN_SPACE, trace_prism
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.space import Vector

MOST_LEGS = 300
"""Straight stretches of one ray with its branches, after which what goes on is left to the tail."""
FIRST, FIRST_ANGLES = 2, 32
"""Stretches that a path begins with: over the places of a chip, over the angles of a point."""


class PathRoom(NamedTuple):
    """Room for the rays of one path (N,) and for the stretches that wait."""

    u: FloatArray
    start: FloatArray
    """(N, 5) x, z and the direction x, y, z"""
    tree: NDArray[np.uint64]
    path: NDArray[np.uint64]
    value: FloatArray
    """(N, D + 5) weighed powers"""
    first: IntArray
    many: IntArray
    legs: FloatArray
    waiting: IntArray
    """(room, 2)"""
    stack: Floats
    counts: IntArray
    """(4,) rays, legs, undefined, kept legs"""


KEPT_RAYS, KEPT_LEGS, KEPT_STRETCHES = 4096, 400_000, 2048


def path_room(columns: int) -> PathRoom:
    """New room; untouched memory costs nothing."""
    n = KEPT_RAYS
    return PathRoom(
        u=np.empty(n),
        start=np.empty((n, 5)),
        tree=np.empty(n, np.uint64),
        path=np.empty(n, np.uint64),
        value=np.empty((n, columns)),
        first=np.empty(n, np.int64),
        many=np.empty(n, np.int64),
        legs=np.empty((KEPT_LEGS, 6)),
        waiting=np.empty((KEPT_STRETCHES, 2), np.int64),
        stack=np.empty((STACK_IN_SPACE, WIDTH_IN_SPACE)),
        counts=np.zeros(4, np.int64),
    )


@linked
def trace_rays(
    k: Precision,
    walls: Walls,
    family: FamilyInSpace,
    room: PathRoom,
    low: int,
    high: int,
    draw: int,
    most_hits: int,
) -> None:
    """Trace the rays from number ``low`` to ``high``, whose starts are in the room.

    With a ``draw``, the number of the first ray's sample, their tails alone.
    """
    for n in range(low, high):
        first = room.counts[3]
        x, z = room.start[n, 0], room.start[n, 1]
        d = Vector(room.start[n, 2], room.start[n, 3], room.start[n, 4])
        sample = draw + n - low if draw >= 0 else NO_DRAW
        many, tree, path, undefined = trace_prism(
            k,
            walls,
            family,
            x,
            z,
            d,
            sample,
            most_hits,
            MOST_LEGS,
            room.value[n],
            room.legs[first:],
            room.stack,
        )
        room.counts[0] += 1
        room.counts[1] += many
        room.counts[2] += 1 if undefined else 0
        room.counts[3] += many if draw < 0 else 0
        room.tree[n], room.path[n], room.first[n], room.many[n] = tree, path, first, many


@compiled
def add_rays(
    k: Precision, walls: Walls, family: FamilyInSpace, room: PathRoom, along: Heading, low: int, high: int
) -> None:
    """Trace the rays at the parameters that the room names from ``low`` to ``high``; ``along`` is where paths go."""
    turns = family.turn != 0.0
    for n in range(low, high):
        u = room.u[n]
        d = heading(family, u).d if turns else along.d
        room.start[n, 0], room.start[n, 1] = family.x + u * family.along_x, family.z + u * family.along_z
        room.start[n, 2], room.start[n, 3], room.start[n, 4] = d.x, d.y, d.z
    trace_rays(k, walls, family, room, low, high, NO_DRAW, 0)
    for n in range(low, high):
        weight = heading(family, room.u[n]).weight if turns else along.weight
        for column in range(room.value.shape[1]):
            room.value[n, column] *= weight


@called
def sample_tails(
    k: Precision,
    walls: Walls,
    family: FamilyInSpace,
    starts: FloatArray,
    first: int,
    most_hits: int,
    room: PathRoom,
    total: FloatArray,
) -> int:
    """Sum of the tails (D + 5,) of rays that start at ``starts`` (N, 5): x, z and the direction x, y, z.

    They are samples from the number ``first`` on. Returns how many straight stretches that took.
    """
    before, done = room.counts[1], 0
    room.counts[3] = 0
    while done < len(starts):
        many = min(len(starts) - done, len(room.u))
        for n in range(many):
            for column in range(5):
                room.start[n, column] = starts[done + n, column]
        trace_rays(k, walls, family, room, 0, many, first + done, most_hits)
        for n in range(many):
            for column in range(len(total)):
                total[column] += room.value[n, column]
        done += many
    steps: int = room.counts[1] - before
    return steps


@compiled
def passed(
    ends: FloatArray, ax: float, az: float, ux: float, uz: float, bx: float, bz: float, vx: float, vz: float
) -> int:
    """How many ends lie between the lines of two legs, ahead or behind: a loop without branches, as there are few."""
    many = 0
    for e in range(ends.shape[1]):
        px, pz = ends[0, e], ends[1, e]
        one, two = ux * (pz - az) - uz * (px - ax), vx * (pz - bz) - vz * (px - bx)
        many += (one > 0.0) != (two > 0.0)
    return many


@linked
def predicted_edge(room: PathRoom, i: int, j: int, ends: FloatArray) -> float:
    """Share of the stretch at which the beam between two rays passes an end of a curve; −1 where none is seen."""
    legs = room.legs
    for leg in range(min(room.many[i], room.many[j])):
        a, b = room.first[i] + leg, room.first[j] + leg
        ax, az, dx, dz = legs[a, 0], legs[a, 1], legs[b, 0], legs[b, 1]
        ux, uz, vx, vz = legs[a, 2] - ax, legs[a, 3] - az, legs[b, 2] - dx, legs[b, 3] - dz
        best, share, alike = math.inf, -1.0, legs[a, 5] == legs[b, 5]
        for e in range(ends.shape[1] if passed(ends, ax, az, ux, uz, dx, dz, vx, vz) > 0 else 0):
            px, pz = ends[0, e], ends[1, e]
            one = ux * (pz - az) - uz * (px - ax)
            two = vx * (pz - dz) - vz * (px - dx)
            ahead = ux * (px - ax) + uz * (pz - az)
            if not ((one > 0.0) != (two > 0.0) and ahead > 0.0):
                continue
            if alike and not holds(ax, az, legs[a, 2], legs[a, 3], legs[b, 2], legs[b, 3], dx, dz, px, pz):
                continue
            one /= math.sqrt(ux * ux + uz * uz)
            two /= math.sqrt(vx * vx + vz * vz)
            if ahead < best:
                best, share = ahead, one / (one - two)
        if share >= 0.0:
            return share
        if not alike:
            return -1.0
    return -1.0


@linked
def integrate_path(  # noqa: C901  one loop over stretches
    k: Precision,
    walls: Walls,
    family: FamilyInSpace,
    room: PathRoom,
    ends: FloatArray,
    first: int,
    density: float,
    narrow: float,
    soft: float,
    total: FloatArray,
) -> float:
    """Integral of the powers from ``family.low`` to ``family.high``, into ``total`` (D + 5,).

    The path begins as ``first`` stretches. ``density`` is the error allowed per parameter; a stretch is left at a width
    of ``narrow``, and not searched for hidden edges from ``soft`` on. Where the room ends the mean of what is known
    stands for the rest. Returns what the integral may be off by.
    """
    low, high = family.low, family.high
    n, waiting, error, columns = 0, 0, 0.0, len(total)
    room.counts[3] = 0
    for d in range(columns):
        total[d] = 0.0
    along = heading(family, low)
    for s in range(first + 1):
        room.u[s] = low + (high - low) * s / first
    add_rays(k, walls, family, room, along, 0, first + 1)
    n = first + 1
    for s in range(first):
        room.waiting[waiting, 0], room.waiting[waiting, 1] = s, s + 1
        waiting += 1
    while waiting > 0:
        waiting -= 1
        i, j = room.waiting[waiting, 0], room.waiting[waiting, 1]
        a, b = room.u[i], room.u[j]
        width = b - a
        hard = room.tree[i] != room.tree[j]
        full = n + 2 > len(room.u) or waiting + 4 > len(room.waiting)
        full = full or room.counts[3] + 2 * MOST_LEGS > len(room.legs)
        if full or width <= narrow:
            apart = 0.0
            for d in range(columns):
                total[d] += 0.5 * width * (room.value[i, d] + room.value[j, d])
                apart = max(apart, abs(room.value[i, d] - room.value[j, d]))
            error += (0.5 if full else 0.25) * width * apart
            continue
        edge = a + predicted_edge(room, i, j, ends) * width if hard or width > soft else a
        seen, m = edge - narrow > a and edge + narrow < b, n
        if seen and hard:
            room.u[n], room.u[n + 1] = edge - 0.45 * narrow, edge + 0.45 * narrow
            n += 2
        else:  # where rays on both sides are alike: is the one at the edge between them?
            room.u[n] = edge if seen else 0.5 * (a + b)
            n += 1
        add_rays(k, walls, family, room, along, m, n)
        if seen and hard:
            room.waiting[waiting, 0], room.waiting[waiting, 1] = i, m
            room.waiting[waiting + 1, 0], room.waiting[waiting + 1, 1] = m, m + 1
            room.waiting[waiting + 2, 0], room.waiting[waiting + 2, 1] = m + 1, j
            waiting += 3
            continue
        if (
            room.tree[m] == room.tree[i]
            and not hard
            and not seen
            and (width <= soft or (room.path[m] == room.path[i] and room.path[m] == room.path[j]))
        ):
            apart = 0.0
            for d in range(columns):
                apart = max(apart, abs(room.value[i, d] - 2.0 * room.value[m, d] + room.value[j, d]))
            if apart <= 6.0 * density:
                for d in range(columns):
                    total[d] += width / 6.0 * (room.value[i, d] + 4.0 * room.value[m, d] + room.value[j, d])
                error += width * apart / 30.0
                continue
        room.waiting[waiting, 0], room.waiting[waiting, 1] = i, m
        room.waiting[waiting + 1, 0], room.waiting[waiting + 1, 1] = m, j
        waiting += 2
    return error

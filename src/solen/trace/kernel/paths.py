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
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.prism import (
    NO_DRAW,
    STACK_IN_SPACE,
    WIDTH_IN_SPACE,
    FamilyInSpace,
    intensity_in_space,
    trace_prism,
)
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.space import Vector
from solen.trace.tables import Tables

MOST_LEGS = 300
"""Straight stretches of one ray with its branches, after which what goes on is left to the tail."""
FIRST, FIRST_ANGLES = 2, 32
"""Stretches that a path begins with: over the places of a chip, over the angles of a point."""


class PathRoom(NamedTuple):
    """Room for the rays of one path (N,) and for the stretches that wait."""

    u: FloatArray
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


@compiled
def start(family: FamilyInSpace, u: float) -> tuple[float, float, Vector]:
    """Place and direction of the ray at a parameter."""
    angle = family.axis + family.angle + u * family.turn
    flat = math.sqrt(1.0 - family.rise * family.rise)
    d = Vector(-flat * math.sin(angle), family.rise, flat * math.cos(angle))
    return family.x + u * family.along_x, family.z + u * family.along_z, d


@compiled
def add_ray(k: Precision, tables: Tables, family: FamilyInSpace, room: PathRoom, n: int, u: float) -> None:
    """Trace the ray at a parameter and keep it as number n."""
    first = room.counts[3]
    x, z, d = start(family, u)
    many, tree, path, undefined = trace_prism(
        k, tables, family, x, z, d, NO_DRAW, 0, MOST_LEGS, room.value[n], room.legs[first:], room.stack
    )
    room.counts[0] += 1
    room.counts[1] += many
    room.counts[2] += 1 if undefined else 0
    room.counts[3] += many
    weight = intensity_in_space(family, u)
    for column in range(room.value.shape[1]):
        room.value[n, column] *= weight
    room.u[n], room.tree[n], room.path[n], room.first[n], room.many[n] = u, tree, path, first, many


@called
def sample_tails(
    k: Precision,
    tables: Tables,
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
    steps = 0
    for i in range(len(starts)):
        d = Vector(starts[i, 2], starts[i, 3], starts[i, 4])
        many, _, _, _ = trace_prism(
            k, tables, family, starts[i, 0], starts[i, 1], d, first + i, most_hits, MOST_LEGS, room.value[0],
            room.legs, room.stack,
        )  # fmt: skip
        steps += many
        for column in range(len(total)):
            total[column] += room.value[0, column]
    return steps


@compiled
def passed(
    ends: FloatArray, ax: float, az: float, ux: float, uz: float, bx: float, bz: float, vx: float, vz: float
) -> int:
    """How many ends lie between the lines of two legs, ahead or behind: a loop without branches, as there are few."""
    many = 0
    for e in range(len(ends)):
        px, pz = ends[e, 0], ends[e, 1]
        one, two = ux * (pz - az) - uz * (px - ax), vx * (pz - bz) - vz * (px - bx)
        many += (one > 0.0) != (two > 0.0)
    return many


@called
def predicted_edge(room: PathRoom, i: int, j: int, ends: FloatArray) -> float:
    """Share of the stretch at which the beam between two rays passes an end of a curve; −1 where none is seen."""
    legs = room.legs
    for leg in range(min(room.many[i], room.many[j])):
        a, b = room.first[i] + leg, room.first[j] + leg
        ax, az, dx, dz = legs[a, 0], legs[a, 1], legs[b, 0], legs[b, 1]
        ux, uz, vx, vz = legs[a, 2] - ax, legs[a, 3] - az, legs[b, 2] - dx, legs[b, 3] - dz
        best, share, alike = math.inf, -1.0, legs[a, 5] == legs[b, 5]
        for e in range(len(ends) if passed(ends, ax, az, ux, uz, dx, dz, vx, vz) > 0 else 0):
            px, pz = ends[e, 0], ends[e, 1]
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


@called
def integrate_path(  # noqa: C901  one loop over stretches
    k: Precision,
    tables: Tables,
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
    for s in range(first + 1):
        add_ray(k, tables, family, room, n, low + (high - low) * s / first)
        n += 1
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
        middle, halved = 0.5 * (a + b), True
        if hard or width > soft:
            edge = a + predicted_edge(room, i, j, ends) * width
            if edge - narrow > a and edge + narrow < b:
                if not hard:  # rays on both sides are alike: is the one between them?
                    middle, halved = edge, False
                else:
                    add_ray(k, tables, family, room, n, edge - 0.45 * narrow)
                    add_ray(k, tables, family, room, n + 1, edge + 0.45 * narrow)
                    room.waiting[waiting, 0], room.waiting[waiting, 1] = i, n
                    room.waiting[waiting + 1, 0], room.waiting[waiting + 1, 1] = n, n + 1
                    room.waiting[waiting + 2, 0], room.waiting[waiting + 2, 1] = n + 1, j
                    n, waiting = n + 2, waiting + 3
                    continue
        add_ray(k, tables, family, room, n, middle)
        m = n
        n += 1
        if (
            room.tree[m] == room.tree[i]
            and not hard
            and halved
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


@compiled
def at_angles(family: FamilyInSpace, angle: float, turn: float, rise: float, low: float, high: float) -> FamilyInSpace:
    """The family along another path."""
    f = family
    return FamilyInSpace(
        f.x, f.z, f.along_x, f.along_z, f.axis, angle, turn, rise, f.y_low, f.y_high, f.s, f.p, f.colour, f.rules,
        f.far, f.half, f.above, f.below, low, high, f.power, f.theta, f.relative,
    )  # fmt: skip


@called
def over_nodes(
    k: Precision,
    tables: Tables,
    family: FamilyInSpace,
    room: PathRoom,
    ends: FloatArray,
    cone: tuple[float, float],
    point: bool,
    q: FloatArray,
    t: FloatArray,
    wanted: NDArray[np.bool_],
    steps: tuple[float, float, float],
    total: FloatArray,
    grid: FloatArray,
) -> None:
    """Integrals over the places of a chip at angles ``q`` (Q,) and ``t`` (T,), where ``wanted`` (T, Q).

    The angle out of the plane is asin(sine sin t), the one in projection a share q of the largest within the ``cone``
    (cosine, sine) there. Of a ``point``, whose path is that angle, ``q`` (1,) is nothing. ``steps`` are density, narrow
    and soft of `integrate_path`, ``grid`` (T, Q, D + 6) becomes the integrals and, last, what they may be off by.
    """
    for i in range(len(t)):
        rise = cone[1] * math.sin(t[i])
        most = math.acos(min(max(cone[0] / math.sqrt(1.0 - rise * rise), -1.0), 1.0))
        weight = (1.0 if point else most) * cone[1] * math.cos(t[i])
        for j in range(len(q)):
            if not wanted[i, j]:
                continue
            if point:
                here, first = at_angles(family, 0.0, 1.0, rise, -most, most), FIRST_ANGLES
            else:
                here, first = at_angles(family, most * q[j], 0.0, rise, family.low, family.high), FIRST
            error = integrate_path(k, tables, here, room, ends, first, steps[0], steps[1], steps[2], total)
            for d in range(len(total)):
                grid[i, j, d] = weight * total[d]
            grid[i, j, len(total)] = weight * error

"""The integral of what a ray gives along a path of one parameter, in space: adaptive, with its edges found by secants.

Between two rays of one tree the powers are smooth: Simpson's rule serves, checked against the trapezium. Where trees
differ there is an edge. It is where the beam passes an end of a curve, at a leg that begins alike for both rays: the
secant of the distance to that end predicts it, and two rays about the prediction confirm it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.adapt import holds
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.prism import FamilyInSpace, intensity_in_space, trace_prism
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.tree import NO_ROOM
from solen.trace.tables import Tables

MOST_LEGS = 300
"""Straight stretches of one ray with its branches, after which it counts as trapped."""
FIRST, FIRST_ANGLES = 2, 32
"""Stretches that a path begins with: over the places of a chip, over the angles of a point."""


class PathRoom(NamedTuple):
    """Room for the rays of one path (N,) and for the stretches that wait."""

    u: FloatArray
    tree: NDArray[np.uint64]
    path: NDArray[np.uint64]
    value: FloatArray
    """(N, D + 4) weighed powers"""
    first: IntArray
    many: IntArray
    legs: FloatArray
    waiting: IntArray
    """(room, 2)"""
    stack: Floats
    counts: IntArray
    """(4,) rays, legs, undefined, kept legs"""


@called
def add_ray(k: Precision, tables: Tables, family: FamilyInSpace, room: PathRoom, n: int, u: float) -> bool:
    """Trace the ray at a parameter and keep it as number n; False where there is no room."""
    first = room.counts[3]
    legs = room.legs[first : first + MOST_LEGS]
    many, tree, path, undefined = trace_prism(k, tables, family, u, room.value[n], legs, room.stack)
    room.counts[0] += 1
    if many == NO_ROOM:
        return False
    room.counts[1] += many
    room.counts[2] += 1 if undefined else 0
    room.counts[3] += many
    weight = intensity_in_space(family, u)
    for d in range(room.value.shape[1]):
        room.value[n, d] *= weight
    room.u[n], room.tree[n], room.path[n], room.first[n], room.many[n] = u, tree, path, first, many
    return True


@called
def is_clear(room: PathRoom, i: int, j: int, ends: FloatArray) -> bool:
    """Whether two rays have one path, and no curve ends in the beam between them."""
    if room.path[i] != room.path[j] or room.many[i] != room.many[j]:
        return False
    legs = room.legs
    for leg in range(room.many[i]):
        a, b = room.first[i] + leg, room.first[j] + leg
        ax, az, bx, bz = legs[a, 0], legs[a, 1], legs[a, 2], legs[a, 3]
        cx, cz, dx, dz = legs[b, 2], legs[b, 3], legs[b, 0], legs[b, 1]
        x_low, x_high = min(min(ax, bx), min(cx, dx)), max(max(ax, bx), max(cx, dx))
        z_low, z_high = min(min(az, bz), min(cz, dz)), max(max(az, bz), max(cz, dz))
        for e in range(len(ends)):
            px, pz = ends[e, 0], ends[e, 1]
            if px < x_low or px > x_high or pz < z_low or pz > z_high:
                continue
            if holds(ax, az, bx, bz, cx, cz, dx, dz, px, pz):
                return False
    return True


@called
def predicted_edge(room: PathRoom, i: int, j: int, ends: FloatArray) -> float:
    """Share of the stretch at which the beam between two rays passes an end of a curve; −1 where none is seen."""
    legs = room.legs
    for leg in range(min(room.many[i], room.many[j])):
        a, b = room.first[i] + leg, room.first[j] + leg
        ax, az, dx, dz = legs[a, 0], legs[a, 1], legs[b, 0], legs[b, 1]
        ux, uz, vx, vz = legs[a, 2] - ax, legs[a, 3] - az, legs[b, 2] - dx, legs[b, 3] - dz
        best, share = math.inf, -1.0
        for e in range(len(ends)):
            px, pz = ends[e, 0], ends[e, 1]
            one = ux * (pz - az) - uz * (px - ax)
            two = vx * (pz - dz) - vz * (px - dx)
            ahead = ux * (px - ax) + uz * (pz - az)
            if not ((one > 0.0) != (two > 0.0) and ahead > 0.0):
                continue
            alike = legs[a, 5] == legs[b, 5]
            if alike and not holds(ax, az, legs[a, 2], legs[a, 3], legs[b, 2], legs[b, 3], dx, dz, px, pz):
                continue
            one /= math.sqrt(ux * ux + uz * uz)
            two /= math.sqrt(vx * vx + vz * vz)
            if ahead < best:
                best, share = ahead, one / (one - two)
        if share >= 0.0:
            return share
        if legs[a, 5] != legs[b, 5]:
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
) -> tuple[float, bool]:
    """Integral of the powers from ``family.low`` to ``family.high``, into ``total`` (D + 4,).

    The path begins as ``first`` stretches. ``density`` is the error allowed per parameter; an edge is left at a width
    of ``narrow``, and a stretch that may hide one, its rays' paths being different, at ``soft``. Returns what it may be
    off by, and whether it came to its end: else the mean of what is known stands for the rest.
    """
    low, high = family.low, family.high
    n, waiting, error, whole, columns = 0, 0, 0.0, True, len(total)
    room.counts[3] = 0
    for d in range(columns):
        total[d] = 0.0
    for s in range(first + 1):
        if not add_ray(k, tables, family, room, n, low + (high - low) * s / first):
            return math.inf, False
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
        done = hard and width <= narrow
        full = n + 2 > len(room.u) or waiting + 4 > len(room.waiting)
        if done or full:
            apart = 0.0
            for d in range(columns):
                total[d] += 0.5 * width * (room.value[i, d] + room.value[j, d])
                apart = max(apart, abs(room.value[i, d] - room.value[j, d]))
            error += 0.25 * width * apart
            whole = whole and done
            continue
        if hard:
            share = predicted_edge(room, i, j, ends)
            if 0.0 <= share <= 1.0:
                edge = a + share * width
                left, right = max(edge - 0.45 * narrow, a), min(edge + 0.45 * narrow, b)
                m = i
                if left > a:
                    if not add_ray(k, tables, family, room, n, left):
                        return math.inf, False
                    m = n
                    n += 1
                    room.waiting[waiting, 0], room.waiting[waiting, 1] = i, m
                    waiting += 1
                if right < b:
                    if not add_ray(k, tables, family, room, n, right):
                        return math.inf, False
                    room.waiting[waiting, 0], room.waiting[waiting, 1] = m, n
                    room.waiting[waiting + 1, 0], room.waiting[waiting + 1, 1] = n, j
                    waiting += 2
                    n += 1
                else:
                    room.waiting[waiting, 0], room.waiting[waiting, 1] = m, j
                    waiting += 1
                continue
        if not add_ray(k, tables, family, room, n, 0.5 * (a + b)):
            return math.inf, False
        m = n
        n += 1
        if (
            room.tree[m] == room.tree[i]
            and not hard
            and (width <= soft or (is_clear(room, i, m, ends) and is_clear(room, m, j, ends)))
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
    return error, whole


@compiled
def at_angles(family: FamilyInSpace, angle: float, turn: float, rise: float, low: float, high: float) -> FamilyInSpace:
    """The family along another path."""
    f = family
    return FamilyInSpace(
        f.x, f.z, f.along_x, f.along_z, f.axis, angle, turn, rise, f.y_low, f.y_high, f.s, f.p, f.colour, f.rules,
        f.far, f.half, f.above, f.below, low, high, f.power, f.theta, f.relative,
    )  # fmt: skip


@called
def over_places(
    k: Precision,
    tables: Tables,
    family: FamilyInSpace,
    room: PathRoom,
    ends: FloatArray,
    cone: tuple[float, float],
    nodes: FloatArray,
    cell: FloatArray,
    steps: tuple[float, float, float],
    total: FloatArray,
    grid: FloatArray,
) -> tuple[float, bool]:
    """Integrals over the places of a chip at the nodes of a ``cell`` of angles: ``grid`` (N, N, D + 4).

    The angle out of the plane is asin(sine sin t), the one in projection a share q of the largest within the ``cone``
    (cosine, sine) there; a cell reaches from q to q, from t to t. ``steps`` are density, narrow and soft of
    `integrate_path`. Returns the root of the sum of squares of their errors, and whether all came to their ends.
    """
    off = 0.0
    for i in range(len(nodes)):
        t = 0.5 * (cell[2] + cell[3]) + 0.5 * (cell[3] - cell[2]) * nodes[i]
        rise = cone[1] * math.sin(t)
        most = math.acos(min(max(cone[0] / math.sqrt(1.0 - rise * rise), -1.0), 1.0))
        weight = most * cone[1] * math.cos(t)
        for j in range(len(nodes)):
            q = 0.5 * (cell[0] + cell[1]) + 0.5 * (cell[1] - cell[0]) * nodes[j]
            here = at_angles(family, most * q, 0.0, rise, family.low, family.high)
            error, ended = integrate_path(k, tables, here, room, ends, FIRST, steps[0], steps[1], steps[2], total)
            for d in range(len(total)):
                grid[i, j, d] = weight * total[d]
            if not ended:
                return math.inf, False
            off += (weight * error) ** 2
    return math.sqrt(off), True


@called
def over_angles(
    k: Precision,
    tables: Tables,
    family: FamilyInSpace,
    room: PathRoom,
    ends: FloatArray,
    cone: tuple[float, float],
    nodes: FloatArray,
    cell: FloatArray,
    steps: tuple[float, float, float],
    total: FloatArray,
    grid: FloatArray,
) -> tuple[float, bool]:
    """Integrals over the angles in projection of a point at the nodes between two t: ``grid`` (N, D + 4); see above."""
    off = 0.0
    for i in range(len(nodes)):
        t = 0.5 * (cell[0] + cell[1]) + 0.5 * (cell[1] - cell[0]) * nodes[i]
        rise = cone[1] * math.sin(t)
        most = math.acos(min(max(cone[0] / math.sqrt(1.0 - rise * rise), -1.0), 1.0))
        here = at_angles(family, 0.0, 1.0, rise, -most, most)
        error, ended = integrate_path(k, tables, here, room, ends, FIRST_ANGLES, steps[0], steps[1], steps[2], total)
        weight = cone[1] * math.cos(t)
        for d in range(len(total)):
            grid[i, d] = weight * total[d]
        if not ended:
            return math.inf, False
        off += (weight * error) ** 2
    return math.sqrt(off), True

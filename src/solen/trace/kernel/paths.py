"""Integrals of ray powers along a one-parameter path in space: adaptive, with edges located by the secant method.

Between two rays with equal trees the powers are smooth: Simpson's rule is used, with the trapezoidal rule as a check.
Between different trees there is an edge, where the beam passes the end of a curve on a leg that starts on the same
curve for both rays. The secant of the distance to that end predicts the edge, and two rays around the prediction
confirm it. Equal trees prove nothing, because a strip of other light may lie in between. A ray is therefore also traced
at each curve end that a beam between equal trees passes.
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

MAX_LEGS = 300
"""Maximum number of legs of one ray with its branches, after which its remaining power is left to the tail."""
FIRST, FIRST_ANGLES = 2, 32
"""Initial number of intervals in a path: over the positions on a chip, over the angles of a point."""


class PathBuffers(NamedTuple):
    """Working memory for the rays of one path (N,) and for the waiting intervals."""

    u: FloatArray
    start: FloatArray
    """(N, 5) start x, z and direction x, y, z"""
    tree: NDArray[np.uint64]
    path: NDArray[np.uint64]
    value: FloatArray
    """(N, D + 5) weighted powers"""
    first: IntArray
    many: IntArray
    legs: FloatArray
    waiting: IntArray
    """(capacity, 2)"""
    stack: Floats
    counts: IntArray
    """(4,) numbers of rays, legs, undefined rays and stored legs"""


KEPT_RAYS, KEPT_LEGS, KEPT_INTERVALS = 4096, 400_000, 2048


def path_buffers(columns: int) -> PathBuffers:
    """Allocate memory for a path; unused pages do not occupy physical memory."""
    n = KEPT_RAYS
    return PathBuffers(
        u=np.empty(n),
        start=np.empty((n, 5)),
        tree=np.empty(n, np.uint64),
        path=np.empty(n, np.uint64),
        value=np.empty((n, columns)),
        first=np.empty(n, np.int64),
        many=np.empty(n, np.int64),
        legs=np.empty((KEPT_LEGS, 6)),
        waiting=np.empty((KEPT_INTERVALS, 2), np.int64),
        stack=np.empty((STACK_IN_SPACE, WIDTH_IN_SPACE)),
        counts=np.zeros(4, np.int64),
    )


@linked
def trace_rays(
    k: Precision,
    walls: Walls,
    family: FamilyInSpace,
    buffers: PathBuffers,
    low: int,
    high: int,
    draw: int,
    most_hits: int,
) -> None:
    """Trace rays number ``low`` to ``high`` from their stored starting points.

    With ``draw``, the sample number of the first ray, only the tails of the rays are traced.
    """
    for n in range(low, high):
        first = buffers.counts[3]
        x, z = buffers.start[n, 0], buffers.start[n, 1]
        d = Vector(buffers.start[n, 2], buffers.start[n, 3], buffers.start[n, 4])
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
            MAX_LEGS,
            buffers.value[n],
            buffers.legs[first:],
            buffers.stack,
        )
        buffers.counts[0] += 1
        buffers.counts[1] += many
        buffers.counts[2] += 1 if undefined else 0
        buffers.counts[3] += many if draw < 0 else 0
        buffers.tree[n], buffers.path[n], buffers.first[n], buffers.many[n] = tree, path, first, many


@compiled
def add_rays(
    k: Precision, walls: Walls, family: FamilyInSpace, buffers: PathBuffers, along: Heading, low: int, high: int
) -> None:
    """Trace the rays at the stored parameters from ``low`` to ``high``, along ``along`` if the angle is constant."""
    turns = family.turn != 0.0
    for n in range(low, high):
        u = buffers.u[n]
        d = heading(family, u).d if turns else along.d
        buffers.start[n, 0], buffers.start[n, 1] = family.x + u * family.along_x, family.z + u * family.along_z
        buffers.start[n, 2], buffers.start[n, 3], buffers.start[n, 4] = d.x, d.y, d.z
    trace_rays(k, walls, family, buffers, low, high, NO_DRAW, 0)
    for n in range(low, high):
        weight = heading(family, buffers.u[n]).weight if turns else along.weight
        for column in range(buffers.value.shape[1]):
            buffers.value[n, column] *= weight


@called
def sample_tails(
    k: Precision,
    walls: Walls,
    family: FamilyInSpace,
    starts: FloatArray,
    first: int,
    most_hits: int,
    buffers: PathBuffers,
    total: FloatArray,
) -> int:
    """Add the tails (D + 5,) of rays with the given ``starts`` (N, 5): x, z and the direction x, y, z.

    Their sample numbers begin at ``first``. Returns the number of legs traced.
    """
    before, done = buffers.counts[1], 0
    buffers.counts[3] = 0
    while done < len(starts):
        many = min(len(starts) - done, len(buffers.u))
        for n in range(many):
            for column in range(5):
                buffers.start[n, column] = starts[done + n, column]
        trace_rays(k, walls, family, buffers, 0, many, first + done, most_hits)
        for n in range(many):
            for column in range(len(total)):
                total[column] += buffers.value[n, column]
        done += many
    steps: int = buffers.counts[1] - before
    return steps


@compiled
def passed(
    ends: FloatArray, ax: float, az: float, ux: float, uz: float, bx: float, bz: float, vx: float, vz: float
) -> int:
    """Number of curve ends between the lines of two legs, ahead or behind, counted in a branch-free loop."""
    many = 0
    for e in range(ends.shape[1]):
        px, pz = ends[0, e], ends[1, e]
        one, two = ux * (pz - az) - uz * (px - ax), vx * (pz - bz) - vz * (px - bx)
        many += (one > 0.0) != (two > 0.0)
    return many


@linked
def predicted_edge(buffers: PathBuffers, i: int, j: int, ends: FloatArray) -> float:
    """Relative position in the interval at which the beam between two rays passes a curve end; −1 for none."""
    legs = buffers.legs
    for leg in range(min(buffers.many[i], buffers.many[j])):
        a, b = buffers.first[i] + leg, buffers.first[j] + leg
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
def integrate_path(  # noqa: C901  one loop over intervals
    k: Precision,
    walls: Walls,
    family: FamilyInSpace,
    buffers: PathBuffers,
    ends: FloatArray,
    first: int,
    density: float,
    narrow: float,
    soft: float,
    total: FloatArray,
) -> float:
    """Integrate the powers from ``family.low`` to ``family.high`` into ``total`` (D + 5,).

    The path begins with ``first`` intervals. ``density`` is the error allowed per parameter. Intervals narrower than
    ``narrow`` are not divided, and intervals narrower than ``soft`` are not searched for hidden edges. If memory is
    exhausted, the mean of the known powers is used for the remainder. Returns the error of the integral.
    """
    low, high = family.low, family.high
    n, waiting, error, columns = 0, 0, 0.0, len(total)
    buffers.counts[3] = 0
    for d in range(columns):
        total[d] = 0.0
    along = heading(family, low)
    for s in range(first + 1):
        buffers.u[s] = low + (high - low) * s / first
    add_rays(k, walls, family, buffers, along, 0, first + 1)
    n = first + 1
    for s in range(first):
        buffers.waiting[waiting, 0], buffers.waiting[waiting, 1] = s, s + 1
        waiting += 1
    while waiting > 0:
        waiting -= 1
        i, j = buffers.waiting[waiting, 0], buffers.waiting[waiting, 1]
        a, b = buffers.u[i], buffers.u[j]
        width = b - a
        hard = buffers.tree[i] != buffers.tree[j]
        full = n + 2 > len(buffers.u) or waiting + 4 > len(buffers.waiting)
        full = full or buffers.counts[3] + 2 * MAX_LEGS > len(buffers.legs)
        if full or width <= narrow:
            apart = 0.0
            for d in range(columns):
                total[d] += 0.5 * width * (buffers.value[i, d] + buffers.value[j, d])
                apart = max(apart, abs(buffers.value[i, d] - buffers.value[j, d]))
            error += (0.5 if full else 0.25) * width * apart
            continue
        edge = a + predicted_edge(buffers, i, j, ends) * width if hard or width > soft else a
        seen, m = edge - narrow > a and edge + narrow < b, n
        if seen and hard:
            buffers.u[n], buffers.u[n + 1] = edge - 0.45 * narrow, edge + 0.45 * narrow
            n += 2
        else:  # rays on both sides have equal trees: test whether the ray at the predicted edge does, too
            buffers.u[n] = edge if seen else 0.5 * (a + b)
            n += 1
        add_rays(k, walls, family, buffers, along, m, n)
        if seen and hard:
            buffers.waiting[waiting, 0], buffers.waiting[waiting, 1] = i, m
            buffers.waiting[waiting + 1, 0], buffers.waiting[waiting + 1, 1] = m, m + 1
            buffers.waiting[waiting + 2, 0], buffers.waiting[waiting + 2, 1] = m + 1, j
            waiting += 3
            continue
        if (
            buffers.tree[m] == buffers.tree[i]
            and not hard
            and not seen
            and (width <= soft or (buffers.path[m] == buffers.path[i] and buffers.path[m] == buffers.path[j]))
        ):
            apart = 0.0
            for d in range(columns):
                apart = max(apart, abs(buffers.value[i, d] - 2.0 * buffers.value[m, d] + buffers.value[j, d]))
            if apart <= 6.0 * density:
                for d in range(columns):
                    total[d] += width / 6.0 * (buffers.value[i, d] + 4.0 * buffers.value[m, d] + buffers.value[j, d])
                error += width * apart / 30.0
                continue
        buffers.waiting[waiting, 0], buffers.waiting[waiting, 1] = i, m
        buffers.waiting[waiting + 1, 0], buffers.waiting[waiting + 1, 1] = m, j
        waiting += 2
    return error

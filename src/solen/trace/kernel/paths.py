"""Integrals of ray powers along a one-parameter path in space: adaptive, with edges located by the secant method.

Between two rays with equal trees the powers are smooth: Simpson's rule is used, with the trapezoidal rule as a check.
Between different trees there is an edge, where the beam passes the end of a curve on a segment that starts on the same
curve for both rays. The secant of the distance to that end predicts the edge, and two rays on either side of the
prediction confirm it. Equal trees do not prove that there is no edge, because a strip of other light may lie between
two rays. A ray is therefore also traced at each curve end that a beam between equal trees passes.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.adapt import in_quadrilateral
from solen.trace.kernel.compiled import called, compiled, linked
from solen.trace.kernel.family import FamilyInSpace, Heading, heading
from solen.trace.kernel.nearest import Walls
from solen.trace.kernel.prism import NO_SAMPLE, STACK_IN_SPACE, WIDTH_IN_SPACE, trace_prism
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.space import Vector

MAX_SEGMENTS = 300
"""Maximum number of segments of one ray with its branches, after which its remaining power is left to the tail."""
FIRST_INTERVALS, FIRST_ANGLE_INTERVALS = 2, 32
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
    first_segment: IntArray
    segment_count: IntArray
    segments: FloatArray
    waiting: IntArray
    """(capacity, 2)"""
    stack: Floats
    counts: IntArray
    """(4,) numbers of rays, segments, undefined rays and stored segments"""


STORED_RAYS, STORED_SEGMENTS, STORED_INTERVALS = 4096, 400_000, 2048


def path_buffers(columns: int) -> PathBuffers:
    """Allocate memory for a path; unused pages do not occupy physical memory."""
    n = STORED_RAYS
    return PathBuffers(
        u=np.empty(n),
        start=np.empty((n, 5)),
        tree=np.empty(n, np.uint64),
        path=np.empty(n, np.uint64),
        value=np.empty((n, columns)),
        first_segment=np.empty(n, np.int64),
        segment_count=np.empty(n, np.int64),
        segments=np.empty((STORED_SEGMENTS, 6)),
        waiting=np.empty((STORED_INTERVALS, 2), np.int64),
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
    sample: int,
    max_hits: int,
) -> None:
    """Trace the rays with indices from ``low`` up to ``high`` from their stored starting points.

    If ``sample`` is the sample number of the first ray, only the tails of the rays are traced.
    """
    for n in range(low, high):
        first = buffers.counts[3]
        x, z = buffers.start[n, 0], buffers.start[n, 1]
        d = Vector(buffers.start[n, 2], buffers.start[n, 3], buffers.start[n, 4])
        ray_sample = sample + n - low if sample >= 0 else NO_SAMPLE
        count, tree, path, undefined = trace_prism(
            k,
            walls,
            family,
            x,
            z,
            d,
            ray_sample,
            max_hits,
            MAX_SEGMENTS,
            buffers.value[n],
            buffers.segments[first:],
            buffers.stack,
        )
        buffers.counts[0] += 1
        buffers.counts[1] += count
        buffers.counts[2] += 1 if undefined else 0
        buffers.counts[3] += count if sample < 0 else 0
        buffers.tree[n], buffers.path[n], buffers.first_segment[n], buffers.segment_count[n] = tree, path, first, count


@compiled
def add_rays(
    k: Precision, walls: Walls, family: FamilyInSpace, buffers: PathBuffers, along: Heading, low: int, high: int
) -> None:
    """Trace the rays at the stored parameters with indices from ``low`` up to ``high``.

    If the angle is constant along the path, all rays have the direction ``along``.
    """
    turns = family.turn != 0.0
    for n in range(low, high):
        u = buffers.u[n]
        d = heading(family, u).d if turns else along.d
        buffers.start[n, 0], buffers.start[n, 1] = family.x + u * family.along_x, family.z + u * family.along_z
        buffers.start[n, 2], buffers.start[n, 3], buffers.start[n, 4] = d.x, d.y, d.z
    trace_rays(k, walls, family, buffers, low, high, NO_SAMPLE, 0)
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
    max_hits: int,
    buffers: PathBuffers,
    total: FloatArray,
) -> int:
    """Add the tails (D + 5,) of rays with the given ``starts`` (N, 5): x, z and the direction x, y, z.

    Their sample numbers begin at ``first``. Returns the number of segments traced.
    """
    segments_before, done = buffers.counts[1], 0
    buffers.counts[3] = 0
    while done < len(starts):
        count = min(len(starts) - done, len(buffers.u))
        for n in range(count):
            for column in range(5):
                buffers.start[n, column] = starts[done + n, column]
        trace_rays(k, walls, family, buffers, 0, count, first + done, max_hits)
        for n in range(count):
            for column in range(len(total)):
                total[column] += buffers.value[n, column]
        done += count
    segment_count: int = buffers.counts[1] - segments_before
    return segment_count


@compiled
def count_between(
    ends: FloatArray, ax: float, az: float, ux: float, uz: float, bx: float, bz: float, vx: float, vz: float
) -> int:
    """Number of curve ends between the lines of two segments, counted in a branch-free loop."""
    count = 0
    for e in range(ends.shape[1]):
        px, pz = ends[0, e], ends[1, e]
        offset_1, offset_2 = ux * (pz - az) - uz * (px - ax), vx * (pz - bz) - vz * (px - bx)
        count += (offset_1 > 0.0) != (offset_2 > 0.0)
    return count


@linked
def predicted_edge(buffers: PathBuffers, i: int, j: int, ends: FloatArray) -> float:
    """Relative position in an interval at which the beam between its two rays passes a curve end; −1 for none."""
    segments = buffers.segments
    for segment in range(min(buffers.segment_count[i], buffers.segment_count[j])):
        a, b = buffers.first_segment[i] + segment, buffers.first_segment[j] + segment
        ax, az, dx, dz = segments[a, 0], segments[a, 1], segments[b, 0], segments[b, 1]
        ux, uz, vx, vz = segments[a, 2] - ax, segments[a, 3] - az, segments[b, 2] - dx, segments[b, 3] - dz
        nearest, position, same_owner = math.inf, -1.0, segments[a, 5] == segments[b, 5]
        for e in range(ends.shape[1] if count_between(ends, ax, az, ux, uz, dx, dz, vx, vz) > 0 else 0):
            px, pz = ends[0, e], ends[1, e]
            offset_1 = ux * (pz - az) - uz * (px - ax)
            offset_2 = vx * (pz - dz) - vz * (px - dx)
            ahead = ux * (px - ax) + uz * (pz - az)
            if not ((offset_1 > 0.0) != (offset_2 > 0.0) and ahead > 0.0):
                continue
            if same_owner and not in_quadrilateral(
                ax, az, segments[a, 2], segments[a, 3], segments[b, 2], segments[b, 3], dx, dz, px, pz
            ):
                continue
            offset_1 /= math.sqrt(ux * ux + uz * uz)
            offset_2 /= math.sqrt(vx * vx + vz * vz)
            if ahead < nearest:
                nearest, position = ahead, offset_1 / (offset_1 - offset_2)
        if position >= 0.0:
            return position
        if not same_owner:
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
    min_search: float,
    total: FloatArray,
) -> float:
    """Integrate the powers from ``family.low`` to ``family.high`` into ``total`` (D + 5,).

    The path begins with ``first`` intervals. ``density`` is the error allowed per unit of the parameter. Intervals
    narrower than ``narrow`` are not divided, and intervals narrower than ``min_search`` are not searched for hidden
    edges. If memory is exhausted, the trapezoidal rule is used for the remaining intervals. Returns the error of the
    integral.
    """
    low, high = family.low, family.high
    n, waiting, error, columns = 0, 0, 0.0, len(total)
    buffers.counts[3] = 0
    for d in range(columns):
        total[d] = 0.0
    constant = heading(family, low)
    for s in range(first + 1):
        buffers.u[s] = low + (high - low) * s / first
    add_rays(k, walls, family, buffers, constant, 0, first + 1)
    n = first + 1
    for s in range(first):
        buffers.waiting[waiting, 0], buffers.waiting[waiting, 1] = s, s + 1
        waiting += 1
    while waiting > 0:
        waiting -= 1
        i, j = buffers.waiting[waiting, 0], buffers.waiting[waiting, 1]
        a, b = buffers.u[i], buffers.u[j]
        width = b - a
        is_edge = buffers.tree[i] != buffers.tree[j]
        full = n + 2 > len(buffers.u) or waiting + 4 > len(buffers.waiting)
        full = full or buffers.counts[3] + 2 * MAX_SEGMENTS > len(buffers.segments)
        if full or width <= narrow:
            difference = 0.0
            for d in range(columns):
                total[d] += 0.5 * width * (buffers.value[i, d] + buffers.value[j, d])
                difference = max(difference, abs(buffers.value[i, d] - buffers.value[j, d]))
            error += (0.5 if full else 0.25) * width * difference
            continue
        edge = a + predicted_edge(buffers, i, j, ends) * width if is_edge or width > min_search else a
        predicted, m = edge - narrow > a and edge + narrow < b, n
        if predicted and is_edge:
            buffers.u[n], buffers.u[n + 1] = edge - 0.45 * narrow, edge + 0.45 * narrow
            n += 2
        else:  # both rays have equal trees: test whether the ray at the predicted edge has the same tree
            buffers.u[n] = edge if predicted else 0.5 * (a + b)
            n += 1
        add_rays(k, walls, family, buffers, constant, m, n)
        if predicted and is_edge:
            buffers.waiting[waiting, 0], buffers.waiting[waiting, 1] = i, m
            buffers.waiting[waiting + 1, 0], buffers.waiting[waiting + 1, 1] = m, m + 1
            buffers.waiting[waiting + 2, 0], buffers.waiting[waiting + 2, 1] = m + 1, j
            waiting += 3
            continue
        if (
            buffers.tree[m] == buffers.tree[i]
            and not is_edge
            and not predicted
            and (width <= min_search or (buffers.path[m] == buffers.path[i] and buffers.path[m] == buffers.path[j]))
        ):
            difference = 0.0
            for d in range(columns):
                difference = max(difference, abs(buffers.value[i, d] - 2.0 * buffers.value[m, d] + buffers.value[j, d]))
            if difference <= 6.0 * density:
                for d in range(columns):
                    total[d] += width / 6.0 * (buffers.value[i, d] + 4.0 * buffers.value[m, d] + buffers.value[j, d])
                error += width * difference / 30.0
                continue
        buffers.waiting[waiting, 0], buffers.waiting[waiting, 1] = i, m
        buffers.waiting[waiting + 1, 0], buffers.waiting[waiting + 1, 1] = m, j
        waiting += 2
    return error

"""Division of a cone of launch angles into pieces with equal trees, and integration; see `solen.trace.adaptive`."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.compiled import called, compiled, linked
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.tree import NO_ROOM, Family, intensity, trace_tree
from solen.trace.tables import Tables

SAMPLES, SEGMENTS, PIECES, RAYS, ALL_SEGMENTS, UNDEFINED = range(6)
DONE, FULL = range(2)
MAX_SHARED_GAP = 1e-8
"""Maximum gap in radians between two pieces that share an edge."""


class Rule(NamedTuple):
    """Gauss–Kronrod pair: nodes (15,) in [−1, 1] and the weights of both rules."""

    nodes: FloatArray
    kronrod: FloatArray
    gauss: FloatArray


class Samples(NamedTuple):
    """Rays at launch angles in radians, linked in order of angle; ``resolved`` describes the interval after each."""

    angle: FloatArray
    tree: NDArray[np.uint64]
    first_segment: IntArray
    """index of the first segment of each ray"""
    segment_count: IntArray
    following: IntArray
    """index of the next sample, −1 for none"""
    resolved: NDArray[np.bool_]
    segments: FloatArray
    pending: IntArray
    """working memory for a stack of intervals"""
    value: FloatArray
    """(D + 2,) powers of the last ray traced"""
    stack: Floats
    counts: IntArray
    """(6,) numbers of stored samples, of their segments, of pieces, of all rays and segments traced, and of undefined
    rays in the quadrature
    """


class Pieces(NamedTuple):
    """Intervals with one tree each: ends in radians, trees, and parts, each of which is integrated by one rule."""

    low: FloatArray
    high: FloatArray
    tree: NDArray[np.uint64]
    first: IntArray
    """index of the sample at the start of each piece"""
    part_low: FloatArray
    part_high: FloatArray
    part_of: IntArray
    waiting: FloatArray
    """(capacity, 2) parts yet to be integrated"""


@linked
def apply_intensity(family: Family, angle: float, value: FloatArray) -> None:
    """Multiply the powers of a ray by its intensity."""
    weight = intensity(family, angle)
    if weight != 1.0:
        for d in range(len(value)):
            value[d] *= weight


@linked
def add_sample(k: Precision, tables: Tables, family: Family, samples: Samples, angle: float) -> int:
    """Trace a ray and store it; return its index, or −1 if there is no room."""
    n, first = samples.counts[SAMPLES], samples.counts[SEGMENTS]
    if n == len(samples.angle):
        return NO_ROOM
    count, tree, _ = trace_tree(k, tables, family, angle, samples.value, samples.segments[first:], samples.stack)
    if count == NO_ROOM:
        return NO_ROOM
    samples.angle[n], samples.tree[n] = angle, tree
    samples.first_segment[n], samples.segment_count[n], samples.following[n], samples.resolved[n] = (
        first,
        count,
        -1,
        False,
    )
    samples.counts[SAMPLES], samples.counts[SEGMENTS] = n + 1, first + count
    samples.counts[RAYS] += 1
    samples.counts[ALL_SEGMENTS] += count
    return int(n)


@compiled
def in_quadrilateral(
    ax: float, az: float, bx: float, bz: float, cx: float, cz: float, dx: float, dz: float, px: float, pz: float
) -> bool:
    """Whether a point is in a quadrilateral, which may intersect itself (even–odd rule)."""
    inside = False
    if (az > pz) != (bz > pz) and px < ax + (pz - az) / (bz - az) * (bx - ax):
        inside = not inside
    if (bz > pz) != (cz > pz) and px < bx + (pz - bz) / (cz - bz) * (cx - bx):
        inside = not inside
    if (cz > pz) != (dz > pz) and px < cx + (pz - cz) / (dz - cz) * (dx - cx):
        inside = not inside
    if (dz > pz) != (az > pz) and px < dx + (pz - dz) / (az - dz) * (ax - dx):
        inside = not inside
    return inside


@linked
def is_resolved(samples: Samples, i: int, j: int, ends: FloatArray) -> bool:
    """Whether two rays have equal trees, and no curve end lies in the beam between them or next to its curved faces."""
    if samples.tree[i] != samples.tree[j] or samples.segment_count[i] != samples.segment_count[j]:
        return False
    segments = samples.segments
    for segment in range(samples.segment_count[i]):
        a, b = samples.first_segment[i] + segment, samples.first_segment[j] + segment
        ax, az, bx, bz = segments[a, 0], segments[a, 1], segments[a, 2], segments[a, 3]
        cx, cz, dx, dz = segments[b, 2], segments[b, 3], segments[b, 0], segments[b, 1]
        on_curve = segments[a, 4] == 1.0
        # a diamond about the chord between both ends, wide enough for the curved face there
        mx, mz, hx, hz = 0.5 * (bx + cx), 0.5 * (bz + cz), -0.5 * (cz - bz), 0.5 * (cx - bx)
        margin = abs(hx) + abs(hz) if on_curve else 0.0
        x_low, x_high = min(min(ax, bx), min(cx, dx)) - margin, max(max(ax, bx), max(cx, dx)) + margin
        z_low, z_high = min(min(az, bz), min(cz, dz)) - margin, max(max(az, bz), max(cz, dz)) + margin
        for e in range(len(ends)):
            px, pz = ends[e, 0], ends[e, 1]
            if px < x_low or px > x_high or pz < z_low or pz > z_high:
                continue
            if in_quadrilateral(ax, az, bx, bz, cx, cz, dx, dz, px, pz):
                return False
            if on_curve and in_quadrilateral(bx, bz, mx + hx, mz + hz, cx, cz, mx - hx, mz - hz, px, pz):
                return False
    return True


@linked
def bisect(
    k: Precision,
    tables: Tables,
    family: Family,
    samples: Samples,
    ends: FloatArray,
    count: int,
    narrow: float,
    max_segments: int,
) -> int:
    """Halve the first ``count`` pending intervals until all are resolved or narrow; return FULL if memory runs out."""
    while count > 0:
        count -= 1
        i = samples.pending[count]
        j = samples.following[i]
        samples.resolved[i] = is_resolved(samples, i, j, ends)
        if samples.resolved[i] or samples.angle[j] - samples.angle[i] <= narrow:
            continue
        if count + 2 > len(samples.pending) or samples.counts[ALL_SEGMENTS] > max_segments:
            return FULL
        middle = samples.angle[i] + 0.5 * (samples.angle[j] - samples.angle[i])
        middle_sample = add_sample(k, tables, family, samples, middle)
        if middle_sample == NO_ROOM:
            return FULL
        samples.following[i], samples.following[middle_sample] = middle_sample, j
        samples.pending[count], samples.pending[count + 1] = middle_sample, i
        count += 2
    return DONE


@linked
def find_gaps(samples: Samples, narrow: float) -> int:
    """Collect the unresolved intervals wider than ``narrow`` in ``samples.pending``; return their number."""
    count, i = 0, 0
    while samples.following[i] >= 0:
        j = samples.following[i]
        if not samples.resolved[i] and samples.angle[j] - samples.angle[i] > narrow and count < len(samples.pending):
            samples.pending[count] = i
            count += 1
        i = j
    return count


@linked
def join_pieces(samples: Samples, pieces: Pieces) -> float:
    """Join consecutive resolved intervals into pieces; return the total width of the gaps between pieces."""
    n, i, gaps = 0, 0, 0.0
    while samples.following[i] >= 0:
        if not samples.resolved[i]:
            gaps += samples.angle[samples.following[i]] - samples.angle[i]
            i = samples.following[i]
            continue
        start = i
        while samples.following[i] >= 0 and samples.resolved[i]:
            i = samples.following[i]
        if n == len(pieces.low):
            gaps += samples.angle[i] - samples.angle[start]
            continue
        pieces.low[n], pieces.high[n] = samples.angle[start], samples.angle[i]
        pieces.tree[n], pieces.first[n] = samples.tree[start], start
        n += 1
    samples.counts[PIECES] = n
    return gaps


@linked
def insert_stray(k: Precision, tables: Tables, family: Family, samples: Samples, start: int, angle: float) -> int:
    """Store a ray whose tree differs from that of its piece, to divide its interval again; return its index or −1."""
    i = start
    while samples.following[i] >= 0 and samples.angle[samples.following[i]] <= angle:
        i = samples.following[i]
    stray = add_sample(k, tables, family, samples, angle)
    if stray == NO_ROOM:
        return NO_ROOM
    samples.following[stray], samples.following[i] = samples.following[i], stray
    samples.resolved[i] = False
    return stray


@linked
def integrate_pieces(  # noqa: C901  pieces, parts and nodes: three loops of one quadrature
    k: Precision,
    tables: Tables,
    family: Family,
    samples: Samples,
    pieces: Pieces,
    rule: Rule,
    density: float,
    narrow: float,
    max_segments: int,
    work: FloatArray,
    total: FloatArray,
) -> tuple[float, float, int, int]:
    """Integrate over all pieces, halving each until its error per width is at most ``density``.

    ``work`` (16, D + 2) receives the values at the nodes, and then their sum. ``total`` (D + 2,) receives the integral.
    Returns the error, the width omitted because memory or ``max_segments`` was exhausted, the number of parts, and the
    number of stray rays inserted; a piece that contains stray rays is omitted.
    """
    error, omitted, parts, strays, columns = 0.0, 0.0, 0, 0, len(total)
    for d in range(columns):
        total[d] = 0.0
    for piece in range(samples.counts[PIECES]):
        pieces.waiting[0, 0], pieces.waiting[0, 1] = pieces.low[piece], pieces.high[piece]
        waiting = 1
        while waiting > 0:
            waiting -= 1
            low, high = pieces.waiting[waiting, 0], pieces.waiting[waiting, 1]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            if samples.counts[ALL_SEGMENTS] > max_segments or parts == len(pieces.part_low):
                omitted += high - low
                continue
            same_tree, fits = True, True
            for node in range(len(rule.nodes)):
                angle = middle + half * rule.nodes[node]
                used = samples.counts[SEGMENTS]
                count, tree, undefined = trace_tree(
                    k, tables, family, angle, work[node], samples.segments[used:], samples.stack
                )
                samples.counts[RAYS] += 1
                samples.counts[ALL_SEGMENTS] += max(count, 0)
                samples.counts[UNDEFINED] += 1 if undefined else 0
                if count == NO_ROOM:
                    fits = False
                    break
                apply_intensity(family, angle, work[node])
                if tree != pieces.tree[piece]:
                    same_tree = False
                    if insert_stray(k, tables, family, samples, pieces.first[piece], angle) == NO_ROOM:
                        fits = False
                        break
                    strays += 1
            if not fits:
                omitted += high - low
                continue
            if not same_tree:
                omitted += high - low
                for i in range(waiting):
                    omitted += pieces.waiting[i, 1] - pieces.waiting[i, 0]
                break
            max_error = 0.0
            for d in range(columns):
                kronrod, gauss, spread = 0.0, 0.0, 0.0
                for node in range(len(rule.nodes)):
                    kronrod += rule.kronrod[node] * work[node, d]
                    gauss += rule.gauss[node] * work[node, d]
                for node in range(len(rule.nodes)):
                    spread += rule.kronrod[node] * abs(work[node, d] - 0.5 * kronrod)
                work[15, d] = half * kronrod
                difference = abs(kronrod - gauss)
                if difference > 0.0 and spread > 0.0:
                    difference = spread * min(1.0, (200.0 * difference / spread) ** 1.5)
                max_error = max(max_error, half * difference)
            if max_error <= density * (high - low) or high - low <= narrow:
                for d in range(columns):
                    total[d] += work[15, d]
                error += max_error
                pieces.part_low[parts], pieces.part_high[parts], pieces.part_of[parts] = low, high, piece
                parts += 1
            else:
                if waiting + 2 > len(pieces.waiting):
                    omitted += high - low
                    continue
                pieces.waiting[waiting, 0], pieces.waiting[waiting, 1] = middle, high
                pieces.waiting[waiting + 1, 0], pieces.waiting[waiting + 1, 1] = low, middle
                waiting += 2
    return error, omitted, parts, strays


@called
def integrate_cone(
    k: Precision, tables: Tables, family: Family, samples: Samples, pieces: Pieces, ends: FloatArray, rule: Rule,
    density: float, narrow: float, narrowest: float, widest: float, first_intervals: int, max_segments: int,
    work: FloatArray, total: FloatArray,
) -> tuple[float, float, int]:  # fmt: skip
    """Integrate the powers of a ray over the angles of the family, to an error of ``density`` per angle.

    Gaps are first narrowed to ``narrow``, and then further to ``narrowest`` if their total width exceeds ``widest``.
    Returns the error, the width of all gaps (including those left because memory or ``max_segments`` was exhausted),
    and the number of parts.
    """
    middle, half = 0.5 * (family.low + family.high), 0.5 * (family.high - family.low)
    for i in range(len(samples.counts)):
        samples.counts[i] = 0
    for i in range(first_intervals + 1):
        if add_sample(k, tables, family, samples, middle + half * (2.0 * i / first_intervals - 1.0)) == NO_ROOM:
            return 0.0, 2.0 * half, 0
        if i > 0:
            samples.following[i - 1] = i
    if samples.counts[ALL_SEGMENTS] * 1000 > max_segments:
        return 0.0, 2.0 * half, 0
    while True:
        gap_count = find_gaps(samples, narrow)
        full = bisect(k, tables, family, samples, ends, gap_count, narrow, max_segments) == FULL
        gaps = join_pieces(samples, pieces)
        if gaps > widest and narrow > narrowest and not full:
            narrow = max(0.1 * narrow, narrowest)
            continue
        error, omitted, parts, strays = integrate_pieces(
            k, tables, family, samples, pieces, rule, density, narrowest, max_segments, work, total
        )
        if strays == 0 or full:
            return error, gaps + omitted, parts


@linked
def has_tree(k: Precision, tables: Tables, family: Family, samples: Samples, angle: float, tree: np.uint64) -> bool:
    """Whether the ray at an angle has this tree; the number of its segments is added to the total."""
    count, ray_tree, _ = trace_tree(k, tables, family, angle, samples.value, samples.segments, samples.stack)
    samples.counts[ALL_SEGMENTS] += len(samples.segments) if count == NO_ROOM else count
    return count != NO_ROOM and ray_tree == tree


@linked
def locate_edge(
    k: Precision,
    tables: Tables,
    family: Family,
    samples: Samples,
    tree: np.uint64,
    edge: float,
    middle: float,
    limit: float,
    max_segments: int,
) -> float:
    """Locate the edge of a piece in a slightly changed scene; return NaN if it cannot be located.

    The search starts at the old edge. It proceeds outwards, up to ``limit``, while rays have the tree of the piece, and
    otherwise inwards, up to ``middle``; the edge is then bisected to the last digit. The search is abandoned after
    ``max_segments`` segments.
    """
    outwards = 1.0 if edge > middle else -1.0
    inside = has_tree(k, tables, family, samples, edge, tree)
    step = 1e-12
    inner, outer = edge, edge
    while True:
        if samples.counts[ALL_SEGMENTS] > max_segments:
            return math.nan
        trial = edge + (outwards if inside else -outwards) * step
        if inside and (trial - limit) * outwards >= 0.0:
            return limit
        if not inside and (trial - middle) * outwards <= 0.0:
            return math.nan
        if has_tree(k, tables, family, samples, trial, tree) != inside:
            inner, outer = (inner, trial) if inside else (trial, outer)
            break
        inner, outer = (trial, outer) if inside else (inner, trial)
        step *= 4.0
    while True:
        trial = 0.5 * (inner + outer)
        if trial in (inner, outer):
            return inner
        if has_tree(k, tables, family, samples, trial, tree):
            inner = trial
        else:
            outer = trial


@called
def reintegrate(
    k: Precision,
    tables: Tables,
    family: Family,
    samples: Samples,
    pieces: Pieces,
    count: int,
    parts: int,
    rule: Rule,
    max_segments: int,
    work: FloatArray,
    total: FloatArray,
) -> tuple[float, bool]:
    """Integrate a slightly changed scene over the same pieces, with their edges at the new positions.

    ``pieces`` contains the pieces of the previous scene and receives those of this scene. Each part keeps its relative
    position in its piece, so the quadrature error is the same to first order and cancels in differences. Returns the
    total width between the pieces, and whether all edges were located and all nodes have the expected tree, with at
    most ``max_segments`` segments in total.
    """
    for d in range(len(total)):
        total[d] = 0.0
    width, part, previous_high, shift = 0.0, 0, -math.inf, 0.0
    for piece in range(count):
        low, high, tree = pieces.low[piece], pieces.high[piece], pieces.tree[piece]
        middle, new_low, new_high = 0.5 * (low + high), low, high
        if low - previous_high > MAX_SHARED_GAP:
            shift = 0.0  # otherwise the search starts from the shift of the previous piece, which may exceed this width
        if low > family.low:
            new_low = locate_edge(
                k, tables, family, samples, tree, low + shift, middle + shift, family.low, max_segments
            )
            if math.isnan(new_low):
                return math.inf, False
            shift = new_low - low
        if high < family.high:
            edge = high + shift
            new_high = locate_edge(k, tables, family, samples, tree, edge, middle + shift, family.high, max_segments)
        if not new_low < new_high:
            return math.inf, False
        previous_high, shift = high, new_high - high
        width += new_high - new_low
        ratio = (new_high - new_low) / (high - low)
        while part < parts and pieces.part_of[part] == piece:
            a = new_low + ratio * (pieces.part_low[part] - low)
            b = new_low + ratio * (pieces.part_high[part] - low)
            for node in range(len(rule.nodes)):
                angle = 0.5 * (a + b) + 0.5 * (b - a) * rule.nodes[node]
                segment_count, ray_tree, _ = trace_tree(
                    k, tables, family, angle, work[node], samples.segments, samples.stack
                )
                samples.counts[ALL_SEGMENTS] += max(segment_count, 0)
                if segment_count == NO_ROOM or ray_tree != tree or samples.counts[ALL_SEGMENTS] > max_segments:
                    return math.inf, False
                apply_intensity(family, angle, work[node])
                for d in range(len(total)):
                    total[d] += 0.5 * (b - a) * rule.kronrod[node] * work[node, d]
            part += 1
        pieces.low[piece], pieces.high[piece] = new_low, new_high
    return family.high - family.low - width, True

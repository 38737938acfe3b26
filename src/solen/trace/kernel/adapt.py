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

SAMPLES, LEGS, PIECES, RAYS, ALL_LEGS, UNDEFINED = range(6)
DONE, FULL = range(2)
NEIGHBOURS = 1e-8
"""Maximum gap in radians between two pieces that share an edge."""


class Rule(NamedTuple):
    """Gauss–Kronrod pair: nodes (15,) in [−1, 1] and the weights of both rules."""

    nodes: FloatArray
    kronrod: FloatArray
    gauss: FloatArray


class Samples(NamedTuple):
    """Rays at launch angles in radians, linked in order of angle; the interval after each is either whole or not."""

    angle: FloatArray
    tree: NDArray[np.uint64]
    first: IntArray
    """index of the first leg of each ray"""
    many: IntArray
    after: IntArray
    """index of the next sample, −1 for none"""
    whole: NDArray[np.bool_]
    legs: FloatArray
    open: IntArray
    """working memory for a stack of intervals"""
    value: FloatArray
    """(D + 2,) powers of the last ray traced"""
    stack: Floats
    counts: IntArray
    """(6,) numbers of samples, legs, pieces, rays, all legs, and undefined rays in the quadrature"""


class Pieces(NamedTuple):
    """Intervals with one tree each: their ends (radians) and trees, and their parts, each integrated by one rule."""

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
def weigh(family: Family, angle: float, value: FloatArray) -> None:
    """Multiply the powers of a ray by its intensity."""
    weight = intensity(family, angle)
    if weight != 1.0:
        for d in range(len(value)):
            value[d] *= weight


@linked
def add_sample(k: Precision, tables: Tables, family: Family, samples: Samples, angle: float) -> int:
    """Trace a ray and store it; return its index, or −1 if there is no room."""
    n, first = samples.counts[SAMPLES], samples.counts[LEGS]
    if n == len(samples.angle):
        return NO_ROOM
    many, tree, _ = trace_tree(k, tables, family, angle, samples.value, samples.legs[first:], samples.stack)
    if many == NO_ROOM:
        return NO_ROOM
    samples.angle[n], samples.tree[n] = angle, tree
    samples.first[n], samples.many[n], samples.after[n], samples.whole[n] = first, many, -1, False
    samples.counts[SAMPLES], samples.counts[LEGS] = n + 1, first + many
    samples.counts[RAYS] += 1
    samples.counts[ALL_LEGS] += many
    return int(n)


@compiled
def holds(
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
def is_whole(samples: Samples, i: int, j: int, ends: FloatArray) -> bool:
    """Whether two rays have equal trees and no curve ends in the beam between them or next to its curved faces."""
    if samples.tree[i] != samples.tree[j] or samples.many[i] != samples.many[j]:
        return False
    legs = samples.legs
    for leg in range(samples.many[i]):
        a, b = samples.first[i] + leg, samples.first[j] + leg
        ax, az, bx, bz = legs[a, 0], legs[a, 1], legs[a, 2], legs[a, 3]
        cx, cz, dx, dz = legs[b, 2], legs[b, 3], legs[b, 0], legs[b, 1]
        bent = legs[a, 4] == 1.0
        # a diamond about the chord between both ends, wide enough for the curved face there
        mx, mz, hx, hz = 0.5 * (bx + cx), 0.5 * (bz + cz), -0.5 * (cz - bz), 0.5 * (cx - bx)
        reach = abs(hx) + abs(hz) if bent else 0.0
        x_low, x_high = min(min(ax, bx), min(cx, dx)) - reach, max(max(ax, bx), max(cx, dx)) + reach
        z_low, z_high = min(min(az, bz), min(cz, dz)) - reach, max(max(az, bz), max(cz, dz)) + reach
        for e in range(len(ends)):
            px, pz = ends[e, 0], ends[e, 1]
            if px < x_low or px > x_high or pz < z_low or pz > z_high:
                continue
            if holds(ax, az, bx, bz, cx, cz, dx, dz, px, pz):
                return False
            if bent and holds(bx, bz, mx + hx, mz + hz, cx, cz, mx - hx, mz - hz, px, pz):
                return False
    return True


@linked
def cut(
    k: Precision,
    tables: Tables,
    family: Family,
    samples: Samples,
    ends: FloatArray,
    opened: int,
    narrow: float,
    most_legs: int,
) -> int:
    """Halve the first ``opened`` intervals in ``samples.open`` until all are whole or narrow; FULL if out of room."""
    while opened > 0:
        opened -= 1
        i = samples.open[opened]
        j = samples.after[i]
        samples.whole[i] = is_whole(samples, i, j, ends)
        if samples.whole[i] or samples.angle[j] - samples.angle[i] <= narrow:
            continue
        if opened + 2 > len(samples.open) or samples.counts[ALL_LEGS] > most_legs:
            return FULL
        middle = samples.angle[i] + 0.5 * (samples.angle[j] - samples.angle[i])
        new = add_sample(k, tables, family, samples, middle)
        if new == NO_ROOM:
            return FULL
        samples.after[i], samples.after[new] = new, j
        samples.open[opened], samples.open[opened + 1] = new, i
        opened += 2
    return DONE


@linked
def open_gaps(samples: Samples, narrow: float) -> int:
    """Collect intervals that are not whole and wider than ``narrow`` in ``samples.open``; return their number."""
    opened, i = 0, 0
    while samples.after[i] >= 0:
        j = samples.after[i]
        if not samples.whole[i] and samples.angle[j] - samples.angle[i] > narrow and opened < len(samples.open):
            samples.open[opened] = i
            opened += 1
        i = j
    return opened


@linked
def gather(samples: Samples, pieces: Pieces) -> float:
    """Join consecutive whole intervals into pieces; return the total width of the gaps between pieces."""
    n, i, gaps = 0, 0, 0.0
    while samples.after[i] >= 0:
        if not samples.whole[i]:
            gaps += samples.angle[samples.after[i]] - samples.angle[i]
            i = samples.after[i]
            continue
        first = i
        while samples.after[i] >= 0 and samples.whole[i]:
            i = samples.after[i]
        if n == len(pieces.low):
            gaps += samples.angle[i] - samples.angle[first]
            continue
        pieces.low[n], pieces.high[n] = samples.angle[first], samples.angle[i]
        pieces.tree[n], pieces.first[n] = samples.tree[first], first
        n += 1
    samples.counts[PIECES] = n
    return gaps


@linked
def insert_stray(k: Precision, tables: Tables, family: Family, samples: Samples, start: int, angle: float) -> int:
    """Store a ray whose tree differs from that of its piece, so its interval is cut again; return its index or −1."""
    i = start
    while samples.after[i] >= 0 and samples.angle[samples.after[i]] <= angle:
        i = samples.after[i]
    new = add_sample(k, tables, family, samples, angle)
    if new == NO_ROOM:
        return NO_ROOM
    samples.after[new], samples.after[i] = samples.after[i], new
    samples.whole[i] = False
    return new


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
    most_legs: int,
    work: FloatArray,
    total: FloatArray,
) -> tuple[float, float, int, int]:
    """Integrate over all pieces, halving each until its error per width is at most ``density``.

    ``work`` (16, D + 2) holds the values at the nodes, then their sum. ``total`` (D + 2,) receives the integral.
    Returns the error, the width omitted because memory or ``most_legs`` was exhausted, the number of parts, and the
    number of stray rays inserted; a piece that contains stray rays is omitted.
    """
    error, left_out, parts, strays, columns = 0.0, 0.0, 0, 0, len(total)
    for d in range(columns):
        total[d] = 0.0
    for piece in range(samples.counts[PIECES]):
        pieces.waiting[0, 0], pieces.waiting[0, 1] = pieces.low[piece], pieces.high[piece]
        waiting = 1
        while waiting > 0:
            waiting -= 1
            low, high = pieces.waiting[waiting, 0], pieces.waiting[waiting, 1]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            if samples.counts[ALL_LEGS] > most_legs or parts == len(pieces.part_low):
                left_out += high - low
                continue
            clean, fits = True, True
            for node in range(len(rule.nodes)):
                angle = middle + half * rule.nodes[node]
                kept = samples.counts[LEGS]
                many, tree, undefined = trace_tree(
                    k, tables, family, angle, work[node], samples.legs[kept:], samples.stack
                )
                samples.counts[RAYS] += 1
                samples.counts[ALL_LEGS] += max(many, 0)
                samples.counts[UNDEFINED] += 1 if undefined else 0
                if many == NO_ROOM:
                    fits = False
                    break
                weigh(family, angle, work[node])
                if tree != pieces.tree[piece]:
                    clean = False
                    if insert_stray(k, tables, family, samples, pieces.first[piece], angle) == NO_ROOM:
                        fits = False
                        break
                    strays += 1
            if not fits:
                left_out += high - low
                continue
            if not clean:
                left_out += high - low
                for i in range(waiting):
                    left_out += pieces.waiting[i, 1] - pieces.waiting[i, 0]
                break
            worst = 0.0
            for d in range(columns):
                kronrod, gauss, spread = 0.0, 0.0, 0.0
                for node in range(len(rule.nodes)):
                    kronrod += rule.kronrod[node] * work[node, d]
                    gauss += rule.gauss[node] * work[node, d]
                for node in range(len(rule.nodes)):
                    spread += rule.kronrod[node] * abs(work[node, d] - 0.5 * kronrod)
                work[15, d] = half * kronrod
                apart = abs(kronrod - gauss)
                if apart > 0.0 and spread > 0.0:
                    apart = spread * min(1.0, (200.0 * apart / spread) ** 1.5)
                worst = max(worst, half * apart)
            if worst <= density * (high - low) or high - low <= narrow:
                for d in range(columns):
                    total[d] += work[15, d]
                error += worst
                pieces.part_low[parts], pieces.part_high[parts], pieces.part_of[parts] = low, high, piece
                parts += 1
            else:
                if waiting + 2 > len(pieces.waiting):
                    left_out += high - low
                    continue
                pieces.waiting[waiting, 0], pieces.waiting[waiting, 1] = middle, high
                pieces.waiting[waiting + 1, 0], pieces.waiting[waiting + 1, 1] = low, middle
                waiting += 2
    return error, left_out, parts, strays


@called
def integrate_cone(
    k: Precision, tables: Tables, family: Family, samples: Samples, pieces: Pieces, ends: FloatArray, rule: Rule,
    density: float, narrow: float, narrowest: float, widest: float, first_intervals: int, most_legs: int,
    work: FloatArray, total: FloatArray,
) -> tuple[float, float, int]:  # fmt: skip
    """Integrate the powers of a ray over the angles of the family, to an error of ``density`` per angle.

    Gaps are first cut down to ``narrow``, and then further down to ``narrowest`` if their total width exceeds
    ``widest``. Returns the error, the width of all gaps (including those omitted because memory or ``most_legs`` was
    exhausted), and the number of parts.
    """
    middle, half = 0.5 * (family.low + family.high), 0.5 * (family.high - family.low)
    for i in range(len(samples.counts)):
        samples.counts[i] = 0
    for i in range(first_intervals + 1):
        if add_sample(k, tables, family, samples, middle + half * (2.0 * i / first_intervals - 1.0)) == NO_ROOM:
            return 0.0, 2.0 * half, 0
        if i > 0:
            samples.after[i - 1] = i
    if samples.counts[ALL_LEGS] * 1000 > most_legs:
        return 0.0, 2.0 * half, 0
    while True:
        opened = open_gaps(samples, narrow)
        full = cut(k, tables, family, samples, ends, opened, narrow, most_legs) == FULL
        gaps = gather(samples, pieces)
        if gaps > widest and narrow > narrowest and not full:
            narrow = max(0.1 * narrow, narrowest)
            continue
        error, left_out, parts, strays = integrate_pieces(
            k, tables, family, samples, pieces, rule, density, narrowest, most_legs, work, total
        )
        if strays == 0 or full:
            return error, gaps + left_out, parts


@linked
def has_tree(k: Precision, tables: Tables, family: Family, samples: Samples, angle: float, tree: np.uint64) -> bool:
    """Whether the ray at an angle has this tree; the legs of the ray are counted."""
    many, found, _ = trace_tree(k, tables, family, angle, samples.value, samples.legs, samples.stack)
    samples.counts[ALL_LEGS] += len(samples.legs) if many == NO_ROOM else many
    return many != NO_ROOM and found == tree


@linked
def moved_edge(
    k: Precision,
    tables: Tables,
    family: Family,
    samples: Samples,
    tree: np.uint64,
    edge: float,
    middle: float,
    limit: float,
    most_legs: int,
) -> float:
    """Locate the edge of a piece in a slightly changed scene; return NaN if it cannot be located.

    The search starts at the old edge. It proceeds outwards, up to ``limit``, while the ray has the tree of the piece,
    and otherwise inwards, up to ``middle``; the edge is then bisected to the last digit. The search ends after
    ``most_legs`` legs.
    """
    outwards = 1.0 if edge > middle else -1.0
    inside = has_tree(k, tables, family, samples, edge, tree)
    step = 1e-12
    same, other = edge, edge
    while True:
        if samples.counts[ALL_LEGS] > most_legs:
            return math.nan
        new = edge + (outwards if inside else -outwards) * step
        if inside and (new - limit) * outwards >= 0.0:
            return limit
        if not inside and (new - middle) * outwards <= 0.0:
            return math.nan
        if has_tree(k, tables, family, samples, new, tree) != inside:
            same, other = (same, new) if inside else (new, other)
            break
        same, other = (new, other) if inside else (same, new)
        step *= 4.0
    while True:
        new = 0.5 * (same + other)
        if new in (same, other):
            return same
        if has_tree(k, tables, family, samples, new, tree):
            same = new
        else:
            other = new


@called
def integrate_again(
    k: Precision,
    tables: Tables,
    family: Family,
    samples: Samples,
    pieces: Pieces,
    many: int,
    parts: int,
    rule: Rule,
    most_legs: int,
    work: FloatArray,
    total: FloatArray,
) -> tuple[float, bool]:
    """Integrate a slightly changed scene over the same pieces, with their edges at the new positions.

    ``pieces`` contains the pieces of the previous scene and receives those of this scene. Each part keeps its relative
    position in its piece, so the quadrature error is the same to first order and cancels in differences. Returns the
    total width between the pieces, and whether all edges were located and all nodes have the right tree, using at most
    ``most_legs`` legs in total.
    """
    for d in range(len(total)):
        total[d] = 0.0
    width, part, before, shift = 0.0, 0, -math.inf, 0.0
    for piece in range(many):
        low, high, tree = pieces.low[piece], pieces.high[piece], pieces.tree[piece]
        middle, new_low, new_high = 0.5 * (low + high), low, high
        if low - before > NEIGHBOURS:
            shift = 0.0  # otherwise it starts from the displacement of the previous piece, which may exceed this width
        if low > family.low:
            new_low = moved_edge(k, tables, family, samples, tree, low + shift, middle + shift, family.low, most_legs)
            if math.isnan(new_low):
                return math.inf, False
            shift = new_low - low
        if high < family.high:
            edge = high + shift
            new_high = moved_edge(k, tables, family, samples, tree, edge, middle + shift, family.high, most_legs)
        if not new_low < new_high:
            return math.inf, False
        before, shift = high, new_high - high
        width += new_high - new_low
        ratio = (new_high - new_low) / (high - low)
        while part < parts and pieces.part_of[part] == piece:
            a = new_low + ratio * (pieces.part_low[part] - low)
            b = new_low + ratio * (pieces.part_high[part] - low)
            for node in range(len(rule.nodes)):
                angle = 0.5 * (a + b) + 0.5 * (b - a) * rule.nodes[node]
                found, tree_there, _ = trace_tree(k, tables, family, angle, work[node], samples.legs, samples.stack)
                samples.counts[ALL_LEGS] += max(found, 0)
                if found == NO_ROOM or tree_there != tree or samples.counts[ALL_LEGS] > most_legs:
                    return math.inf, False
                weigh(family, angle, work[node])
                for d in range(len(total)):
                    total[d] += 0.5 * (b - a) * rule.kronrod[node] * work[node, d]
            part += 1
        pieces.low[piece], pieces.high[piece] = new_low, new_high
    return family.high - family.low - width, True

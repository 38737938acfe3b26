"""The nearest interface ahead of one ray, found by testing all interfaces, or with a grid if there are many."""

import math
from typing import NamedTuple

import numpy as np

from solen.arrays import IntArray
from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.hits import (
    arc_hit,
    arc_normal,
    conic_hit,
    conic_normal,
    cubic_beside,
    cubic_hit,
    cubic_tangent,
    oval_hit,
    oval_normal,
    segment_hit,
    unit,
)
from solen.trace.kernel.rows import (
    ARC,
    CONIC,
    CUBIC,
    OVAL,
    SEGMENT,
    Cubic,
    Floats,
    Precision,
    Segment,
    arc_row,
    conic_row,
    cubic_row,
    oval_row,
    segment_row,
)
from solen.trace.tables import Tables

SIDE_BY_SIDE = 8
"""Number of segments tested together; the segment count is padded to a multiple of this."""
MAX_SIMULTANEOUS = 64
"""Maximum number of segments tested without a tree."""
FEW = 4
"""Maximum number of other pieces tested one after another."""
FAR = 1e300


class Ray(NamedTuple):
    """Position and direction of a ray, the curve at its origin (−1 for none) and the parameter there."""

    x: float
    z: float
    dx: float
    dz: float
    last: int
    at: float


class Hit(NamedTuple):
    """The nearest hit of a ray: the distance (infinity for none), the curve (−1 for none), and the parameter there."""

    distance: float
    curve: int
    place: float


@compiled
def curve_hit(k: Precision, tables: Tables, c: int, ray: Ray) -> tuple[float, float]:
    """Distance to curve ``c`` and the parameter there (for cubic pieces only)."""
    kind, shape, before = tables.kind, tables.shape, tables.before
    x, z, dx, dz, last, at = ray
    leaving = c == last
    if kind[c] == SEGMENT:
        return segment_hit(k, segment_row(shape, c), x, z, dx, dz, leaving), k.zero
    if kind[c] == CONIC:
        return conic_hit(k, conic_row(shape, c), x, z, dx, dz, leaving), k.zero
    if kind[c] == ARC:
        return arc_hit(k, arc_row(shape, c), x, z, dx, dz, leaving), k.zero
    if kind[c] == OVAL:
        return oval_hit(k, oval_row(shape, c), x, z, dx, dz, leaving), k.zero
    q = cubic_row(shape, c)
    if leaving:
        return cubic_hit(k, q, x, z, dx, dz, True, at, k.zero)
    if last >= 0 and kind[last] == CUBIC and (before[c] == last or before[last] == c):
        forwards = before[c] == last
        if (at >= 1.0 if forwards else at <= 0.0) or on_joint(
            k, q, forwards, x, z
        ):  # the ray starts at the joint of the two pieces
            return cubic_hit(k, q, x, z, dx, dz, True, k.zero if forwards else k.one, k.zero)
        beside = cubic_beside(k, cubic_row(shape, last), x, z, dx, dz, at)
        return cubic_hit(k, q, x, z, dx, dz, False, k.zero, beside)
    return cubic_hit(k, q, x, z, dx, dz, False, k.zero, k.zero)


@compiled
def on_joint(k: Precision, q: Cubic, first: bool, x: float, z: float) -> bool:
    """Whether a point is the first or last point of a piece, to within rounding error."""
    away = abs(x - q.x0) + abs(z - q.z0) if first else abs(x - q.x3) + abs(z - q.z3)
    size = abs(x) + abs(z) + abs(q.x3 - q.x0) + abs(q.z3 - q.z0)
    return bool(away <= (k.three + k.one) * k.rounding * size)


@compiled
def normal_at(k: Precision, kind: int, shape: Floats, c: int, x: float, z: float, at: float) -> tuple[float, float]:
    """Left unit normal at a point on curve ``c``; ``at`` is the parameter there on a cubic piece."""
    if kind == SEGMENT:
        return -shape[c, 3], shape[c, 2]
    if kind == CONIC:
        return conic_normal(k, conic_row(shape, c), x, z)
    if kind == ARC:
        return arc_normal(arc_row(shape, c), x, z)
    if kind == OVAL:
        return oval_normal(oval_row(shape, c), x, z)
    tx, tz = cubic_tangent(k, cubic_row(shape, c), at)
    return unit(-tz, tx, k.one)


@compiled
def place_on(k: Precision, kind: int, shape: Floats, c: int, x: float, z: float, at: float) -> float:
    """Relative position of a point on curve ``c`` along its interface, from 0 at the start to 1 at the end."""
    if kind == SEGMENT:
        s = segment_row(shape, c)
        return ((x - s.ax) * s.ux + (z - s.az) * s.uz) / s.length
    if kind == CONIC:
        q = conic_row(shape, c)
        share = ((x - q.vx) * q.lx + (z - q.vz) * q.lz - q.low) / (q.high - q.low)
        return share if q.side > 0.0 else k.one - share
    if kind == ARC:
        a = arc_row(shape, c)
        px, pz = x - a.cx, z - a.cz
        from_middle = math.atan2(a.mx * pz - a.mz * px, a.mx * px + a.mz * pz)
        quarter = math.asin(min(a.end / a.radius, k.one))
        half = quarter if a.at_most_half == 1.0 else math.pi - quarter
        return k.half * (k.one + a.side * from_middle / half)
    if kind == OVAL:
        o = oval_row(shape, c)
        px, pz = x - o.x1, z - o.z1
        share = math.atan2(o.rx * pz - o.rz * px, o.rx * px + o.rz * pz) / math.atan2(
            o.rx * o.lz - o.rz * o.lx, o.rx * o.lx + o.rz * o.lz
        )
        return share if o.side > 0.0 else k.one - share
    piece = cubic_row(shape, c)
    return piece.first + at * (piece.last - piece.first)


@compiled
def nearest(k: Precision, tables: Tables, ray: Ray) -> Hit:
    """Return the nearest hit ahead of a ray."""
    if len(tables.grid_item) > 0:
        return nearest_by_grid(k, tables, ray)
    best, found, place = k.none, -1, k.zero
    for c in range(len(tables.kind)):
        t, u = curve_hit(k, tables, c, ray)
        if t < best:
            best, found, place = t, c, u
    return Hit(best, found, place)


class Walls(NamedTuple):
    """Scene tables with pieces grouped for testing: all segments together, the other pieces in a tree of boxes."""

    tables: Tables
    segment: Floats
    """(5, S) segment rows as columns, padded with segments that no ray meets so that registers are filled"""
    piece: IntArray
    """(S,) index of each piece"""
    distance: Floats
    """(S,) working memory for distances"""
    other: IntArray
    """indices of the other pieces if they are few"""
    leaf: IntArray
    """(L,) indices of the other pieces if they are many, padded with −1; L is a power of two, or 0"""
    box: Floats
    """(2 L, 4) box around everything below a node: node 1 is the root, node n has the children 2 n and 2 n + 1, and
    leaf n is node L + n
    """


def walls_of(tables: Tables) -> Walls:
    """Group the pieces of a scene for one thread; if few pieces are not segments, many segments also enter the tree."""
    lines = np.flatnonzero(tables.kind == SEGMENT)
    lines = lines if len(lines) <= MAX_SIMULTANEOUS else lines[:0]
    width = len(Segment._fields)
    filled = -(-len(lines) // SIDE_BY_SIDE) * SIDE_BY_SIDE
    segment, piece = np.zeros((width, filled)), np.full(filled, -2)
    segment[-1], segment[-2] = -1.0, 1.0  # with a negative length
    segment[:, : len(lines)], piece[: len(lines)] = tables.shape[lines, :width].T, lines
    others = np.setdiff1d(np.arange(len(tables.kind)), lines)
    few = len(others) <= FEW
    leaf, box = _tree(tables, others[: 0 if few else None])
    return Walls(tables, segment, piece, np.empty(filled), others[: None if few else 0], leaf, box)


def _tree(tables: Tables, pieces: IntArray) -> tuple[IntArray, Floats]:
    """Build the leaves and boxes of the tree over some pieces, level by level."""
    leaves = 1 << (len(pieces) - 1).bit_length() if len(pieces) else 0
    leaf = np.full(leaves, -1)
    leaf[: len(pieces)] = pieces
    box = np.full((2 * leaves, 4), (np.inf, -np.inf, np.inf, -np.inf))
    box[leaves : leaves + len(pieces)] = tables.box[pieces]
    first = leaves
    while first > 1:
        pairs = box[first : 2 * first].reshape(-1, 2, 4)
        first //= 2
        box[first : 2 * first, ::2], box[first : 2 * first, 1::2] = pairs[..., ::2].min(1), pairs[..., 1::2].max(1)
    box[~np.isfinite(box).all(axis=1)] = FAR
    return leaf, box


@compiled
def passes(box: Floats, x: float, z: float, across: float, ahead: float, best: float) -> bool:
    """Whether a ray misses a box or reaches it only beyond ``best``; its direction is (1 / across, 1 / ahead)."""
    xa, xb, za, zb = (box[0] - x) * across, (box[1] - x) * across, (box[2] - z) * ahead, (box[3] - z) * ahead
    enters, exits = max(min(xa, xb), min(za, zb)), min(max(xa, xb), max(za, zb))
    return bool(enters > exits or exits < 0.0 or enters > best)  # False for NaN, from a ray along a side


@compiled
def nearest_wall(k: Precision, walls: Walls, ray: Ray) -> Hit:
    """As `nearest`: test all segments together, and the other pieces if their boxes are ahead and near enough."""
    s, distance = walls.segment, walls.distance
    x, z, dx, dz, last, _ = ray
    for i in range(len(distance)):
        line = Segment(s[0, i], s[1, i], s[2, i], s[3, i], s[4, i])
        distance[i] = segment_hit(k, line, x, z, dx, dz, walls.piece[i] == last)
    best, found = k.none, -1
    for i in range(len(distance)):
        nearer = distance[i] < best
        best, found = distance[i] if nearer else best, walls.piece[i] if nearer else found
    across, ahead, place, i, many = k.one / dx, k.one / dz, k.zero, 0, len(walls.other)
    node = 1 if len(walls.leaf) > 0 else 0
    while True:
        if i < many:
            c = walls.other[i]
            i += 1
            if passes(walls.tables.box[c], x, z, across, ahead, best):
                continue
        elif node > 0:
            c, node = next_leaf(walls, node, x, z, across, ahead, best)
            if c < 0:
                continue
        else:
            return Hit(best, found, place)
        t, u = curve_hit(k, walls.tables, c, ray)
        if t < best or (t == best and c < found):
            best, found, place = t, c, u


@compiled
def next_leaf(walls: Walls, node: int, x: float, z: float, across: float, ahead: float, best: float) -> tuple[int, int]:
    """Return the next tree piece, from a node on, that a ray may meet, or −1; and the following node, or 0."""
    leaves = len(walls.leaf)
    while node > 0:
        missed = passes(walls.box[node], x, z, across, ahead, best)
        if not missed and node < leaves:
            node *= 2
            continue
        c = walls.leaf[node - leaves] if not missed else -1
        while node & 1:
            node >>= 1
        node += 1 if node > 0 else 0
        if c >= 0:
            return c, node
    return -1, 0


@compiled
def nearest_by_grid(k: Precision, tables: Tables, ray: Ray) -> Hit:
    """As `nearest`, through the grid cells that the ray crosses, in order (Amanatides & Woo, 1987)."""
    x, z, dx, dz, _, _ = ray
    low, cell, many = tables.grid_low, tables.grid_cell, tables.grid_many
    best, found, place = k.none, -1, k.zero
    enters, exits = k.zero, k.none
    for axis in range(2):
        o, d = (x, dx) if axis == 0 else (z, dz)
        first, second = (low[axis] - o) / d, (low[axis] + cell[axis] * many[axis] - o) / d
        if d == 0.0:
            if o < low[axis] or o > low[axis] + cell[axis] * many[axis]:
                return Hit(best, found, place)
        else:
            enters, exits = max(enters, min(first, second)), min(exits, max(first, second))
    if enters > exits:
        return Hit(best, found, place)
    i = min(max(int((x + enters * dx - low[0]) / cell[0]), 0), many[0] - 1)
    j = min(max(int((z + enters * dz - low[1]) / cell[1]), 0), many[1] - 1)
    right, up = dx > 0.0, dz > 0.0
    while True:
        tx = (low[0] + cell[0] * (i + 1 if right else i) - x) / dx if dx != 0.0 else k.none
        tz = (low[1] + cell[1] * (j + 1 if up else j) - z) / dz if dz != 0.0 else k.none
        here = i * many[1] + j
        for item in range(tables.grid_first[here], tables.grid_first[here + 1]):
            c = tables.grid_item[item]
            t, u = curve_hit(k, tables, c, ray)
            if t < best:
                best, found, place = t, c, u
        if best <= min(tx, tz) - k.margin:
            return Hit(best, found, place)
        if tx < tz:
            i += 1 if right else -1
            if i < 0 or i >= many[0]:
                return Hit(best, found, place)
        else:
            j += 1 if up else -1
            if j < 0 or j >= many[1]:
                return Hit(best, found, place)


@compiled
def other_side(k: Precision, tables: Tables, ray: Ray, c: int) -> bool:
    """Whether curve ``c`` and the ray direction are on opposite sides of the curve at the ray origin."""
    nx, nz = normal_at(k, tables.kind[ray.last], tables.shape, ray.last, ray.x, ray.z, ray.at)
    towards = (tables.middle[c, 0] - ray.x) * nx + (tables.middle[c, 1] - ray.z) * nz
    return bool(towards * (ray.dx * nx + ray.dz * nz) < 0.0)

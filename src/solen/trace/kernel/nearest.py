"""The nearest interface ahead of one ray, by a test of all interfaces, or with a grid if there are many."""

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
    cubic_hit,
    cubic_offset,
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

VECTOR_WIDTH = 8
"""Number of straight pieces that are tested together; their number is padded to a multiple of this."""
MAX_LINES = 64
"""Maximum number of straight pieces that are tested without a tree."""
MAX_OTHERS = 4
"""Maximum number of other pieces that are tested without a tree."""
FAR = 1e300


class Ray(NamedTuple):
    """Position and direction of a ray, the curve at its origin (−1 for none) and the parameter of that curve there."""

    x: float
    z: float
    dx: float
    dz: float
    last: int
    u: float


class Hit(NamedTuple):
    """The nearest hit of a ray: distance (infinity for none), curve (−1 for none), and parameter of the curve there."""

    distance: float
    curve: int
    u: float


@compiled
def curve_hit(k: Precision, tables: Tables, c: int, ray: Ray) -> tuple[float, float]:
    """Distance to curve ``c`` and the parameter there (for cubic pieces only)."""
    kind, shape, previous = tables.kind, tables.shape, tables.previous
    x, z, dx, dz, last, u_start = ray
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
        return cubic_hit(k, q, x, z, dx, dz, True, u_start, k.zero)
    if last >= 0 and kind[last] == CUBIC and (previous[c] == last or previous[last] == c):
        forwards = previous[c] == last
        # the ray starts at the joint of the two pieces
        if (u_start >= 1.0 if forwards else u_start <= 0.0) or on_joint(k, q, forwards, x, z):
            return cubic_hit(k, q, x, z, dx, dz, True, k.zero if forwards else k.one, k.zero)
        offset = cubic_offset(k, cubic_row(shape, last), x, z, dx, dz, u_start)
        return cubic_hit(k, q, x, z, dx, dz, False, k.zero, offset)
    return cubic_hit(k, q, x, z, dx, dz, False, k.zero, k.zero)


@compiled
def on_joint(k: Precision, q: Cubic, first: bool, x: float, z: float) -> bool:
    """Whether a point is the first or last point of a piece, to within rounding error."""
    distance = abs(x - q.x0) + abs(z - q.z0) if first else abs(x - q.x3) + abs(z - q.z3)
    size = abs(x) + abs(z) + abs(q.x3 - q.x0) + abs(q.z3 - q.z0)
    return bool(distance <= (k.three + k.one) * k.rounding * size)


@compiled
def normal_at(k: Precision, kind: int, shape: Floats, c: int, x: float, z: float, u: float) -> tuple[float, float]:
    """Left unit normal at a point on curve ``c``; ``u`` is the parameter there on a cubic piece."""
    if kind == SEGMENT:
        return -shape[c, 3], shape[c, 2]
    if kind == CONIC:
        return conic_normal(k, conic_row(shape, c), x, z)
    if kind == ARC:
        return arc_normal(arc_row(shape, c), x, z)
    if kind == OVAL:
        return oval_normal(oval_row(shape, c), x, z)
    tx, tz = cubic_tangent(k, cubic_row(shape, c), u)
    return unit(-tz, tx, k.one)


@compiled
def relative_position(k: Precision, kind: int, shape: Floats, c: int, x: float, z: float, u: float) -> float:
    """Relative position of a point on curve ``c`` along its interface, from 0 at the start to 1 at the end."""
    if kind == SEGMENT:
        s = segment_row(shape, c)
        return ((x - s.ax) * s.ux + (z - s.az) * s.uz) / s.length
    if kind == CONIC:
        q = conic_row(shape, c)
        fraction = ((x - q.vx) * q.lx + (z - q.vz) * q.lz - q.low) / (q.high - q.low)
        return fraction if q.side > 0.0 else k.one - fraction
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
        fraction = math.atan2(o.rx * pz - o.rz * px, o.rx * px + o.rz * pz) / math.atan2(
            o.rx * o.lz - o.rz * o.lx, o.rx * o.lx + o.rz * o.lz
        )
        return fraction if o.side > 0.0 else k.one - fraction
    piece = cubic_row(shape, c)
    return piece.u_from + u * (piece.u_to - piece.u_from)


@compiled
def nearest(k: Precision, tables: Tables, ray: Ray) -> Hit:
    """Return the nearest hit ahead of a ray."""
    if len(tables.grid_item) > 0:
        return nearest_by_grid(k, tables, ray)
    distance, curve, u_hit = k.none, -1, k.zero
    for c in range(len(tables.kind)):
        t, u = curve_hit(k, tables, c, ray)
        if t < distance:
            distance, curve, u_hit = t, c, u
    return Hit(distance, curve, u_hit)


class Walls(NamedTuple):
    """Scene tables with grouped pieces: straight ones are tested together, the others in a tree of boxes."""

    tables: Tables
    line: Floats
    """(5, S) straight pieces, one per column, padded with some that no ray meets"""
    piece: IntArray
    """(S,) index of each piece"""
    distance: Floats
    """(S,) working memory for distances"""
    other: IntArray
    """indices of the other pieces if they are few"""
    leaf: IntArray
    """(L,) indices of the other pieces if they are many, padded with −1; L is a power of two, or 0"""
    box: Floats
    """(2 L, 4) box around all pieces below each node: node 1 is the root, node n has the children 2 n and 2 n + 1, and
    leaf n is node L + n
    """


def walls_of(tables: Tables) -> Walls:
    """Group the pieces of a scene for one thread; if there are too many straight pieces, they are also in the tree."""
    lines = np.flatnonzero(tables.kind == SEGMENT)
    lines = lines if len(lines) <= MAX_LINES else lines[:0]
    width = len(Segment._fields)
    padded = -(-len(lines) // VECTOR_WIDTH) * VECTOR_WIDTH
    segment, piece = np.zeros((width, padded)), np.full(padded, -2)
    segment[-1], segment[-2] = -1.0, 1.0  # with a negative length
    segment[:, : len(lines)], piece[: len(lines)] = tables.shape[lines, :width].T, lines
    others = np.setdiff1d(np.arange(len(tables.kind)), lines)
    are_few = len(others) <= MAX_OTHERS
    leaf, box = _tree(tables, others[: 0 if are_few else None])
    return Walls(tables, segment, piece, np.empty(padded), others[: None if are_few else 0], leaf, box)


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
def misses_box(box: Floats, x: float, z: float, per_x: float, per_z: float, nearest: float) -> bool:
    """Whether a ray misses a box or reaches it only beyond ``nearest``; its direction is (1 / per_x, 1 / per_z)."""
    xa, xb, za, zb = (box[0] - x) * per_x, (box[1] - x) * per_x, (box[2] - z) * per_z, (box[3] - z) * per_z
    enters, exits = max(min(xa, xb), min(za, zb)), min(max(xa, xb), max(za, zb))
    return bool(enters > exits or exits < 0.0 or enters > nearest)  # False for NaN, which a ray along a side produces


@compiled
def nearest_wall(k: Precision, walls: Walls, ray: Ray) -> Hit:
    """As `nearest`, but test all straight pieces together and others only if their boxes are ahead and near enough."""
    s, distance = walls.line, walls.distance
    x, z, dx, dz, last, _ = ray
    for i in range(len(distance)):
        segment = Segment(s[0, i], s[1, i], s[2, i], s[3, i], s[4, i])
        distance[i] = segment_hit(k, segment, x, z, dx, dz, walls.piece[i] == last)
    nearest, curve = k.none, -1
    for i in range(len(distance)):
        nearer = distance[i] < nearest
        nearest, curve = distance[i] if nearer else nearest, walls.piece[i] if nearer else curve
    per_x, per_z, u_hit, i, others = k.one / dx, k.one / dz, k.zero, 0, len(walls.other)
    node = 1 if len(walls.leaf) > 0 else 0
    while True:
        if i < others:
            c = walls.other[i]
            i += 1
            if misses_box(walls.tables.box[c], x, z, per_x, per_z, nearest):
                continue
        elif node > 0:
            c, node = next_leaf(walls, node, x, z, per_x, per_z, nearest)
            if c < 0:
                continue
        else:
            return Hit(nearest, curve, u_hit)
        t, u = curve_hit(k, walls.tables, c, ray)
        if t < nearest or (t == nearest and c < curve):
            nearest, curve, u_hit = t, c, u


@compiled
def next_leaf(
    walls: Walls, node: int, x: float, z: float, per_x: float, per_z: float, nearest: float
) -> tuple[int, int]:
    """Return the next piece in the tree, from a node on, that a ray may meet (or −1), and the following node (or 0)."""
    leaves = len(walls.leaf)
    while node > 0:
        misses = misses_box(walls.box[node], x, z, per_x, per_z, nearest)
        if not misses and node < leaves:
            node *= 2
            continue
        c = walls.leaf[node - leaves] if not misses else -1
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
    low, cell, count = tables.grid_low, tables.grid_cell, tables.grid_count
    distance, curve, u_hit = k.none, -1, k.zero
    enters, exits = k.zero, k.none
    for axis in range(2):
        o, d = (x, dx) if axis == 0 else (z, dz)
        first, second = (low[axis] - o) / d, (low[axis] + cell[axis] * count[axis] - o) / d
        if d == 0.0:
            if o < low[axis] or o > low[axis] + cell[axis] * count[axis]:
                return Hit(distance, curve, u_hit)
        else:
            enters, exits = max(enters, min(first, second)), min(exits, max(first, second))
    if enters > exits:
        return Hit(distance, curve, u_hit)
    i = min(max(int((x + enters * dx - low[0]) / cell[0]), 0), count[0] - 1)
    j = min(max(int((z + enters * dz - low[1]) / cell[1]), 0), count[1] - 1)
    right, up = dx > 0.0, dz > 0.0
    while True:
        tx = (low[0] + cell[0] * (i + 1 if right else i) - x) / dx if dx != 0.0 else k.none
        tz = (low[1] + cell[1] * (j + 1 if up else j) - z) / dz if dz != 0.0 else k.none
        cell_index = i * count[1] + j
        for entry in range(tables.grid_first[cell_index], tables.grid_first[cell_index + 1]):
            c = tables.grid_item[entry]
            t, u = curve_hit(k, tables, c, ray)
            if t < distance:
                distance, curve, u_hit = t, c, u
        if distance <= min(tx, tz) - k.margin:
            return Hit(distance, curve, u_hit)
        if tx < tz:
            i += 1 if right else -1
            if i < 0 or i >= count[0]:
                return Hit(distance, curve, u_hit)
        else:
            j += 1 if up else -1
            if j < 0 or j >= count[1]:
                return Hit(distance, curve, u_hit)


@compiled
def other_side(k: Precision, tables: Tables, ray: Ray, c: int) -> bool:
    """Whether curve ``c`` and the ray direction are on opposite sides of the curve at the ray origin."""
    nx, nz = normal_at(k, tables.kind[ray.last], tables.shape, ray.last, ray.x, ray.z, ray.u)
    towards = (tables.middle[c, 0] - ray.x) * nx + (tables.middle[c, 1] - ray.z) * nz
    return bool(towards * (ray.dx * nx + ray.dz * nz) < 0.0)

"""Counting: a block of rays taken through the curves that they meet, side by side.

Counting needs no more than a normal and Snell's law where light meets a bare surface. Inner loops over the rays of a
block do that, free of branches; what needs more (corners, rays in another region than they should be, treated surfaces)
is left to the loop over single rays.
"""

from typing import NamedTuple

from solen.arrays import IntArray
from solen.trace.kernel.block import Found, Rays
from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.hits import arc_normal, conic_normal, oval_normal
from solen.trace.kernel.rows import (
    ABSORBING,
    ARC,
    CONIC,
    MIRROR,
    OVAL,
    RECEIVER,
    REFRACTING,
    SEGMENT,
    Floats,
    Precision,
    arc_row,
    conic_row,
    oval_row,
)
from solen.trace.kernel.step import Rules
from solen.trace.kernel.surface import COUNT, bend
from solen.trace.result import ABSORBED, DETECTED, GOES_ON
from solen.trace.tables import Tables

ASIDE, LEFT = -1, -2
"""Of a ray not yet looked at here, and of one that is left to the loop over single rays; that loop takes both."""
MOST_CURVES = 8
"""Curves that a block is taken through in this way: neighbouring rays meet few."""


class Carried(NamedTuple):
    """What the rays of a block carry (BLOCK,)."""

    optical: Floats
    region: IntArray
    colour: IntArray
    hits: IntArray


@compiled
def pass_block(
    k: Precision, tables: Tables, rules: Rules, n: int, rays: Rays, carried: Carried, found: Found, fate: IntArray
) -> None:
    """Take rays 0 to n through what they meet; ``fate`` (BLOCK,) becomes what became of each, `ASIDE` or `LEFT`.

    Rays that go on then are where they do; of those that ended only the optical path is new.
    """
    for i in range(n):
        fate[i] = ASIDE
    first = 0
    for _ in range(MOST_CURVES):
        while first < n and (fate[first] != ASIDE or found.curve[first] < 0):
            first += 1
        if first == n:
            return
        c = found.curve[first]
        first += 1
        if normals(k, tables, c, n, rays, found):
            if tables.behaviour[c] in (REFRACTING, MIRROR):
                refract(k, tables, rules, c, n, rays, carried, found, fate)
            elif tables.behaviour[c] in (RECEIVER, ABSORBING):
                end(k, tables, c, n, rays, carried, found, fate)


@compiled
def normals(k: Precision, tables: Tables, c: int, n: int, rays: Rays, found: Found) -> bool:
    """Write the normals of curve ``c`` where the rays of a block meet it; False for a curve that has no loop here."""
    x, z, dx, dz, _, _ = rays
    t, nx, nz = found.distance, found.work[0], found.work[1]
    kind, shape = tables.kind[c], tables.shape
    if kind == SEGMENT:
        across, along = -shape[c, 3], shape[c, 2]
        for i in range(n):
            nx[i], nz[i] = across, along
    elif kind == CONIC:
        q = conic_row(shape, c)
        for i in range(n):
            nx[i], nz[i] = conic_normal(k, q, x[i] + t[i] * dx[i], z[i] + t[i] * dz[i])
    elif kind == ARC:
        a = arc_row(shape, c)
        for i in range(n):
            nx[i], nz[i] = arc_normal(a, x[i] + t[i] * dx[i], z[i] + t[i] * dz[i])
    elif kind == OVAL:
        o = oval_row(shape, c)
        for i in range(n):
            nx[i], nz[i] = oval_normal(o, x[i] + t[i] * dx[i], z[i] + t[i] * dz[i])
    return kind in (SEGMENT, CONIC, ARC, OVAL)


@compiled
def refract(
    k: Precision,
    tables: Tables,
    rules: Rules,
    c: int,
    n: int,
    rays: Rays,
    carried: Carried,
    found: Found,
    fate: IntArray,
) -> None:
    """Refract or reflect the rays of a block that meet curve ``c``."""
    x, z, dx, dz, last, _ = rays
    t, which, work = found.distance, found.curve, found.work
    nx, nz, on_x, on_z, way, side = work[0], work[1], work[2], work[3], work[4], work[5]
    left, right, behaviour = tables.left[c], tables.right[c], tables.behaviour[c]
    indices(tables, c, n, carried, found)
    n_left, n_right = work[6], work[7]
    for i in range(n):
        a, b, from_right = n_left[i], n_right[i], dx[i] * nx[i] + dz[i] * nz[i] > 0.0
        n1, n2 = (b if from_right else a), (a if from_right else b)
        ways = bend(k, behaviour, COUNT, dx[i], dz[i], nx[i], nz[i], n1, n2)
        back = ways.share_s > 0.0
        on_x[i], on_z[i] = (ways.back_x if back else ways.on_x), (ways.back_z if back else ways.on_z)
        side[i] = k.one if back == from_right else k.zero
        way[i] = n1 * t[i]
    region, hits, optical = carried.region, carried.hits, carried.optical
    for i in range(n):
        here = right if dx[i] * nx[i] + dz[i] * nz[i] > 0.0 else left
        known, clear = (region[i] == here) | (region[i] == -1), (t[i] > k.corner) | (last[i] < 0)
        before = fate[i]
        meets = (which[i] == c) & (before == ASIDE)
        mine = meets & known & clear & (hits[i] + 1 < rules.max_hits)
        fate[i] = GOES_ON if mine else (LEFT if meets else before)
    for i in range(n):
        mine = (which[i] == c) & (fate[i] == GOES_ON)
        old_x, old_z, old = x[i], z[i], optical[i]
        px, pz, new = old_x + t[i] * dx[i], old_z + t[i] * dz[i], old + way[i]
        x[i], z[i], optical[i] = (px if mine else old_x), (pz if mine else old_z), (new if mine else old)
    for i in range(n):
        mine = (which[i] == c) & (fate[i] == GOES_ON)
        old_x, old_z, new_x, new_z = dx[i], dz[i], on_x[i], on_z[i]
        dx[i], dz[i] = (new_x if mine else old_x), (new_z if mine else old_z)
    for i in range(n):
        mine = (which[i] == c) & (fate[i] == GOES_ON)
        old_last, old_region, old_hits = last[i], region[i], hits[i]
        new_region = right if side[i] == k.one else left
        last[i], region[i] = (c if mine else old_last), (new_region if mine else old_region)
        hits[i] = old_hits + 1 if mine else old_hits


@compiled
def indices(tables: Tables, c: int, n: int, carried: Carried, found: Found) -> None:
    """Write the refractive indices on both sides of curve ``c`` at each ray's wavelength."""
    index, colour = tables.refractive_index, carried.colour
    n_left, n_right, left, right = found.work[6], found.work[7], tables.left[c], tables.right[c]
    if len(index) == 1:
        on_left, on_right = index[0, left], index[0, right]
        for i in range(n):
            n_left[i], n_right[i] = on_left, on_right
    else:
        for i in range(n):
            n_left[i], n_right[i] = index[colour[i], left], index[colour[i], right]


@compiled
def end(
    k: Precision,
    tables: Tables,
    c: int,
    n: int,
    rays: Rays,
    carried: Carried,
    found: Found,
    fate: IntArray,
) -> None:
    """End the rays of a block that meet curve ``c``, a receiver or a black wall."""
    dx, dz, last = rays.dx, rays.dz, rays.last
    t, which, work = found.distance, found.curve, found.work
    nx, nz, n_left, n_right = work[0], work[1], work[6], work[7]
    left, right, region, optical = tables.left[c], tables.right[c], carried.region, carried.optical
    receives = tables.behaviour[c] == RECEIVER
    indices(tables, c, n, carried, found)
    for i in range(n):
        a, b, from_right = n_left[i], n_right[i], dx[i] * nx[i] + dz[i] * nz[i] > 0.0
        here = right if from_right else left
        known, clear = (region[i] == here) | (region[i] == -1), (t[i] > k.corner) | (last[i] < 0)
        before, way = fate[i], optical[i]
        meets = (which[i] == c) & (before == ASIDE)
        mine = meets & known & clear
        ended = DETECTED if receives & (not from_right) else ABSORBED
        fate[i] = ended if mine else (LEFT if meets else before)
        new = way + (b if from_right else a) * t[i]
        optical[i] = new if mine else way

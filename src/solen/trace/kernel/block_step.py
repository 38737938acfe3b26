"""Vectorised passage of a block of rays through the bare curves that they meet.

The normal, Snell's law and Fresnel's equations involve the same arithmetic for each ray. Branch-free inner loops run
over the rays of a block, curve by curve: they compute the result of the curve for each ray of the block, and apply it
to the rays that meet the curve. All other cases (corners, rays in a wrong region, treated surfaces, curves that few
rays meet) are left to the loop over single rays.
"""

import math

from solen.trace.kernel.buffers import (
    AT,
    COLOUR,
    DX,
    DZ,
    HIT,
    LAST,
    LEAST,
    NUMBER,
    OPTICAL,
    REGION,
    Buffers,
    Carried,
    P,
    Rays,
    S,
    X,
    Z,
)
from solen.trace.kernel.compiled import compiled, summed
from solen.trace.kernel.hits import arc_normal, conic_normal, oval_normal
from solen.trace.kernel.rows import (
    ABSORBING,
    ARC,
    CONIC,
    OVAL,
    RECEIVER,
    SEGMENT,
    SPLITTER,
    Floats,
    Precision,
    Tags,
    arc_row,
    as_in,
    conic_row,
    oval_row,
)
from solen.trace.kernel.step import Rules, escape
from solen.trace.kernel.surface import BRANCHES, COUNT, bend
from solen.trace.kernel.tally import CUT, HITS, Sums, note_place
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON, TRUNCATED
from solen.trace.tables import Tables

ASIDE, LEFT = -1, -2
"""Marks for a ray that has not been treated here yet, and for a ray left to the loop over single rays, which treats
both.
"""
MAX_CURVES = 12
"""Maximum number of curves per block that are treated in this way: neighbouring rays meet few curves."""
MIN_RAYS = 4
"""Minimum number of rays for which a curve is treated in this way."""
MAX_HITS = 2**30
NX, NZ, ON_X, ON_Z, BACK_X, BACK_Z, SHARE_S, SHARE_P, N_LEFT, N_RIGHT, WAY, FROM_RIGHT, KEPT = range(13)
FIRST_BACK, OTHER_S, OTHER_P, TOO_WEAK = SHARE_S, SHARE_P, N_LEFT, N_RIGHT
"""Rows of working memory; the last ones reuse rows that are no longer needed."""


@compiled
def pass_block(
    k: Precision, tables: Tables, rules: Rules, sums: Sums, n: int, rays: Rays, carried: Carried, buffers: Buffers,
    clear: bool, waiting: int,
) -> tuple[int, int]:  # fmt: skip
    """Take rays 0 to n through the curves that they meet, and add the powers of rays that end.

    ``buffers.found.pick`` (BLOCK,) receives the fate of each ray, `ASIDE` or `LEFT`; continuing rays are updated in
    place. If media are ``clear``, nothing is absorbed on the way. Returns the number of waiting branches, and the
    number of rays left to the loop over single rays.
    """
    which, fate = buffers.found.curve, buffers.found.pick
    miss(k, tables, rules, n, carried, buffers, clear)
    first = 0
    for _ in range(MAX_CURVES):
        while first < n and fate[first] != ASIDE:
            first += 1
        if first == n:
            break
        c = which[first]
        first += 1
        behaviour = tables.behaviour[c]
        if not enough(c, n, buffers) or behaviour >= SPLITTER or not normals(k, tables, c, n, rays, buffers):
            put_off(c, n, buffers)
        elif behaviour in (RECEIVER, ABSORBING):
            end(k, tables, sums, c, n, rays, carried, buffers, clear)
        else:
            waiting = cross(k, tables, rules, sums, c, n, rays, carried, buffers, clear, waiting)
    left, hits, nothing = 0, 0, as_in(which[0], -1)
    for i in range(n):
        left += fate[i] < 0
        hits += (fate[i] >= 0) & (which[i] > nothing)
    sums.counts[HITS] += hits
    for ended in (ESCAPED, ABSORBED):
        sums.fate[ended] += power_of(as_in(which[0], ended), n, carried, fate)
    return waiting, left


@compiled
def miss(k: Precision, tables: Tables, rules: Rules, n: int, carried: Carried, buffers: Buffers, clear: bool) -> None:
    """Write the fates of rays that meet no curve; mark the other rays."""
    which, fate = buffers.found.curve, buffers.found.pick
    nothing, aside, escaped = as_in(which[0], -1), as_in(which[0], ASIDE), as_in(which[0], ESCAPED)
    for i in range(n):
        fate[i] = escaped if which[i] == nothing else aside
    if not clear:
        for i in range(n):
            if which[i] < 0:
                fate[i] = escape(k, tables, rules, carried.region[i], carried.colour[i])[1]


@compiled
def enough(c: int, n: int, buffers: Buffers) -> bool:
    """Whether enough rays of a block meet a curve for this loop to treat them all."""
    many, which, mine = 0, buffers.found.curve, as_in(buffers.found.curve[0], c)
    for i in range(n):
        many += which[i] == mine
    return many >= MIN_RAYS


@compiled
def put_off(c: int, n: int, buffers: Buffers) -> None:
    """Leave the rays that meet a curve to the loop over single rays."""
    which, fate, mine, left = (
        buffers.found.curve,
        buffers.found.pick,
        as_in(buffers.found.curve[0], c),
        as_in(buffers.found.curve[0], LEFT),
    )
    for i in range(n):
        before = fate[i]
        fate[i] = left if which[i] == mine else before


@compiled
def absorbs(absorption: Floats) -> bool:
    """Whether a medium absorbs at any wavelength."""
    for colour in range(absorption.shape[0]):
        for region in range(absorption.shape[1]):
            if absorption[colour, region] > 0.0:
                return True
    return False


@summed
def power_of(ended: int, n: int, carried: Carried, fate: Tags) -> float:
    """Total power of the rays in a block with one fate."""
    total, s, p = 0.0, carried.s, carried.p
    for i in range(n):
        own = s[i] + p[i]
        total += own if fate[i] == ended else 0.0
    return total


@compiled
def normals(k: Precision, tables: Tables, c: int, n: int, rays: Rays, buffers: Buffers) -> bool:
    """Write the normals of curve ``c`` where the rays of a block meet it; return False if its kind has no loop here."""
    x, z, dx, dz, _, _ = rays
    t, nx, nz = buffers.found.distance, buffers.found.work[NX], buffers.found.work[NZ]
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
def approach(
    k: Precision, tables: Tables, c: int, n: int, rays: Rays, carried: Carried, buffers: Buffers, most: int,
    on_left: int, on_right: int,
) -> None:  # fmt: skip
    """Write the fates of rays that meet curve ``c`` from its left and its right, or leave them to the other loop."""
    dx, dz, last = rays.dx, rays.dz, rays.last
    found, work, region, hits = buffers.found, buffers.found.work, carried.region, carried.hits
    t, which, fate, nx, nz, from_right = found.distance, found.curve, found.pick, work[NX], work[NZ], work[FROM_RIGHT]
    one = which[0]
    mine, left, right, most = as_in(one, c), as_in(one, tables.left[c]), as_in(one, tables.right[c]), as_in(one, most)
    on_left, on_right, put_off, unknown = as_in(one, on_left), as_in(one, on_right), as_in(one, LEFT), as_in(one, -1)
    for i in range(n):
        comes, stands, place, before = dx[i] * nx[i] + dz[i] * nz[i] > 0.0, last[i], region[i], fate[i]
        from_right[i] = k.one if comes else k.zero
        here = right if comes else left
        known, clear = (place == here) | (place == unknown), (t[i] > k.corner) | (stands <= unknown)
        taken = on_right if comes else on_left
        becomes = taken if known & clear & (hits[i] < most) else put_off
        fate[i] = becomes if which[i] == mine else before


@compiled
def indices(tables: Tables, c: int, n: int, carried: Carried, buffers: Buffers) -> None:
    """Write the refractive indices on both sides of curve ``c`` at each ray's wavelength, and the optical path."""
    index, colour, work, t = tables.refractive_index, carried.colour, buffers.found.work, buffers.found.distance
    n_left, n_right, way, left, right = work[N_LEFT], work[N_RIGHT], work[WAY], tables.left[c], tables.right[c]
    if len(index) == 1:
        on_left, on_right = index[0, left], index[0, right]
        for i in range(n):
            n_left[i], n_right[i] = on_left, on_right
    else:
        for i in range(n):
            n_left[i], n_right[i] = index[colour[i], left], index[colour[i], right]
    from_right = work[FROM_RIGHT]
    for i in range(n):
        on_left, on_right = n_left[i], n_right[i]
        way[i] = (on_right if from_right[i] > 0.0 else on_left) * t[i]


@compiled
def weaken(tables: Tables, c: int, n: int, carried: Carried, buffers: Buffers) -> None:
    """Write the fraction of the power that remains after the media on the way to curve ``c``."""
    work, t, which = buffers.found.work, buffers.found.distance, buffers.found.curve
    from_right, kept, absorption = work[FROM_RIGHT], work[KEPT], tables.absorption
    for i in range(n):
        if which[i] == c:
            here = tables.right[c] if from_right[i] > 0.0 else tables.left[c]
            kept[i] = math.exp(-absorption[carried.colour[i], here] * t[i])


@summed
def absorb(mine: int, n: int, carried: Carried, buffers: Buffers, one: int, other: int) -> float:
    """Subtract the absorbed power from rays at curve ``mine`` that have one of two fates; return the total absorbed."""
    s, p, kept, which, fate = carried.s, carried.p, buffers.found.work[KEPT], buffers.found.curve, buffers.found.pick
    lost, whole = 0.0, as_in(s[0], 1.0)
    for i in range(n):
        old_s, old_p, share = s[i], p[i], kept[i]
        left = share if (which[i] == mine) & ((fate[i] == one) | (fate[i] == other)) else whole
        new_s, new_p = left * old_s, left * old_p
        s[i], p[i] = new_s, new_p
        lost += (old_s + old_p) - (new_s + new_p)
    return lost


@compiled
def end(
    k: Precision,
    tables: Tables,
    sums: Sums,
    c: int,
    n: int,
    rays: Rays,
    carried: Carried,
    buffers: Buffers,
    clear: bool,
) -> None:
    """End the rays of a block that meet curve ``c``, which is a receiver or a black wall."""
    which, fate, way = buffers.found.curve, buffers.found.pick, buffers.found.work[WAY]
    receives, one = tables.behaviour[c] == RECEIVER, which[0]
    mine, detected = as_in(one, c), as_in(one, DETECTED)
    approach(k, tables, c, n, rays, carried, buffers, MAX_HITS, DETECTED if receives else ABSORBED, ABSORBED)
    indices(tables, c, n, carried, buffers)
    if not clear:
        weaken(tables, c, n, carried, buffers)
        sums.fate[ABSORBED] += absorb(mine, n, carried, buffers, detected, as_in(one, ABSORBED))
    if not receives:
        return
    receiver = tables.receiver[c]
    power, optical, many = arrivals(mine, detected, n, carried, way, which, fate)
    sums.fate[DETECTED] += power
    sums.detected[receiver] += power
    sums.arrived[receiver] += many
    sums.optical[receiver] += optical


@summed
def arrivals(
    mine: int, detected: int, n: int, carried: Carried, way: Floats, which: Tags, fate: Tags
) -> tuple[float, float, int]:
    """Return the power that a receiver detects, the sum of power times optical path, and the number of rays."""
    power, optical, many, s, p, before = 0.0, 0.0, 0, carried.s, carried.p, carried.optical
    for i in range(n):
        arrives, both, path = (which[i] == mine) & (fate[i] == detected), s[i] + p[i], before[i] + way[i]
        own, far = (
            (both if arrives else 0.0),
            (path if arrives else 0.0),
        )  # the distance of a ray without a hit is infinite
        power += own
        optical += own * far
        many += arrives
    return power, optical, many


@compiled
def cross(
    k: Precision, tables: Tables, rules: Rules, sums: Sums, c: int, n: int, rays: Rays, carried: Carried,
    buffers: Buffers, clear: bool, waiting: int,
) -> int:  # fmt: skip
    """Refract and reflect the rays of a block that meet curve ``c``; return the number of waiting branches."""
    one, splits = buffers.found.curve[0], rules.splitting == BRANCHES
    mine, goes_on = as_in(one, c), as_in(one, GOES_ON)
    approach(k, tables, c, n, rays, carried, buffers, min(rules.max_hits - 1, MAX_HITS), GOES_ON, GOES_ON)
    indices(tables, c, n, carried, buffers)
    if not clear:
        weaken(tables, c, n, carried, buffers)
        spare_the_weak(mine, n, carried, buffers)
        sums.fate[ABSORBED] += absorb(mine, n, carried, buffers, goes_on, goes_on)
    if splits:
        both_ways(k, tables.behaviour[c], n, rays, buffers)
        divide(k, mine, n, carried, buffers)
    else:
        one_way(k, tables.behaviour[c], n, rays, buffers)
    advance(tables, c, n, rays, carried, buffers)
    return part_with(tables, sums, c, n, rays, buffers, waiting) if splits else waiting


@compiled
def spare_the_weak(mine: int, n: int, carried: Carried, buffers: Buffers) -> None:
    """Leave rays that are too weak when they reach curve ``mine`` to the other loop."""
    s, p, least, kept = carried.s, carried.p, carried.least, buffers.found.work[KEPT]
    which, fate, put_off = buffers.found.curve, buffers.found.pick, as_in(mine, LEFT)
    for i in range(n):
        weak, before = kept[i] * (s[i] + p[i]) < least[i], fate[i]
        fate[i] = put_off if (which[i] == mine) & weak else before


@compiled
def one_way(k: Precision, behaviour: int, n: int, rays: Rays, buffers: Buffers) -> None:
    """Write the direction of each ray in counting mode: refracted, or reflected in total reflection."""
    dx, dz, work = rays.dx, rays.dz, buffers.found.work
    nx, nz, on_x, on_z, n_left, n_right = work[NX], work[NZ], work[ON_X], work[ON_Z], work[N_LEFT], work[N_RIGHT]
    from_right, back = work[FROM_RIGHT], work[FIRST_BACK]
    for i in range(n):
        turned = from_right[i] > 0.0
        a, b = n_left[i], n_right[i]
        n1, n2 = (b if turned else a), (a if turned else b)
        ways = bend(k, behaviour, COUNT, dx[i], dz[i], nx[i], nz[i], n1, n2)
        total = ways.share_s > 0.0
        on_x[i], on_z[i] = (ways.back_x if total else ways.on_x), (ways.back_z if total else ways.on_z)
        back[i] = k.one if total else k.zero


@compiled
def both_ways(k: Precision, behaviour: int, n: int, rays: Rays, buffers: Buffers) -> None:
    """Write both directions of each ray at a curve, and the reflected power fractions for s and p."""
    dx, dz, work = rays.dx, rays.dz, buffers.found.work
    nx, nz, on_x, on_z, n_left, n_right = work[NX], work[NZ], work[ON_X], work[ON_Z], work[N_LEFT], work[N_RIGHT]
    from_right, back_x, back_z = work[FROM_RIGHT], work[BACK_X], work[BACK_Z]
    share_s, share_p = work[SHARE_S], work[SHARE_P]
    for i in range(n):
        turned = from_right[i] > 0.0
        a, b = n_left[i], n_right[i]
        n1, n2 = (b if turned else a), (a if turned else b)
        ways = bend(k, behaviour, BRANCHES, dx[i], dz[i], nx[i], nz[i], n1, n2)
        on_x[i], on_z[i], back_x[i], back_z[i] = ways.on_x, ways.on_z, ways.back_x, ways.back_z
        share_s[i], share_p[i] = ways.share_s, ways.share_p


@compiled
def divide(k: Precision, mine: int, n: int, carried: Carried, buffers: Buffers) -> None:
    """Choose which part of each ray is followed first, the weaker of two, and compute the powers of the other.

    The direction of the first part then replaces the refracted direction, and that of the other part the reflected one.
    """
    s, p, least, work = carried.s, carried.p, carried.least, buffers.found.work
    share_s, share_p, weak = work[SHARE_S], work[SHARE_P], work[TOO_WEAK]
    first_back, other_s, other_p = work[FIRST_BACK], work[OTHER_S], work[OTHER_P]
    which, fate, goes_on = buffers.found.curve, buffers.found.pick, as_in(mine, GOES_ON)
    ended = as_in(mine, TRUNCATED)
    for i in range(n):
        old_s, old_p, before = s[i], p[i], fate[i]
        taken = (which[i] == mine) & (before == goes_on)
        back_s, back_p = share_s[i] * old_s, share_p[i] * old_p
        on_s, on_p = old_s - back_s, old_p - back_p
        on, back = on_s + on_p, back_s + back_p
        strong_on, strong_back = on >= least[i], back >= least[i]
        both, turns = taken & strong_on & strong_back, strong_back & ((back <= on) | (not strong_on))
        weak[i] = ((k.zero if strong_on else on) + (k.zero if strong_back else back)) if taken else k.zero
        other_s[i] = (on_s if turns else back_s) if both else -k.one
        other_p[i] = on_p if turns else back_p
        first_back[i] = k.one if turns else k.zero
        s[i] = (back_s if turns else on_s) if taken else old_s
        p[i] = (back_p if turns else on_p) if taken else old_p
        fate[i] = ended if taken & (not (strong_on | strong_back)) else before
    on_x, on_z, back_x, back_z = work[ON_X], work[ON_Z], work[BACK_X], work[BACK_Z]
    for i in range(n):
        a_x, a_z, b_x, b_z, turns = on_x[i], on_z[i], back_x[i], back_z[i], first_back[i] > 0.0
        on_x[i], on_z[i] = (b_x if turns else a_x), (b_z if turns else a_z)
        back_x[i], back_z[i] = (a_x if turns else b_x), (a_z if turns else b_z)


@compiled
def advance(tables: Tables, c: int, n: int, rays: Rays, carried: Carried, buffers: Buffers) -> None:
    """Move rays that continue at curve ``c`` to their hit points, in the direction of the part followed first."""
    x, z, dx, dz, last, _ = rays
    found, work, optical, region, hits = (
        buffers.found,
        buffers.found.work,
        carried.optical,
        carried.region,
        carried.hits,
    )
    t, which, fate, way = found.distance, found.curve, found.pick, work[WAY]
    on_x, on_z, from_right, first_back = work[ON_X], work[ON_Z], work[FROM_RIGHT], work[FIRST_BACK]
    one = which[0]
    mine, left, right = as_in(one, c), as_in(one, tables.left[c]), as_in(one, tables.right[c])
    aside = as_in(one, ASIDE)
    for i in range(n):
        taken = (which[i] == mine) & (fate[i] > aside)
        old_x, old_z, old = x[i], z[i], optical[i]
        new_x, new_z, new = old_x + t[i] * dx[i], old_z + t[i] * dz[i], old + way[i]
        x[i], z[i], optical[i] = (new_x if taken else old_x), (new_z if taken else old_z), (new if taken else old)
    for i in range(n):
        taken = (which[i] == mine) & (fate[i] > aside)
        old_x, old_z, new_x, new_z = dx[i], dz[i], on_x[i], on_z[i]
        dx[i], dz[i] = (new_x if taken else old_x), (new_z if taken else old_z)
    for i in range(n):
        taken = (which[i] == mine) & (fate[i] > aside)
        old_last, old_region, old_hits = last[i], region[i], hits[i]
        new_region = right if from_right[i] == first_back[i] else left
        last[i], region[i] = (mine if taken else old_last), (new_region if taken else old_region)
        hits[i] = old_hits + 1 if taken else old_hits


@compiled
def part_with(tables: Tables, sums: Sums, c: int, n: int, rays: Rays, buffers: Buffers, waiting: int) -> int:
    """Let the other parts of rays wait, or truncate those that are too weak; return the number of waiting branches."""
    state, tags, work = buffers.state, buffers.tags, buffers.found.work
    for i in range(n):
        if work[TOO_WEAK, i] > 0.0:
            sums.fate[TRUNCATED] += work[TOO_WEAK, i]
            note_place(sums, CUT, rays.x[i], rays.z[i])
        if work[OTHER_S, i] >= 0.0:
            row, tag, back = buffers.waiting_state[waiting], buffers.waiting_tags[waiting], work[FIRST_BACK, i] == 0.0
            row[X], row[Z], row[S], row[P] = state[X, i], state[Z, i], work[OTHER_S, i], work[OTHER_P, i]
            row[DX], row[DZ] = work[BACK_X, i], work[BACK_Z, i]
            row[LEAST], row[AT], row[OPTICAL] = state[LEAST, i], state[AT, i], state[OPTICAL, i]
            right = (work[FROM_RIGHT, i] > 0.0) == back
            tag[REGION], tag[LAST] = tables.right[c] if right else tables.left[c], c
            tag[HIT], tag[NUMBER], tag[COLOUR] = tags[HIT, i], tags[NUMBER, i], tags[COLOUR, i]
            waiting += 1
    return waiting

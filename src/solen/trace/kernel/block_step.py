"""Vectorised refraction and reflection of a block of rays at bare curves.

The normal, Snell's law and Fresnel's equations involve the same arithmetic for each ray. Branch-free inner loops run
over the rays of a block, curve by curve: they compute the effect of the curve on each ray of the block, and apply it to
the rays that meet the curve. All other cases (corners, rays in a wrong region, treated surfaces, curves that few rays
meet) are left to the loop over single rays.
"""

import math

from solen.trace.kernel.buffers import (
    COLOUR,
    DX,
    DZ,
    HIT,
    LAST,
    MIN_POWER,
    NUMBER,
    OPTICAL,
    REGION,
    Buffers,
    Loads,
    P,
    Rays,
    S,
    U,
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
    conic_row,
    oval_row,
    typed,
)
from solen.trace.kernel.step import Rules, escape
from solen.trace.kernel.surface import BRANCHES, COUNT, deflection
from solen.trace.kernel.tally import HITS, TRUNCATIONS, Sums, store_location
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON, TRUNCATED
from solen.trace.tables import Tables

UNTREATED, DEFERRED = -1, -2
"""Marks for a ray that has not been treated yet, and for a ray left to the loop over single rays. That loop treats rays
with either mark.
"""
MAX_CURVES = 12
"""Maximum number of curves per block that are treated here: neighbouring rays meet few curves."""
MIN_RAYS = 4
"""Minimum number of rays that meet a curve for it to be treated here."""
MAX_HITS = 2**30
NX, NZ, ON_X, ON_Z, BACK_X, BACK_Z, R_S, R_P, N_LEFT, N_RIGHT, OPTICAL_PATH, FROM_RIGHT, TRANSMITTED = range(13)
FIRST_BACK, OTHER_S, OTHER_P, TRUNCATED_POWER = R_S, R_P, N_LEFT, N_RIGHT
"""Rows of working memory; the second line reuses rows that are no longer needed."""


@compiled
def pass_block(
    k: Precision, tables: Tables, rules: Rules, sums: Sums, n: int, rays: Rays, loads: Loads, buffers: Buffers,
    clear: bool, waiting: int,
) -> tuple[int, int]:  # fmt: skip
    """Take rays 0 to n through the curves that they meet, and add the powers of rays that end.

    ``buffers.hit.int_work`` (BLOCK,) receives the fate of each ray, `UNTREATED` or `DEFERRED`; rays that continue are
    updated in place. ``clear`` means that no medium absorbs. Returns the number of waiting branches, and the number of
    rays left to the loop over single rays.
    """
    curve, fate = buffers.hit.curve, buffers.hit.int_work
    escape_block(k, tables, rules, n, loads, buffers, clear)
    first = 0
    for _ in range(MAX_CURVES):
        while first < n and fate[first] != UNTREATED:
            first += 1
        if first == n:
            break
        c = curve[first]
        first += 1
        behaviour = tables.behaviour[c]
        if not enough_rays(c, n, buffers) or behaviour >= SPLITTER or not normals(k, tables, c, n, rays, buffers):
            defer(c, n, buffers)
        elif behaviour in (RECEIVER, ABSORBING):
            end_rays(k, tables, sums, c, n, rays, loads, buffers, clear)
        else:
            waiting = cross_curve(k, tables, rules, sums, c, n, rays, loads, buffers, clear, waiting)
    deferred, hits, nothing = 0, 0, typed(curve[0], -1)
    for i in range(n):
        deferred += fate[i] < 0
        hits += (fate[i] >= 0) & (curve[i] > nothing)
    sums.counts[HITS] += hits
    for ended in (ESCAPED, ABSORBED):
        sums.fate[ended] += power_with_fate(typed(curve[0], ended), n, loads, fate)
    return waiting, deferred


@compiled
def escape_block(
    k: Precision, tables: Tables, rules: Rules, n: int, loads: Loads, buffers: Buffers, clear: bool
) -> None:
    """Write the fates of rays that meet no curve; mark the other rays as untreated."""
    curve, fate = buffers.hit.curve, buffers.hit.int_work
    nothing, untreated, escaped = typed(curve[0], -1), typed(curve[0], UNTREATED), typed(curve[0], ESCAPED)
    for i in range(n):
        fate[i] = escaped if curve[i] == nothing else untreated
    if not clear:
        for i in range(n):
            if curve[i] < 0:
                fate[i] = escape(k, tables, rules, loads.region[i], loads.colour[i])[1]


@compiled
def enough_rays(c: int, n: int, buffers: Buffers) -> bool:
    """Whether enough rays of a block meet a curve for it to be treated here."""
    count, curve, tag = 0, buffers.hit.curve, typed(buffers.hit.curve[0], c)
    for i in range(n):
        count += curve[i] == tag
    return count >= MIN_RAYS


@compiled
def defer(c: int, n: int, buffers: Buffers) -> None:
    """Leave the rays that meet a curve to the loop over single rays."""
    curve, fate = buffers.hit.curve, buffers.hit.int_work
    tag, deferred = typed(curve[0], c), typed(curve[0], DEFERRED)
    for i in range(n):
        old_fate = fate[i]
        fate[i] = deferred if curve[i] == tag else old_fate


@compiled
def absorbs(absorption: Floats) -> bool:
    """Whether a medium absorbs at any wavelength."""
    for colour in range(absorption.shape[0]):
        for region in range(absorption.shape[1]):
            if absorption[colour, region] > 0.0:
                return True
    return False


@summed
def power_with_fate(ended: int, n: int, loads: Loads, fate: Tags) -> float:
    """Total power of the rays in a block with one fate."""
    total, s, p = 0.0, loads.s, loads.p
    for i in range(n):
        power = s[i] + p[i]
        total += power if fate[i] == ended else 0.0
    return total


@compiled
def normals(k: Precision, tables: Tables, c: int, n: int, rays: Rays, buffers: Buffers) -> bool:
    """Write the normals of curve ``c`` where the rays of a block meet it; return False if its kind has no loop here."""
    x, z, dx, dz, _, _ = rays
    t, nx, nz = buffers.hit.distance, buffers.hit.work[NX], buffers.hit.work[NZ]
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
    k: Precision, tables: Tables, c: int, n: int, rays: Rays, loads: Loads, buffers: Buffers, max_hits: int,
    on_left: int, on_right: int,
) -> None:  # fmt: skip
    """Write the fates of rays that meet curve ``c`` from its left and its right, or defer them."""
    dx, dz, last, region, hits = rays.dx, rays.dz, rays.last, loads.region, loads.hits
    t, curve, fate, work = buffers.hit.distance, buffers.hit.curve, buffers.hit.int_work, buffers.hit.work
    nx, nz, from_right = work[NX], work[NZ], work[FROM_RIGHT]
    sample = curve[0]
    tag, left, right = typed(sample, c), typed(sample, tables.left[c]), typed(sample, tables.right[c])
    max_hits, on_left, on_right = typed(sample, max_hits), typed(sample, on_left), typed(sample, on_right)
    deferred, unknown = typed(sample, DEFERRED), typed(sample, -1)
    for i in range(n):
        is_right, start, ray_region, old_fate = dx[i] * nx[i] + dz[i] * nz[i] > 0.0, last[i], region[i], fate[i]
        from_right[i] = k.one if is_right else k.zero
        medium = right if is_right else left
        known, no_corner = (ray_region == medium) | (ray_region == unknown), (t[i] > k.corner) | (start <= unknown)
        fate_here = on_right if is_right else on_left
        new_fate = fate_here if known & no_corner & (hits[i] < max_hits) else deferred
        fate[i] = new_fate if curve[i] == tag else old_fate


@compiled
def indices(tables: Tables, c: int, n: int, loads: Loads, buffers: Buffers) -> None:
    """Write the refractive indices on both sides of curve ``c`` at each ray's wavelength, and the optical path."""
    index, colour, work, t = tables.refractive_index, loads.colour, buffers.hit.work, buffers.hit.distance
    n_left, n_right, optical_path = work[N_LEFT], work[N_RIGHT], work[OPTICAL_PATH]
    left, right = tables.left[c], tables.right[c]
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
        optical_path[i] = (on_right if from_right[i] > 0.0 else on_left) * t[i]


@compiled
def transmittances(tables: Tables, c: int, n: int, loads: Loads, buffers: Buffers) -> None:
    """Write the fraction of the power that remains after the media on the way to curve ``c``."""
    work, t, curve = buffers.hit.work, buffers.hit.distance, buffers.hit.curve
    from_right, transmitted, absorption = work[FROM_RIGHT], work[TRANSMITTED], tables.absorption
    for i in range(n):
        if curve[i] == c:
            medium = tables.right[c] if from_right[i] > 0.0 else tables.left[c]
            transmitted[i] = math.exp(-absorption[loads.colour[i], medium] * t[i])


@summed
def absorb(tag: int, n: int, loads: Loads, buffers: Buffers, fate_1: int, fate_2: int) -> float:
    """Subtract the absorbed power from rays at curve ``tag`` that have one of two fates; return the total absorbed."""
    s, p, transmitted = loads.s, loads.p, buffers.hit.work[TRANSMITTED]
    curve, fate = buffers.hit.curve, buffers.hit.int_work
    absorbed, one = 0.0, typed(s[0], 1.0)
    for i in range(n):
        old_s, old_p, fraction = s[i], p[i], transmitted[i]
        remaining = fraction if (curve[i] == tag) & ((fate[i] == fate_1) | (fate[i] == fate_2)) else one
        new_s, new_p = remaining * old_s, remaining * old_p
        s[i], p[i] = new_s, new_p
        absorbed += (old_s + old_p) - (new_s + new_p)
    return absorbed


@compiled
def end_rays(
    k: Precision, tables: Tables, sums: Sums, c: int, n: int, rays: Rays, loads: Loads, buffers: Buffers, clear: bool
) -> None:
    """End the rays of a block that meet curve ``c``, which is a receiver or a black wall."""
    curve, fate, optical_path = buffers.hit.curve, buffers.hit.int_work, buffers.hit.work[OPTICAL_PATH]
    receives, sample = tables.behaviour[c] == RECEIVER, curve[0]
    tag, detected = typed(sample, c), typed(sample, DETECTED)
    approach(k, tables, c, n, rays, loads, buffers, MAX_HITS, DETECTED if receives else ABSORBED, ABSORBED)
    indices(tables, c, n, loads, buffers)
    if not clear:
        transmittances(tables, c, n, loads, buffers)
        sums.fate[ABSORBED] += absorb(tag, n, loads, buffers, detected, typed(sample, ABSORBED))
    if not receives:
        return
    receiver = tables.receiver[c]
    power, optical, count = arrivals(tag, detected, n, loads, optical_path, curve, fate)
    sums.fate[DETECTED] += power
    sums.detected[receiver] += power
    sums.arrived[receiver] += count
    sums.optical[receiver] += optical


@summed
def arrivals(
    tag: int, detected: int, n: int, loads: Loads, optical_path: Floats, curve: Tags, fate: Tags
) -> tuple[float, float, int]:
    """Return the power that a receiver detects, the sum of power times optical path, and the number of rays."""
    power, optical, count, s, p, before = 0.0, 0.0, 0, loads.s, loads.p, loads.optical
    for i in range(n):
        arrives, both, path = (curve[i] == tag) & (fate[i] == detected), s[i] + p[i], before[i] + optical_path[i]
        # the distance of a ray without a hit is infinite
        arrived_power, arrived_path = (both if arrives else 0.0), (path if arrives else 0.0)
        power += arrived_power
        optical += arrived_power * arrived_path
        count += arrives
    return power, optical, count


@compiled
def cross_curve(
    k: Precision, tables: Tables, rules: Rules, sums: Sums, c: int, n: int, rays: Rays, loads: Loads,
    buffers: Buffers, clear: bool, waiting: int,
) -> int:  # fmt: skip
    """Refract and reflect the rays of a block that meet curve ``c``; return the number of waiting branches."""
    sample, splits = buffers.hit.curve[0], rules.splitting == BRANCHES
    tag, goes_on = typed(sample, c), typed(sample, GOES_ON)
    approach(k, tables, c, n, rays, loads, buffers, min(rules.max_hits - 1, MAX_HITS), GOES_ON, GOES_ON)
    indices(tables, c, n, loads, buffers)
    if not clear:
        transmittances(tables, c, n, loads, buffers)
        defer_weak(tag, n, loads, buffers)
        sums.fate[ABSORBED] += absorb(tag, n, loads, buffers, goes_on, goes_on)
    if splits:
        split_directions(k, tables.behaviour[c], n, rays, buffers)
        choose_first(k, tag, n, loads, buffers)
    else:
        count_directions(k, tables.behaviour[c], n, rays, buffers)
    advance(tables, c, n, rays, loads, buffers)
    return store_branches(tables, sums, c, n, rays, buffers, waiting) if splits else waiting


@compiled
def defer_weak(tag: int, n: int, loads: Loads, buffers: Buffers) -> None:
    """Leave rays that are too weak on arrival at curve ``tag`` to the loop over single rays."""
    s, p, min_power, transmitted = loads.s, loads.p, loads.min_power, buffers.hit.work[TRANSMITTED]
    curve, fate, deferred = buffers.hit.curve, buffers.hit.int_work, typed(tag, DEFERRED)
    for i in range(n):
        is_weak, old_fate = transmitted[i] * (s[i] + p[i]) < min_power[i], fate[i]
        fate[i] = deferred if (curve[i] == tag) & is_weak else old_fate


@compiled
def count_directions(k: Precision, behaviour: int, n: int, rays: Rays, buffers: Buffers) -> None:
    """Write the direction of each ray in counting mode: refracted, or totally reflected."""
    dx, dz, work = rays.dx, rays.dz, buffers.hit.work
    nx, nz, on_x, on_z, n_left, n_right = work[NX], work[NZ], work[ON_X], work[ON_Z], work[N_LEFT], work[N_RIGHT]
    from_right, back = work[FROM_RIGHT], work[FIRST_BACK]
    for i in range(n):
        reversed_sides = from_right[i] > 0.0
        a, b = n_left[i], n_right[i]
        n1, n2 = (b if reversed_sides else a), (a if reversed_sides else b)
        deflected = deflection(k, behaviour, COUNT, dx[i], dz[i], nx[i], nz[i], n1, n2)
        total = deflected.reflectance_s > 0.0
        on_x[i] = deflected.back_x if total else deflected.on_x
        on_z[i] = deflected.back_z if total else deflected.on_z
        back[i] = k.one if total else k.zero


@compiled
def split_directions(k: Precision, behaviour: int, n: int, rays: Rays, buffers: Buffers) -> None:
    """Write both directions of each ray at a curve, and the reflected power fractions for s and p."""
    dx, dz, work = rays.dx, rays.dz, buffers.hit.work
    nx, nz, on_x, on_z, n_left, n_right = work[NX], work[NZ], work[ON_X], work[ON_Z], work[N_LEFT], work[N_RIGHT]
    from_right, back_x, back_z = work[FROM_RIGHT], work[BACK_X], work[BACK_Z]
    reflectance_s, reflectance_p = work[R_S], work[R_P]
    for i in range(n):
        reversed_sides = from_right[i] > 0.0
        a, b = n_left[i], n_right[i]
        n1, n2 = (b if reversed_sides else a), (a if reversed_sides else b)
        deflected = deflection(k, behaviour, BRANCHES, dx[i], dz[i], nx[i], nz[i], n1, n2)
        on_x[i], on_z[i], back_x[i], back_z[i] = deflected.on_x, deflected.on_z, deflected.back_x, deflected.back_z
        reflectance_s[i], reflectance_p[i] = deflected.reflectance_s, deflected.reflectance_p


@compiled
def choose_first(k: Precision, tag: int, n: int, loads: Loads, buffers: Buffers) -> None:
    """Choose the part of each ray to follow first (of two, the weaker), and compute the powers of the other part.

    The direction of the first part then replaces the refracted direction, and that of the other part the reflected one.
    """
    s, p, min_power, work = loads.s, loads.p, loads.min_power, buffers.hit.work
    reflectance_s, reflectance_p, truncated = work[R_S], work[R_P], work[TRUNCATED_POWER]
    first_back, other_s, other_p = work[FIRST_BACK], work[OTHER_S], work[OTHER_P]
    curve, fate, goes_on = buffers.hit.curve, buffers.hit.int_work, typed(tag, GOES_ON)
    truncated_fate = typed(tag, TRUNCATED)
    for i in range(n):
        old_s, old_p, old_fate = s[i], p[i], fate[i]
        treated = (curve[i] == tag) & (old_fate == goes_on)
        back_s, back_p = reflectance_s[i] * old_s, reflectance_p[i] * old_p
        on_s, on_p = old_s - back_s, old_p - back_p
        on, back = on_s + on_p, back_s + back_p
        strong_on, strong_back = on >= min_power[i], back >= min_power[i]
        both, reflected_first = treated & strong_on & strong_back, strong_back & ((back <= on) | (not strong_on))
        truncated[i] = ((k.zero if strong_on else on) + (k.zero if strong_back else back)) if treated else k.zero
        other_s[i] = (on_s if reflected_first else back_s) if both else -k.one
        other_p[i] = on_p if reflected_first else back_p
        first_back[i] = k.one if reflected_first else k.zero
        s[i] = (back_s if reflected_first else on_s) if treated else old_s
        p[i] = (back_p if reflected_first else on_p) if treated else old_p
        fate[i] = truncated_fate if treated & (not (strong_on | strong_back)) else old_fate
    on_x, on_z, back_x, back_z = work[ON_X], work[ON_Z], work[BACK_X], work[BACK_Z]
    for i in range(n):
        a_x, a_z, b_x, b_z, reflected_first = on_x[i], on_z[i], back_x[i], back_z[i], first_back[i] > 0.0
        on_x[i], on_z[i] = (b_x if reflected_first else a_x), (b_z if reflected_first else a_z)
        back_x[i], back_z[i] = (a_x if reflected_first else b_x), (a_z if reflected_first else b_z)


@compiled
def advance(tables: Tables, c: int, n: int, rays: Rays, loads: Loads, buffers: Buffers) -> None:
    """Move rays that continue at curve ``c`` to their hit points, in the direction of the part followed first."""
    x, z, dx, dz, last, _ = rays
    optical, region, hits, work = loads.optical, loads.region, loads.hits, buffers.hit.work
    t, curve, fate, optical_path = buffers.hit.distance, buffers.hit.curve, buffers.hit.int_work, work[OPTICAL_PATH]
    on_x, on_z, from_right, first_back = work[ON_X], work[ON_Z], work[FROM_RIGHT], work[FIRST_BACK]
    sample = curve[0]
    tag, left, right = typed(sample, c), typed(sample, tables.left[c]), typed(sample, tables.right[c])
    untreated = typed(sample, UNTREATED)
    for i in range(n):
        treated = (curve[i] == tag) & (fate[i] > untreated)
        old_x, old_z, old = x[i], z[i], optical[i]
        new_x, new_z, new = old_x + t[i] * dx[i], old_z + t[i] * dz[i], old + optical_path[i]
        x[i], z[i], optical[i] = (new_x if treated else old_x), (new_z if treated else old_z), (new if treated else old)
    for i in range(n):
        treated = (curve[i] == tag) & (fate[i] > untreated)
        old_x, old_z, new_x, new_z = dx[i], dz[i], on_x[i], on_z[i]
        dx[i], dz[i] = (new_x if treated else old_x), (new_z if treated else old_z)
    for i in range(n):
        treated = (curve[i] == tag) & (fate[i] > untreated)
        old_last, old_region, old_hits = last[i], region[i], hits[i]
        new_region = right if from_right[i] == first_back[i] else left
        last[i], region[i] = (tag if treated else old_last), (new_region if treated else old_region)
        hits[i] = old_hits + 1 if treated else old_hits


@compiled
def store_branches(tables: Tables, sums: Sums, c: int, n: int, rays: Rays, buffers: Buffers, waiting: int) -> int:
    """Store the other parts of rays as waiting branches, or truncate weak ones; return the number of branches."""
    state, tags, work = buffers.state, buffers.tags, buffers.hit.work
    for i in range(n):
        if work[TRUNCATED_POWER, i] > 0.0:
            sums.fate[TRUNCATED] += work[TRUNCATED_POWER, i]
            store_location(sums, TRUNCATIONS, rays.x[i], rays.z[i])
        if work[OTHER_S, i] >= 0.0:
            row, tag, back = buffers.waiting_state[waiting], buffers.waiting_tags[waiting], work[FIRST_BACK, i] == 0.0
            row[X], row[Z], row[S], row[P] = state[X, i], state[Z, i], work[OTHER_S, i], work[OTHER_P, i]
            row[DX], row[DZ] = work[BACK_X, i], work[BACK_Z, i]
            row[MIN_POWER], row[U], row[OPTICAL] = state[MIN_POWER, i], state[U, i], state[OPTICAL, i]
            right = (work[FROM_RIGHT, i] > 0.0) == back
            tag[REGION], tag[LAST] = tables.right[c] if right else tables.left[c], c
            tag[HIT], tag[NUMBER], tag[COLOUR] = tags[HIT, i], tags[NUMBER, i], tags[COLOUR, i]
            waiting += 1
    return waiting

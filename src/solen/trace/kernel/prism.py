"""One ray in space with all its branches, in an extruded body, for adaptive integration.

The steps are those of `solen.trace.kernel.extruded`. A ray is determined by the y-component of its direction at the
source and its projected angle. The heights at which the source emits are not sampled: a branch carries an interval of
heights, all with the same projected path. The interval is divided if part of it passes above or below a body, meets a
receiver, or is reflected once more at top or bottom than the remainder. The integral over the height of a source is
therefore exact.

Branches are followed exactly down to a minimum weight and up to a maximum number of interfaces. The remaining power,
the *tail*, is followed along a single path: at each interface one part is chosen, with probability proportional to its
power, and carries all of it (probabilistic ray splitting). The tail is thus sampled without bias, at a cost that grows
with the number of interfaces and not with the number of branches.
"""

import math

import numpy as np
from numpy.typing import NDArray

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.extruded import wall_parts
from solen.trace.kernel.family import FamilyInSpace
from solen.trace.kernel.nearest import Ray, Walls, nearest_wall
from solen.trace.kernel.rows import RECEIVER, REFRACTING, SEGMENT, TREATED, Floats, Precision
from solen.trace.kernel.space import (
    Beam,
    Border,
    Coherency,
    Vector,
    bare,
    in_plane_of_incidence,
    power_of,
    scaled,
    transformed,
    upright,
)
from solen.trace.kernel.step import Load, escape, meet, past_corner
from solen.trace.kernel.surface import COUNT, Event, end_fate, scrambled, uniform
from solen.trace.kernel.treated import acting
from solen.trace.result import DETECTED, ESCAPED, GOES_ON, TRUNCATED

STACK_IN_SPACE = 256
WIDTH_IN_SPACE = 20
X, Z, LOW, HIGH, DX, DY, DZ, EX, EY, EZ, I1, I2, CR, CI, REGION, LAST, HIT, U, STATE, MIN_POWER = range(20)
VISIBLE, SILENT, TAIL = range(3)
"""States of a branch: its segments are part of the path hash, are not part of it, or the branch belongs to the tail."""
EXTRA_COLUMNS = 5
"""Number of values per ray in addition to the receiver powers: escaped, absorbed, missed, leaked and unfinished."""
MIN_TAIL_POWER = 1e-12
"""Power at which the tail ends."""
MAX_BOUNCES = 10_000
"""Maximum number of reflections at top and bottom between two walls, after which light is left to the tail."""
NO_SAMPLE = -1
"""Sample number with which the exact part is traced instead of a tail."""


@compiled
def store_branch(
    w: Floats, x: float, z: float, low: float, high: float, d: Vector, e: Vector, light: Coherency
) -> None:
    """Store a pending branch in row ``w``."""
    w[X], w[Z], w[LOW], w[HIGH] = x, z, low, high
    w[DX], w[DY], w[DZ], w[EX], w[EY], w[EZ] = d.x, d.y, d.z, e.x, e.y, e.z
    w[I1], w[I2], w[CR], w[CI] = light.i1, light.i2, light.cr, light.ci


@compiled
def mean_transmittance(loss: float, nearest_mm: float, farthest_mm: float) -> float:
    """Mean transmittance of a medium for path lengths distributed uniformly between two values."""
    spread = loss * (farthest_mm - nearest_mm)
    return math.exp(-loss * nearest_mm) * (-math.expm1(-spread) / spread if spread > 1e-12 else 1.0)


@compiled
def trace_prism(  # noqa: C901  one loop, as in `solen.trace.kernel.loop`
    k: Precision,
    walls: Walls,
    family: FamilyInSpace,
    x: float,
    z: float,
    d: Vector,
    sample: int,
    max_hits: int,
    max_segments: int,
    value: NDArray[np.float64],
    segments: NDArray[np.float64],
    stack: Floats,
) -> tuple[int, np.uint64, np.uint64, bool]:
    """Trace a ray with all its branches, as `solen.trace.kernel.tree.trace_tree` does in the plane.

    Returns the number of segments, a hash of all events that change powers (the tree), a hash of all hits (the path),
    and whether a branch was undefined. ``value`` (D + 5,) receives the power at each receiver, the escaped and absorbed
    power, the parts of the escaped power that missed the bodies above or below and that leaked from them, and the
    unfinished power. Rows of ``segments`` (at least ``max_segments``, 6) are in projection: start, end, 1 if the
    segment ends on a curved face, and the interface there.

    If ``sample`` is the number of a sample, only the tail is traced, over at most ``max_hits`` interfaces; the last
    entry of ``value`` is then the total power of the tail, and no segments are stored.
    """
    tables, receivers = walls.tables, len(value) - EXTRA_COLUMNS
    missed, leaked, unfinished = receivers + 2, receivers + 3, receivers + 4
    sampling, tail, draw_count = sample >= 0, False, 0
    gain = 0.0 if sampling else 1.0
    for i in range(len(value)):
        value[i] = 0.0
    rules, half, colour = family.rules, family.half, family.colour
    tree, path_hash, count, waiting, undefined, hit_count = np.uint64(0), np.uint64(0), 0, 0, False, 0
    e = upright(d)
    light = Coherency(family.s, family.p, 0.0, 0.0)
    ya, yb = family.y_low, family.y_high
    min_power = rules.min_weight * (family.s + family.p)
    low, high = max(ya, -half), min(yb, half)
    fraction = max(high - low, 0.0) / (yb - ya) if yb > ya else 1.0 if low == high else 0.0
    missed_power = gain * (family.s + family.p) * (1.0 - fraction)
    value[receivers] += missed_power
    value[missed] += missed_power
    if not fraction > 0.0:
        return 0, tree, path_hash, False
    light, min_power, ya, yb = scaled(light, fraction), min_power * fraction, low, high
    region, last, hits, u, silent = -1, -1, 0, k.zero, False
    running = True
    while True:
        if not running:
            if waiting == 0:
                return hit_count if sampling else count, tree, path_hash, undefined
            waiting -= 1
            w = stack[waiting]
            x, z, ya, yb = w[X], w[Z], w[LOW], w[HIGH]
            d, e = Vector(w[DX], w[DY], w[DZ]), Vector(w[EX], w[EY], w[EZ])
            light = Coherency(w[I1], w[I2], w[CR], w[CI])
            region, last, hits, u, min_power = int(w[REGION]), int(w[LAST]), int(w[HIT]), w[U], w[MIN_POWER]
            silent, tail = w[STATE] != VISIBLE, w[STATE] == TAIL
            gain, running = 1.0 if tail or not sampling else 0.0, True
        if not tail and (count == max_segments or waiting + 4 > len(stack)):
            # the remaining power is left to the tail
            value[unfinished] += light.i1 + light.i2
            for i in range(waiting):
                value[unfinished] += stack[i, I1] + stack[i, I2] if stack[i, STATE] != TAIL else 0.0
                stack[i, STATE] = TAIL
            if not sampling:
                return count, tree, path_hash, undefined
            tail, gain = True, 1.0
        if tail and yb > ya:  # one random height
            ya += uniform(rules.seed, sample, draw_count) * (yb - ya)
            yb, draw_count = ya, draw_count + 1
        is_interval, hit_limit = yb > ya, max_hits if tail else rules.max_hits
        flat = math.sqrt(d.x * d.x + d.z * d.z)
        power = light.i1 + light.i2
        if flat < 1e-12:
            value[unfinished] += power if not sampling else 0.0
            running = False
            continue
        ux, uz = d.x / flat, d.z / flat
        ray = Ray(x, z, ux, uz, last, u)
        hit = nearest_wall(k, walls, ray)
        length, c, u_hit = hit
        if c < 0:
            _, fate = escape(k, tables, rules, region, colour)
            value[receivers + (0 if fate == ESCAPED else 1)] += gain * power
            if not (silent or tail):
                if not sampling:
                    segments[count, 0], segments[count, 1] = x, z
                    segments[count, 2], segments[count, 3] = x + family.escape_mm * ux, z + family.escape_mm * uz
                    segments[count, 4], segments[count, 5] = 0.0, -1.0
                count += 1
                tree = scrambled(tree ^ np.uint64(8 + fate))
                path_hash = scrambled(path_hash ^ np.uint64(8 + fate))
            running = False
            continue
        load = Load(light.i1, light.i2, min_power, 0.0, region, colour, 0, hits)
        px, pz, nx, nz, medium, beyond, is_undefined, corner, loss, _, _ = meet(k, tables, rules, ray, hit, load)
        if corner:
            x, z, _, _, last, u = past_corner(k, ray, hit)
            continue
        undefined = undefined or is_undefined
        mark = np.uint64(0)
        n1, distance = tables.refractive_index[colour, medium], length / flat
        rise = distance * d.y
        ended, bounces, hit_count = is_undefined, 0, hit_count + 1
        if rise != 0.0 and not is_undefined:
            n2 = family.above if rise > 0.0 else family.below
            upwards = 1.0 if rise > 0.0 else -1.0
            if n1 == n2:
                # heights from which the ray is still inside at the wall
                low, high = max(ya, -half - rise), min(yb, half - rise)
                if is_interval:
                    fraction = max(high - low, 0.0) / (yb - ya)
                    inside = fraction > 0.0
                else:
                    inside = abs(ya + rise) <= half
                    fraction, low, high = 1.0 if inside else 0.0, ya, yb
                if fraction < 1.0:
                    low_1, high_1 = (ya, yb) if rise > 0.0 else (-yb, -ya)
                    farthest = min((half - low_1) / abs(d.y), distance)
                    passing = gain * (1.0 - fraction) * power
                    leaving = passing * mean_transmittance(loss, max((half - high_1) / abs(d.y), 0.0), farthest)
                    value[receivers] += leaving
                    value[missed] += leaving
                    value[receivers + 1] += passing - leaving
                    light, min_power = scaled(light, fraction), min_power * fraction
                    mark = np.uint64(2 if inside else 1)
                ya, yb = low + rise, high + rise
                ended = not inside
                power = light.i1 + light.i2
            else:
                a, b = (ya + rise, yb + rise) if rise > 0.0 else (-ya - rise, -yb - rise)
                highest = max(a, b)
                bounces = math.floor((min(a, b) + half) / (2.0 * half))
                bounces = max(bounces, 0)
                edge = half * (2.0 * bounces + 1.0)
                leaky = n1 * n1 * (1.0 - d.y * d.y) < n2 * n2  # top and bottom reflect only partially
                if is_interval and highest > edge:
                    # the part reflected once more waits at the start of this segment
                    cut = (edge - rise) if rise > 0.0 else -(edge + rise)
                    outer = (yb - cut) if rise > 0.0 else (cut - ya)
                    fraction = outer / (yb - ya)
                    w = stack[waiting]
                    if fraction > 1.0 - 1e-12:  # all of it is reflected once more, to within rounding error
                        bounces += 1
                    elif fraction > 1e-12:
                        rounding = 1e-15 * half
                        if rise > 0.0:
                            store_branch(w, x, z, cut + rounding, yb, d, e, scaled(light, fraction))
                            yb = cut
                        else:
                            store_branch(w, x, z, ya, cut - rounding, d, e, scaled(light, fraction))
                            ya = cut
                        w[REGION], w[LAST], w[HIT], w[U], w[MIN_POWER] = region, last, hits, u, min_power * fraction
                        w[STATE] = VISIBLE if leaky and not silent else SILENT
                        waiting += 1
                        light, min_power = scaled(light, 1.0 - fraction), min_power * (1.0 - fraction)
                power, lost_power, transmitted = light.i1 + light.i2, 0.0, 1.0
                lowest_power, too_many = MIN_TAIL_POWER if tail else min_power, bounces > MAX_BOUNCES
                if loss > 0.0:
                    low_1, high_1 = (ya, yb) if rise > 0.0 else (-yb, -ya)
                    transmitted = mean_transmittance(loss, (half - high_1) / abs(d.y), (half - low_1) / abs(d.y))
                if bounces > 0:  # top and bottom share a plane of incidence
                    e, light = in_plane_of_incidence(d, e, Vector(0.0, -1.0, 0.0), light)
                    at_above = bare(n1, family.above, n1 * abs(d.y))
                    at_below = bare(n1, family.below, n1 * abs(d.y)) if family.below != family.above else at_above
                for _ in range(bounces):
                    n2 = family.above if d.y > 0.0 else family.below
                    amplitudes = at_above if d.y > 0.0 else at_below
                    leaving = amplitudes.on_s * light.i1 + amplitudes.on_p * light.i2
                    all_leaves = n1 == n2 or (rules.splitting == COUNT and leaving > 0.0)
                    leaving = transmitted * (light.i1 + light.i2 if all_leaves else leaving)
                    lost_power += leaving
                    value[receivers] += gain * leaving
                    value[missed if n1 == n2 else leaked] += gain * leaving
                    if all_leaves:
                        light, ended = scaled(light, 0.0), True
                        break
                    d = Vector(d.x, -d.y, d.z)
                    light = transformed(
                        amplitudes.back_s, amplitudes.back_p, amplitudes.back_cr, amplitudes.back_ci, light
                    )
                    hits += 1 if tail else 0  # otherwise parts of a path could end differently
                    left = transmitted * (light.i1 + light.i2)
                    if left < lowest_power or too_many or (tail and hits + 1 >= hit_limit):
                        if tail or not sampling:
                            ended = True
                            break
                        value[unfinished] += left
                        tail, gain, hit_limit, lowest_power, too_many = True, 1.0, max_hits, MIN_TAIL_POWER, False
                        power, lost_power = left, 0.0
                    transmitted *= math.exp(-loss * 2.0 * half / abs(d.y))
                if loss > 0.0:
                    light = scaled(light, transmitted if ended else math.exp(-loss * distance))
                    value[receivers + 1] += gain * max(power - lost_power - light.i1 - light.i2, 0.0)
                    loss = 0.0
                za, zb = ya + rise, yb + rise
                if bounces > 0:
                    # unfold: reflect at the face that was met
                    for _ in range(bounces):
                        if upwards > 0.0:
                            za, zb = 2.0 * half - zb, 2.0 * half - za
                        else:
                            za, zb = -2.0 * half - zb, -2.0 * half - za
                        upwards = -upwards
                ya, yb = za, zb
                mark = np.uint64(16 + bounces) ^ mark if leaky else np.uint64(0)
                power = light.i1 + light.i2
            if silent and (mark != np.uint64(0) or n1 == n2):
                # from here on, this part differs from the rest of its path
                mark, silent = mark ^ np.uint64(4), False
        if loss > 0.0 and not ended:
            transmitted = math.exp(-loss * distance)
            value[receivers + 1] += gain * (1.0 - transmitted) * power
            light = scaled(light, transmitted)
            power *= transmitted
        if tail and is_interval:
            ya += uniform(rules.seed, sample, draw_count) * (yb - ya)
            yb, draw_count, is_interval = ya, draw_count + 1, False
        from_right = ux * nx + uz * nz > 0.0
        behaviour = tables.behaviour[c]
        acts = acting(tables, c, colour) if behaviour >= TREATED else behaviour
        exhausted = hits + 1 >= hit_limit or power < (MIN_TAIL_POWER if tail else min_power)
        lower, upper, above, above_low, above_high = -math.inf, math.inf, 0.0, 0.0, 0.0
        if acts == RECEIVER and not ended:
            lower, upper = tables.height[c, 0], tables.height[c, 1]
            if is_interval:
                low, high = max(ya, lower), min(yb, upper)
                fraction = max(high - low, 0.0) / (yb - ya)
            else:
                fraction = 1.0 if lower <= ya <= upper else 0.0
            if fraction < 1.0:
                value[tables.receiver[c] if not from_right else receivers + 1] += gain * fraction * power
                light, min_power = scaled(light, 1.0 - fraction), min_power * (1.0 - fraction)
                power = light.i1 + light.i2
                mark = mark ^ np.uint64(256 if fraction > 0.0 else 512)
                behaviour, acts = REFRACTING, REFRACTING
                if fraction > 0.0:
                    outer, below = max(yb - upper, 0.0), max(lower - ya, 0.0)
                    if outer > 0.0 and below > 0.0:
                        # two parts pass the receiver; the upper one is stored behind the wall and in front of it
                        above, above_low, above_high = outer / below, upper, yb
                        fraction = below / (outer + below)
                        light, min_power = scaled(light, fraction), min_power * fraction
                        power = light.i1 + light.i2
                        yb = lower
                    elif outer > 0.0:
                        ya = upper
                    else:
                        yb = lower
        fate = TRUNCATED if ended else end_fate(acts, from_right, exhausted)
        if fate == TRUNCATED and sampling and not (tail or ended):
            value[unfinished] += (1.0 + above) * power
            if hits + 1 < max_hits:
                tail, gain, fate = True, 1.0, GOES_ON
            if above > 0.0:  # choose one of the two parts
                if uniform(rules.seed, sample, draw_count) * (1.0 + above) < above:
                    ya, yb = above_low, above_high
                light, above, draw_count = scaled(light, 1.0 + above), 0.0, draw_count + 1
            power = light.i1 + light.i2
        if not (silent or tail):
            if not sampling:
                segments[count, 0], segments[count, 1], segments[count, 2], segments[count, 3] = x, z, px, pz
                segments[count, 4], segments[count, 5] = 0.0 if tables.kind[c] == SEGMENT else 1.0, tables.owner[c]
            count += 1
            end = np.uint64((tables.owner[c] + 2) * 8 + fate)
            path_hash = scrambled(path_hash ^ end ^ (np.uint64(hits) << np.uint64(40)))
            if fate == DETECTED:
                tree = scrambled(tree ^ np.uint64((tables.receiver[c] + 2) * 8 + fate))
            elif fate != GOES_ON:
                tree = scrambled(tree ^ np.uint64(fate))
            if mark != np.uint64(0):
                tree = scrambled(tree ^ (mark << np.uint64(20)))
        if fate != GOES_ON:
            if fate == DETECTED:
                value[tables.receiver[c]] += gain * power
            elif fate != TRUNCATED:
                value[receivers + 1] += gain * power
            elif not (sampling or is_undefined):
                value[unfinished] += (1.0 + above) * power
            running = False
            continue
        normal = Vector(-nx, 0.0, -nz) if from_right else Vector(nx, 0.0, nz)
        event = Event(rules.seed, rules.first, hits)
        border = Border(normal, n1, tables.refractive_index[colour, beyond], from_right)
        through, reflected = wall_parts(tables, rules.splitting, c, behaviour, colour, event, Beam(d, e, light), border)
        on, back = power_of(through.light), power_of(reflected.light)
        if behaviour >= TREATED:
            value[receivers + 1] += gain * (1.0 + above) * max(power - on - back, 0.0)
        for transmits in (True, False):
            other = above * (on if transmits else back)
            is_weak = other < above * min_power
            if other > 0.0 and (sampling or not is_weak):
                w = stack[waiting]
                if transmits:
                    store_branch(w, px, pz, above_low, above_high, through.d, through.e, scaled(through.light, above))
                else:
                    store_branch(
                        w, px, pz, above_low, above_high, reflected.d, reflected.e, scaled(reflected.light, above)
                    )
                w[REGION], w[LAST], w[HIT], w[U] = beyond if transmits else medium, c, hits + 1, u_hit
                w[STATE], w[MIN_POWER] = TAIL if is_weak else SILENT if silent else VISIBLE, above * min_power
                waiting += 1
            value[unfinished] += other if is_weak else 0.0
        if not on + back > 0.0:
            running = False
            continue
        both, single_part, scale = on >= min_power and back >= min_power and not tail, tail, 1.0
        if not silent and behaviour == REFRACTING and on > 0.0 and not both:
            tree = scrambled(tree ^ np.uint64(34))
        reflected_first = back <= on if both else back >= min_power
        if not tail:
            value[unfinished] += (on if on < min_power else 0.0) + (back if back < min_power else 0.0)
            if not (on >= min_power or back >= min_power):
                single_part = sampling and on + back > 0.0
                if not single_part:
                    running = False
                    continue
            weak_power = 0.0 if both or single_part or not sampling else on if reflected_first else back
            if weak_power > 0.0:
                reflected_first = not reflected_first  # the weak part, as the tail, is followed first
            if both or weak_power > 0.0:
                w = stack[waiting]
                if reflected_first:
                    store_branch(w, px, pz, ya, yb, through.d, through.e, through.light)
                else:
                    store_branch(w, px, pz, ya, yb, reflected.d, reflected.e, reflected.light)
                w[REGION], w[LAST], w[HIT], w[U] = beyond if reflected_first else medium, c, hits + 1, u_hit
                w[STATE], w[MIN_POWER] = SILENT if silent else VISIBLE, min_power
                waiting += 1
                if not silent:
                    tree = scrambled(tree ^ np.uint64(32 if reflected_first else 33))
            if single_part or weak_power > 0.0:
                tail, gain = True, 1.0
        if single_part:
            reflected_first = uniform(rules.seed, sample, draw_count) * (on + back) < back
            scale, draw_count = (on + back) / (back if reflected_first else on), draw_count + 1
        if reflected_first:
            d, e, light, region = reflected.d, reflected.e, scaled(reflected.light, scale), medium
        else:
            d, e, light, region = through.d, through.e, scaled(through.light, scale), beyond
        x, z, last, u, hits = px, pz, c, u_hit, hits + 1

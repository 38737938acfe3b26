"""One ray in space with all its branches, in a body that extends from a bottom to a top, for adaptive integration.

The steps are those of `solen.trace.kernel.extruded`. A ray is determined by the y-component of its direction at the
source and its projected angle. The heights at which the source emits are not sampled: a branch carries an interval of
heights, all with the same projected path. The interval is divided where part of it passes above or below a body, meets
a receiver, or is reflected once more at top or bottom than the remainder. The integral over the height of a source is
therefore exact.

Branches are followed exactly down to a minimum weight and up to a maximum number of interfaces. The remaining power,
the *tail*, is followed along only one path, drawn at each interface (Russian roulette). It is thus sampled without
bias, at a cost that grows with the number of interfaces and not with the number of branches.
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
    passed,
    power_of,
    scaled,
    upright,
)
from solen.trace.kernel.step import Load, carried_on, escape, meet
from solen.trace.kernel.surface import COUNT, Event, chance, end_fate, scrambled
from solen.trace.kernel.treated import acting
from solen.trace.result import DETECTED, ESCAPED, GOES_ON, TRUNCATED

STACK_IN_SPACE = 256
WIDTH_IN_SPACE = 20
X, Z, LOW, HIGH, DX, DY, DZ, EX, EY, EZ, I1, I2, CR, CI, REGION, LAST, HIT, AT, STATE, LEAST = range(20)
SEEN, SILENT, TAIL = range(3)
"""States of a branch: its legs are part of the path; its legs are not part of it; the branch is the tail."""
MORE_COLUMNS = 5
"""Number of values per ray in addition to the receiver powers: escaped, absorbed, missed, leaked and unfinished."""
FAINT = 1e-12
"""Weight at which the tail ends."""
MAX_BOUNCES = 10_000
"""Maximum number of reflections at top and bottom between two walls, after which light is left to the tail."""
NO_DRAW = -1
"""Sample number that denotes the exact part."""


@compiled
def put(w: Floats, x: float, z: float, low: float, high: float, d: Vector, e: Vector, light: Coherency) -> None:
    """Write a waiting branch."""
    w[X], w[Z], w[LOW], w[HIGH] = x, z, low, high
    w[DX], w[DY], w[DZ], w[EX], w[EY], w[EZ] = d.x, d.y, d.z, e.x, e.y, e.z
    w[I1], w[I2], w[CR], w[CI] = light.i1, light.i2, light.cr, light.ci


@compiled
def mean_kept(loss: float, nearest_mm: float, farthest_mm: float) -> float:
    """Mean transmitted fraction of a medium over path lengths distributed uniformly between two values."""
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
    draw: int,
    most_hits: int,
    most_legs: int,
    value: NDArray[np.float64],
    legs: NDArray[np.float64],
    stack: Floats,
) -> tuple[int, np.uint64, np.uint64, bool]:
    """Trace a ray with all its branches, as `solen.trace.kernel.tree.trace_tree` does in the plane.

    Returns the number of legs, the tree of all events that change powers, the path with every hit, and whether a branch
    was undefined. ``value`` (D + 5,) receives the power at each receiver, the escaped and absorbed power, the parts of
    the escaped power that missed the bodies above or below and that leaked from them, and the unfinished power.
    ``legs`` (``most_legs`` or more, 6) are in projection: start, end, 1 if the leg ends on a curved face, owner.

    With ``draw``, the number of a sample, ``value`` describes the tail alone, followed over ``most_hits`` interfaces,
    and its last entry is the total left to the tail; no legs are stored then.
    """
    tables, receivers = walls.tables, len(value) - MORE_COLUMNS
    missed, leaked, unfinished = receivers + 2, receivers + 3, receivers + 4
    sampling, tail, draws = draw >= 0, False, 0
    gain = 0.0 if sampling else 1.0
    for i in range(len(value)):
        value[i] = 0.0
    rules, half, colour = family.rules, family.half, family.colour
    tree, way_hash, many, waiting, undefined, steps = np.uint64(0), np.uint64(0), 0, 0, False, 0
    e = upright(d)
    light = Coherency(family.s, family.p, 0.0, 0.0)
    ya, yb = family.y_low, family.y_high
    least = rules.min_weight * (family.s + family.p)
    low, high = max(ya, -half), min(yb, half)
    share = max(high - low, 0.0) / (yb - ya) if yb > ya else 1.0 if low == high else 0.0
    past = gain * (family.s + family.p) * (1.0 - share)
    value[receivers] += past
    value[missed] += past
    if not share > 0.0:
        return 0, tree, way_hash, False
    light, least, ya, yb = scaled(light, share), least * share, low, high
    region, last, hits, at, silent = -1, -1, 0, k.zero, False
    running = True
    while True:
        if not running:
            if waiting == 0:
                return steps if sampling else many, tree, way_hash, undefined
            waiting -= 1
            w = stack[waiting]
            x, z, ya, yb = w[X], w[Z], w[LOW], w[HIGH]
            d, e = Vector(w[DX], w[DY], w[DZ]), Vector(w[EX], w[EY], w[EZ])
            light = Coherency(w[I1], w[I2], w[CR], w[CI])
            region, last, hits, at, least = int(w[REGION]), int(w[LAST]), int(w[HIT]), w[AT], w[LEAST]
            silent, tail = w[STATE] != SEEN, w[STATE] == TAIL
            gain, running = 1.0 if tail or not sampling else 0.0, True
        if not tail and (many == most_legs or waiting + 4 > len(stack)):
            # the remaining power is left to the tail
            value[unfinished] += light.i1 + light.i2
            for i in range(waiting):
                value[unfinished] += stack[i, I1] + stack[i, I2] if stack[i, STATE] != TAIL else 0.0
                stack[i, STATE] = TAIL
            if not sampling:
                return many, tree, way_hash, undefined
            tail, gain = True, 1.0
        if tail and yb > ya:  # one random height
            ya += chance(rules.seed, draw, draws) * (yb - ya)
            yb, draws = ya, draws + 1
        wide, most = yb > ya, most_hits if tail else rules.max_hits
        flat = math.sqrt(d.x * d.x + d.z * d.z)
        power = light.i1 + light.i2
        if flat < 1e-12:
            value[unfinished] += power if not sampling else 0.0
            running = False
            continue
        ux, uz = d.x / flat, d.z / flat
        ray = Ray(x, z, ux, uz, last, at)
        hit = nearest_wall(k, walls, ray)
        length, c, place = hit
        if c < 0:
            _, fate = escape(k, tables, rules, region, colour)
            value[receivers + (0 if fate == ESCAPED else 1)] += gain * power
            if not (silent or tail):
                if not sampling:
                    legs[many, 0], legs[many, 1] = x, z
                    legs[many, 2], legs[many, 3], legs[many, 4] = x + family.far * ux, z + family.far * uz, 0.0
                    legs[many, 5] = -1.0
                many += 1
                tree = scrambled(tree ^ np.uint64(8 + fate))
                way_hash = scrambled(way_hash ^ np.uint64(8 + fate))
            running = False
            continue
        load = Load(light.i1, light.i2, least, 0.0, region, colour, 0, hits)
        px, pz, nx, nz, here, there, stray, corner, loss, _, _ = meet(k, tables, rules, ray, hit, load)
        if corner:
            x, z, _, _, last, at = carried_on(k, ray, hit)
            continue
        undefined = undefined or stray
        mark = np.uint64(0)
        n1, way = tables.refractive_index[colour, here], length / flat
        rise = way * d.y
        ended, bounces, steps = stray, 0, steps + 1
        if rise != 0.0 and not stray:
            n2 = family.above if rise > 0.0 else family.below
            upwards = 1.0 if rise > 0.0 else -1.0
            if n1 == n2:
                # heights from which the ray is still inside at the wall
                low, high = max(ya, -half - rise), min(yb, half - rise)
                if wide:
                    share = max(high - low, 0.0) / (yb - ya)
                    inside = share > 0.0
                else:
                    inside = abs(ya + rise) <= half
                    share, low, high = 1.0 if inside else 0.0, ya, yb
                if share < 1.0:
                    first_low, first_high = (ya, yb) if rise > 0.0 else (-yb, -ya)
                    farthest = min((half - first_low) / abs(d.y), way)
                    passing = gain * (1.0 - share) * power
                    leaves = passing * mean_kept(loss, max((half - first_high) / abs(d.y), 0.0), farthest)
                    value[receivers] += leaves
                    value[missed] += leaves
                    value[receivers + 1] += passing - leaves
                    light, least = scaled(light, share), least * share
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
                if wide and highest > edge:
                    # the part reflected once more waits at the start of this leg
                    cut = (edge - rise) if rise > 0.0 else -(edge + rise)
                    outer = (yb - cut) if rise > 0.0 else (cut - ya)
                    share = outer / (yb - ya)
                    w = stack[waiting]
                    if share > 1.0 - 1e-12:
                        bounces += (
                            1  # it waited for one more reflection, which all of it undergoes, to within rounding error
                        )
                    elif share > 1e-12:
                        tip = 1e-15 * half
                        if rise > 0.0:
                            put(w, x, z, cut + tip, yb, d, e, scaled(light, share))
                            yb = cut
                        else:
                            put(w, x, z, ya, cut - tip, d, e, scaled(light, share))
                            ya = cut
                        w[REGION], w[LAST], w[HIT], w[AT], w[LEAST] = region, last, hits, at, least * share
                        w[STATE] = SEEN if leaky and not silent else SILENT
                        waiting += 1
                        light, least = scaled(light, 1.0 - share), least * (1.0 - share)
                power, gone, kept = light.i1 + light.i2, 0.0, 1.0
                lowest, worn = FAINT if tail else least, bounces > MAX_BOUNCES
                if loss > 0.0:
                    first_low, first_high = (ya, yb) if rise > 0.0 else (-yb, -ya)
                    kept = mean_kept(loss, (half - first_high) / abs(d.y), (half - first_low) / abs(d.y))
                if bounces > 0:  # top and bottom share a plane of incidence
                    e, light = in_plane_of_incidence(d, e, Vector(0.0, -1.0, 0.0), light)
                    at_above = bare(n1, family.above, n1 * abs(d.y))
                    at_below = bare(n1, family.below, n1 * abs(d.y)) if family.below != family.above else at_above
                for _ in range(bounces):
                    n2 = family.above if d.y > 0.0 else family.below
                    face = at_above if d.y > 0.0 else at_below
                    leaves = face.on_s * light.i1 + face.on_p * light.i2
                    all_leaves = n1 == n2 or (rules.splitting == COUNT and leaves > 0.0)
                    leaves = kept * (light.i1 + light.i2 if all_leaves else leaves)
                    gone += leaves
                    value[receivers] += gain * leaves
                    value[missed if n1 == n2 else leaked] += gain * leaves
                    if all_leaves:
                        light, ended = scaled(light, 0.0), True
                        break
                    d = Vector(d.x, -d.y, d.z)
                    light = passed(face.back_s, face.back_p, face.back_cr, face.back_ci, light)
                    hits += 1 if tail else 0  # parts of a path must end alike, whatever happens at top and bottom
                    left = kept * (light.i1 + light.i2)
                    if left < lowest or worn or (tail and hits + 1 >= most):
                        if tail or not sampling:
                            ended = True
                            break
                        value[unfinished] += left
                        tail, gain, most, lowest, worn = True, 1.0, most_hits, FAINT, False
                        power, gone = left, 0.0
                    kept *= math.exp(-loss * 2.0 * half / abs(d.y))
                if loss > 0.0:
                    light = scaled(light, kept if ended else math.exp(-loss * way))
                    value[receivers + 1] += gain * max(power - gone - light.i1 - light.i2, 0.0)
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
                # from here on, this part ends differently from the rest of its path
                mark, silent = mark ^ np.uint64(4), False
        if loss > 0.0 and not ended:
            kept = math.exp(-loss * way)
            value[receivers + 1] += gain * (1.0 - kept) * power
            light = scaled(light, kept)
            power *= kept
        if tail and wide:
            ya += chance(rules.seed, draw, draws) * (yb - ya)
            yb, draws, wide = ya, draws + 1, False
        from_right = ux * nx + uz * nz > 0.0
        behaviour = tables.behaviour[c]
        acts = acting(tables, c, colour) if behaviour >= TREATED else behaviour
        worn_out = hits + 1 >= most or power < (FAINT if tail else least)
        lower, upper, above, above_low, above_high = -math.inf, math.inf, 0.0, 0.0, 0.0
        if acts == RECEIVER and not ended:
            lower, upper = tables.height[c, 0], tables.height[c, 1]
            if wide:
                low, high = max(ya, lower), min(yb, upper)
                share = max(high - low, 0.0) / (yb - ya)
            else:
                share = 1.0 if lower <= ya <= upper else 0.0
            if share < 1.0:
                value[tables.receiver[c] if not from_right else receivers + 1] += gain * share * power
                light, least = scaled(light, 1.0 - share), least * (1.0 - share)
                power = light.i1 + light.i2
                mark = mark ^ np.uint64(256 if share > 0.0 else 512)
                behaviour, acts = REFRACTING, REFRACTING
                if share > 0.0:
                    outer, inner_part = max(yb - upper, 0.0), max(lower - ya, 0.0)
                    if outer > 0.0 and inner_part > 0.0:
                        # two parts pass the receiver: the upper one waits behind the wall and in front of it
                        above, above_low, above_high = outer / inner_part, upper, yb
                        share = inner_part / (outer + inner_part)
                        light, least = scaled(light, share), least * share
                        power = light.i1 + light.i2
                        yb = lower
                    elif outer > 0.0:
                        ya = upper
                    else:
                        yb = lower
        fate = TRUNCATED if ended else end_fate(acts, from_right, worn_out)
        if fate == TRUNCATED and sampling and not (tail or ended):
            value[unfinished] += (1.0 + above) * power
            if hits + 1 < most_hits:
                tail, gain, fate = True, 1.0, GOES_ON
            if above > 0.0:  # draw one of the two parts
                if chance(rules.seed, draw, draws) * (1.0 + above) < above:
                    ya, yb = above_low, above_high
                light, above, draws = scaled(light, 1.0 + above), 0.0, draws + 1
            power = light.i1 + light.i2
        if not (silent or tail):
            if not sampling:
                legs[many, 0], legs[many, 1], legs[many, 2], legs[many, 3] = x, z, px, pz
                legs[many, 4], legs[many, 5] = 0.0 if tables.kind[c] == SEGMENT else 1.0, tables.owner[c]
            many += 1
            end = np.uint64((tables.owner[c] + 2) * 8 + fate)
            way_hash = scrambled(way_hash ^ end ^ (np.uint64(hits) << np.uint64(40)))
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
            elif not (sampling or stray):
                value[unfinished] += (1.0 + above) * power
            running = False
            continue
        normal = Vector(-nx, 0.0, -nz) if from_right else Vector(nx, 0.0, nz)
        event = Event(rules.seed, rules.first, hits)
        border = Border(normal, n1, tables.refractive_index[colour, there], from_right)
        ahead, behind = wall_parts(tables, rules.splitting, c, behaviour, colour, event, Beam(d, e, light), border)
        on, back = power_of(ahead.light), power_of(behind.light)
        if behaviour >= TREATED:
            value[receivers + 1] += gain * (1.0 + above) * max(power - on - back, 0.0)
        for goes_on in (True, False):
            other = above * (on if goes_on else back)
            faint = other < above * least
            if other > 0.0 and (sampling or not faint):
                w = stack[waiting]
                if goes_on:
                    put(w, px, pz, above_low, above_high, ahead.d, ahead.e, scaled(ahead.light, above))
                else:
                    put(w, px, pz, above_low, above_high, behind.d, behind.e, scaled(behind.light, above))
                w[REGION], w[LAST], w[HIT], w[AT] = there if goes_on else here, c, hits + 1, place
                w[STATE], w[LEAST] = TAIL if faint else SILENT if silent else SEEN, above * least
                waiting += 1
            value[unfinished] += other if faint else 0.0
        if not on + back > 0.0:
            running = False
            continue
        both, one_way, scale = on >= least and back >= least and not tail, tail, 1.0
        if not silent and behaviour == REFRACTING and on > 0.0 and not both:
            tree = scrambled(tree ^ np.uint64(34))
        goes_back = back <= on if both else back >= least
        if not tail:
            value[unfinished] += (on if on < least else 0.0) + (back if back < least else 0.0)
            if not (on >= least or back >= least):
                one_way = sampling and on + back > 0.0
                if not one_way:
                    running = False
                    continue
            weak = 0.0 if both or one_way or not sampling else on if goes_back else back
            if weak > 0.0:
                goes_back = not goes_back  # the strong part waits until the weak one has ended
            if both or weak > 0.0:
                w = stack[waiting]
                if goes_back:
                    put(w, px, pz, ya, yb, ahead.d, ahead.e, ahead.light)
                else:
                    put(w, px, pz, ya, yb, behind.d, behind.e, behind.light)
                w[REGION], w[LAST], w[HIT], w[AT] = there if goes_back else here, c, hits + 1, place
                w[STATE], w[LEAST] = SILENT if silent else SEEN, least
                waiting += 1
                if not silent:
                    tree = scrambled(tree ^ np.uint64(32 if goes_back else 33))
            if one_way or weak > 0.0:
                tail, gain = True, 1.0
        if one_way:
            goes_back = chance(rules.seed, draw, draws) * (on + back) < back
            scale, draws = (on + back) / (back if goes_back else on), draws + 1
        if goes_back:
            d, e, light, region = behind.d, behind.e, scaled(behind.light, scale), here
        else:
            d, e, light, region = ahead.d, ahead.e, scaled(ahead.light, scale), there
        x, z, last, at, hits = px, pz, c, place, hits + 1

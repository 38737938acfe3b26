"""The compiled loop over rays: tables in, sums out; it holds the same physics as `solen.trace.reference`.

Rays are carried in blocks (see `solen.trace.kernel.block`). Each is taken through the interface it met; rays that ended
leave their places to branches that wait and to rays not yet launched. A ray that stands on a curve has that curve's
root at zero divided out by algebra (its constant term is zero), never by a distance threshold.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.arrays import IntArray
from solen.curve import END_TOLERANCE_MM
from solen.trace.kernel.block import BLOCK, Found, Rays, find_block
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.nearest import Hit, Ray, place_on
from solen.trace.kernel.passing import ASIDE, Carried, pass_block
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.step import (
    Load,
    Meeting,
    Rules,
    carried_on,
    escape,
    free_path,
    leave,
    meet,
    part,
    phase_turn,
    turned,
    weakened,
)
from solen.trace.kernel.surface import COUNT
from solen.trace.result import ABSORBED, DETECTED, FATES, GOES_ON, KEPT_PLACES, TRUNCATED
from solen.trace.tables import Tables

FEW = BLOCK // 8
"""Rays left of a block when others are launched."""
HITS, UNDEFINED, CUT, LEGS = range(4)
MISSED, LEAKED = len(FATES), len(FATES) + 1
"""Of what escaped in an extruded scene, what left over top and bottom from around the bodies, and what from them."""
LEG_WIDTH = 15
X, Z, DX, DZ, S, P, LEAST, AT, OPTICAL = range(9)
REGION, LAST, HIT, BRANCH, NUMBER, PARENT, COLOUR = range(7)


class Sums(NamedTuple):
    """What one chunk of rays adds up, in double precision."""

    fate: NDArray[np.float64]
    """(7,) power by fate, and of what escaped in an extruded scene what missed and what leaked"""
    detected: NDArray[np.float64]
    """(D,) power per receiver"""
    arrived: NDArray[np.int64]
    """(D,) rays or branches per receiver"""
    optical: NDArray[np.float64]
    """(D,) power times optical path"""
    position: NDArray[np.float64]
    """(I, bins) power per receiving interface along it"""
    angle: NDArray[np.float64]
    """(D, bins) power per receiver by angle of incidence"""
    crossed: NDArray[np.float64]
    """(M,) net power per monitor"""
    crossings: NDArray[np.int64]
    """(M,) crossings per monitor"""
    maps: NDArray[np.float64]
    """(sum of bins,) net power per bin"""
    counts: NDArray[np.int64]
    """(4,) hits, undefined rays, other truncated branches, legs"""
    place: NDArray[np.float64]
    """(2, KEPT_PLACES, 2) where the first undefined rays were, and the first other truncated ones"""
    legs: NDArray[np.float64]
    """(capacity, LEG_WIDTH) straight stretches, as far as there is room"""


class Rows(NamedTuple):
    """Rays to be traced (N,)."""

    x: Floats
    z: Floats
    dx: Floats
    dz: Floats
    s: Floats
    p: Floats
    colour: IntArray


class Stem(NamedTuple):
    """Which branch of a ray, and the one that it parted from (−1)."""

    branch: int
    parent: int


class Space(NamedTuple):
    """Room to work in, for N rays."""

    state: Floats
    """(9, BLOCK)"""
    tags: IntArray
    """(7, BLOCK)"""
    found: Found
    waiting_state: Floats
    """(capacity, 9) branches that wait"""
    waiting_tags: IntArray
    """(capacity, 7)"""
    branches: IntArray
    """(N,) branches of each ray so far; ones to begin with"""


def room_of_block(dtype: type[np.floating[Any]]) -> Found:
    """Room for what lies ahead of the rays of a block."""
    return Found(
        np.empty(BLOCK, dtype),
        np.empty(BLOCK, np.int64),
        np.empty(BLOCK, dtype),
        np.empty((13, BLOCK + 1), dtype),
        np.empty(BLOCK + 1, np.int64),
    )


def room(rays: int, dtype: type[np.floating[Any]], capacity: int = 64 * BLOCK) -> Space:
    """Room for as many rays and as many waiting branches."""
    return Space(
        np.empty((9, BLOCK), dtype),
        np.empty((7, BLOCK), np.int64),
        room_of_block(dtype),
        np.empty((capacity, 9), dtype),
        np.empty((capacity, 7), np.int64),
        np.ones(rays, np.int64),
    )


@compiled
def count_monitors(
    tables: Tables, sums: Sums, ox: float, oz: float, dx: float, dz: float, length: float, power: float, loss: float
) -> None:
    """Count a straight stretch at every monitor it crosses, with the power left there."""
    lines = tables.monitor
    for m in range(len(lines)):
        wx, wz = lines[m, 0] - ox, lines[m, 1] - oz
        inverse = 1.0 / (dx * lines[m, 3] - dz * lines[m, 2])
        t = (wx * lines[m, 3] - wz * lines[m, 2]) * inverse
        place = (wx * dz - wz * dx) * inverse
        inside = -END_TOLERANCE_MM <= place <= lines[m, 4] + END_TOLERANCE_MM
        if not (0.0 < t <= length and t < math.inf and inside):
            continue
        left = math.copysign(power * math.exp(-loss * t), -inverse)
        sums.crossed[m] += left
        sums.crossings[m] += 1
        if tables.bins[m] > 0:
            b = min(max(int(place / lines[m, 4] * tables.bins[m]), 0), tables.bins[m] - 1)
            sums.maps[tables.first_bin[m] + b] += left


@compiled
def count_arrival(
    k: Precision, tables: Tables, sums: Sums, ray: Ray, hit: Hit, met: Meeting, power: float, optical: float
) -> None:
    """Count what a receiver detects."""
    c = hit.curve
    receiver = tables.receiver[c]
    sums.detected[receiver] += power
    sums.arrived[receiver] += 1
    sums.optical[receiver] += power * optical
    many = sums.position.shape[1]
    if many > 0:
        share = place_on(k, tables.kind[c], tables.shape, c, met.x, met.z, hit.place)
        sums.position[tables.owner[c], min(max(int(share * many), 0), many - 1)] += power
    many = sums.angle.shape[1]
    if many > 0:
        sine = ray.dx * met.nz - ray.dz * met.nx  # along the curve, as its left normal is (nx, nz)
        share = math.asin(min(max(sine, -1.0), 1.0)) / math.pi + 0.5
        sums.angle[receiver, min(max(int(share * many), 0), many - 1)] += power


@compiled
def note_leg(
    sums: Sums, rules: Rules, ray: Ray, load: Load, stem: Stem, interface: int, fate: int, length: float, kept: float
) -> None:
    """Keep a straight stretch where there is room, in the order of `solen.trace.result.LEG`; count it anyway."""
    row = sums.counts[LEGS]
    if row < len(sums.legs):
        leg = sums.legs[row]
        leg[0], leg[1] = rules.first + rules.step * load.number, stem.branch
        leg[2], leg[3] = stem.parent, load.hits
        leg[4], leg[5], leg[10], leg[13], leg[14] = interface, fate, length, kept, load.optical
        leg[6], leg[7], leg[8], leg[9] = ray.x, ray.z, ray.dx, ray.dz
        leg[11], leg[12] = load.s, load.p
    sums.counts[LEGS] += 1


@compiled
def note_place(sums: Sums, which: int, x: float, z: float) -> None:
    """Count a ray that is undefined or was truncated, and remember where."""
    n = sums.counts[which]
    if n < KEPT_PLACES:
        sums.place[which - UNDEFINED, n, 0], sums.place[which - UNDEFINED, n, 1] = x, z
    sums.counts[which] += 1


@compiled
def read(row: Floats, tag: IntArray) -> tuple[Ray, Load, Stem]:
    """A ray as it is kept."""
    ray = Ray(row[X], row[Z], row[DX], row[DZ], tag[LAST], row[AT])
    load = Load(row[S], row[P], row[LEAST], row[OPTICAL], tag[REGION], tag[COLOUR], tag[NUMBER], tag[HIT])
    return ray, load, Stem(tag[BRANCH], tag[PARENT])


@compiled
def write(row: Floats, tag: IntArray, ray: Ray, load: Load, stem: Stem) -> None:
    """Keep a ray."""
    row[X], row[Z], row[DX], row[DZ], tag[LAST], row[AT] = ray
    row[S], row[P], row[LEAST], row[OPTICAL], tag[REGION], tag[COLOUR], tag[NUMBER], tag[HIT] = load
    tag[BRANCH], tag[PARENT] = stem


@called
def scatter(
    k: Precision, tables: Tables, sums: Sums, rules: Rules, ray: Ray, load: Load, stem: Stem, met: Meeting, way: float
) -> tuple[bool, Ray, Load]:
    """Scatter a ray in a medium after a ``way``; whether it goes on, and the ray that does."""
    kept = math.exp(-met.loss * way) if met.loss > 0.0 else k.one
    after = weakened(load, kept, tables.refractive_index[load.colour, met.here] * way)
    power, left = load.s + load.p, after.s + after.p
    worn_out = load.hits + 1 >= rules.max_hits or left < load.least
    if len(tables.monitor) > 0:
        count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, way, power, met.loss)
    if len(sums.legs) > 0:
        note_leg(sums, rules, ray, load, stem, -1, TRUNCATED if worn_out else GOES_ON, way, kept)
    sums.fate[ABSORBED] += power - left
    x, z = ray.x + way * ray.dx, ray.z + way * ray.dz
    if worn_out:
        sums.fate[TRUNCATED] += left
        note_place(sums, CUT, x, z)
    dx, dz = turned(k, phase_turn(k, tables, rules, met.here, load), ray.dx, ray.dz)
    ahead = Load(after.s, after.p, load.least, after.optical, met.here, load.colour, load.number, load.hits + 1)
    return not worn_out, Ray(x, z, dx, dz, -1, k.zero), ahead


@called
def trace_rays(  # noqa: C901  one loop: numba passes arrays between functions at a price
    k: Precision, tables: Tables, sums: Sums, rays: Rows, rules: Rules, space: Space, treatments: Floats | None
) -> bool:
    """Trace rays and add up what becomes of them; False where there is no room for all the branches that wait.

    ``treatments`` are those of the tables, or None where there are none.
    """
    state, tags, found = space.state, space.tags, space.found
    block = Rays(state[X], state[Z], state[DX], state[DZ], tags[LAST], state[AT])
    waiting_state, waiting_tags, branches = space.waiting_state, space.waiting_tags, space.branches
    keeps_legs, has_monitors = len(sums.legs) > 0, len(tables.monitor) > 0
    n, waiting, launched, fates = 0, 0, 0, found.pick
    carried = Carried(state[OPTICAL], tags[REGION], tags[COLOUR], tags[HIT])
    counts_only = rules.splitting == COUNT and not (keeps_legs or has_monitors or rules.turbid)
    counts_only = counts_only and sums.position.shape[1] == 0 and sums.angle.shape[1] == 0
    while True:
        while n < BLOCK and waiting > 0:
            waiting -= 1
            for row in range(9):
                state[row, n] = waiting_state[waiting, row]
            for row in range(7):
                tags[row, n] = waiting_tags[waiting, row]
            n += 1
        fresh = n <= FEW  # rays launched together meet the same curves: they are not mixed with others
        while fresh and n < BLOCK and launched < len(rays.x):
            s, p = rays.s[launched], rays.p[launched]
            ray = Ray(rays.x[launched], rays.z[launched], rays.dx[launched], rays.dz[launched], -1, k.zero)
            load = Load(s, p, rules.min_weight * (s + p), k.zero, -1, rays.colour[launched], launched, 0)
            write(state[:, n], tags[:, n], ray, load, Stem(0, -1))
            launched += 1
            n += 1
        if n == 0:
            return True
        find_block(k, tables, n, block, found)
        if counts_only:
            pass_block(k, tables, rules, n, block, carried, found, fates)
        left = 0
        for i in range(n):
            if counts_only and fates[i] > ASIDE:
                sums.counts[HITS] += 1
                if fates[i] == GOES_ON:
                    if left < i:
                        for row in range(9):
                            state[row, left] = state[row, i]
                        for row in range(7):
                            tags[row, left] = tags[row, i]
                    left += 1
                    continue
                power = state[S, i] + state[P, i]
                sums.fate[fates[i]] += power
                if fates[i] == DETECTED:
                    receiver = tables.receiver[found.curve[i]]
                    sums.detected[receiver] += power
                    sums.arrived[receiver] += 1
                    sums.optical[receiver] += power * state[OPTICAL, i]
                continue
            ray, load, stem = read(state[:, i], tags[:, i])
            hit, power = Hit(found.distance[i], found.curve[i], found.place[i]), load.s + load.p
            if hit.curve < 0:
                loss, fate = escape(k, tables, rules, load.region, load.colour)
                if has_monitors:
                    count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, math.inf, power, loss)
                if keeps_legs:
                    note_leg(sums, rules, ray, load, stem, -1, fate, math.inf, 1.0)
                sums.fate[fate] += power
                continue
            met = meet(k, tables, rules, ray, hit, load)
            if met.corner:
                write(state[:, left], tags[:, left], carried_on(k, ray, hit), load, stem)
                left += 1
                continue
            sums.counts[HITS] += 1
            if rules.turbid and not met.undefined:
                way = free_path(k, tables, rules, met.here, load)
                if way < hit.distance:
                    goes_on, ray, load = scatter(k, tables, sums, rules, ray, load, stem, met, way)
                    if goes_on:
                        write(state[:, left], tags[:, left], ray, load, stem)
                        left += 1
                    continue
            if met.undefined:
                note_place(sums, UNDEFINED, met.x, met.z)
            elif has_monitors:
                count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, hit.distance, power, met.loss)
            if keeps_legs:
                note_leg(sums, rules, ray, load, stem, tables.owner[hit.curve], met.fate, hit.distance, met.kept)
            load = weakened(load, met.kept, tables.refractive_index[load.colour, met.here] * hit.distance)
            if met.loss > 0.0:
                sums.fate[ABSORBED] += power - (load.s + load.p)
                power = load.s + load.p
            if met.fate != GOES_ON:
                sums.fate[met.fate] += power
                if met.fate == TRUNCATED and not met.undefined:
                    note_place(sums, CUT, met.x, met.z)
                if met.fate == DETECTED:
                    count_arrival(k, tables, sums, ray, hit, met, power, load.optical)
                continue
            gone = leave(k, tables, rules, treatments, ray, hit.curve, met, load)
            if gone.lost > 0.0:
                sums.fate[ABSORBED] += gone.lost
            if gone.cut > 0.0:
                sums.fate[TRUNCATED] += gone.cut
                note_place(sums, CUT, met.x, met.z)
            if gone.ends:
                continue
            if gone.both:
                if waiting == len(waiting_state):
                    return False
                ray, its = part(hit, met, gone.parts, load, not gone.goes_back)
                write(waiting_state[waiting], waiting_tags[waiting], ray, its, stem)
                waiting += 1
                stem = Stem(branches[load.number], stem.branch)
                branches[load.number] += 1
            ray, load = part(hit, met, gone.parts, load, gone.goes_back)
            write(state[:, left], tags[:, left], ray, load, stem)
            left += 1
        n = left

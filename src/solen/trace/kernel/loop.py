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
from solen.trace.kernel.nearest import place_on
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.step import Rules, corner_step, escape, free_path, leave, meet, phase_turn, turned
from solen.trace.result import ABSORBED, DETECTED, FATES, GOES_ON, KEPT_PLACES, TRUNCATED
from solen.trace.tables import Tables

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
    k: Precision,
    tables: Tables,
    sums: Sums,
    c: int,
    x: float,
    z: float,
    at: float,
    sine: float,
    power: float,
    optical: float,
) -> None:
    """Count what a receiver detects; ``sine`` of the angle of incidence, positive towards the end of the curve."""
    receiver = tables.receiver[c]
    sums.detected[receiver] += power
    sums.arrived[receiver] += 1
    sums.optical[receiver] += power * optical
    many = sums.position.shape[1]
    if many > 0:
        share = place_on(k, tables.kind[c], tables.shape, c, x, z, at)
        sums.position[tables.owner[c], min(max(int(share * many), 0), many - 1)] += power
    many = sums.angle.shape[1]
    if many > 0:
        share = math.asin(min(max(sine, -1.0), 1.0)) / math.pi + 0.5
        sums.angle[receiver, min(max(int(share * many), 0), many - 1)] += power


@compiled
def note_leg(
    sums: Sums,
    rules: Rules,
    state: Floats,
    tags: IntArray,
    i: int,
    interface: int,
    fate: int,
    length: float,
    kept: float,
) -> None:
    """Keep ray i's straight stretch where there is room, in the order of `solen.trace.result.LEG`; count it anyway."""
    row = sums.counts[LEGS]
    if row < len(sums.legs):
        leg = sums.legs[row]
        leg[0], leg[1] = rules.first + rules.step * tags[NUMBER, i], tags[BRANCH, i]
        leg[2], leg[3] = tags[PARENT, i], tags[HIT, i]
        leg[4], leg[5], leg[10], leg[13], leg[14] = interface, fate, length, kept, state[OPTICAL, i]
        leg[6], leg[7], leg[8], leg[9] = state[X, i], state[Z, i], state[DX, i], state[DZ, i]
        leg[11], leg[12] = state[S, i], state[P, i]
    sums.counts[LEGS] += 1


@compiled
def note_place(sums: Sums, which: int, x: float, z: float) -> None:
    """Count a ray that is undefined or was truncated, and remember where."""
    n = sums.counts[which]
    if n < KEPT_PLACES:
        sums.place[which - UNDEFINED, n, 0], sums.place[which - UNDEFINED, n, 1] = x, z
    sums.counts[which] += 1


@called
def scatter(
    k: Precision,
    tables: Tables,
    sums: Sums,
    rules: Rules,
    state: Floats,
    tags: IntArray,
    i: int,
    left: int,
    here: int,
    way: float,
    loss: float,
) -> int:
    """Scatter ray i in a medium after a ``way`` and put it in place ``left``; 1 where it goes on, 0 where it ends."""
    colour, number, hits = tags[COLOUR, i], tags[NUMBER, i], tags[HIT, i]
    power = state[S, i] + state[P, i]
    kept = math.exp(-loss * way) if loss > 0.0 else k.one
    s, p = kept * state[S, i], kept * state[P, i]
    worn_out = hits + 1 >= rules.max_hits or s + p < state[LEAST, i]
    if len(tables.monitor) > 0:
        count_monitors(tables, sums, state[X, i], state[Z, i], state[DX, i], state[DZ, i], way, power, loss)
    if len(sums.legs) > 0:
        note_leg(sums, rules, state, tags, i, -1, TRUNCATED if worn_out else GOES_ON, way, kept)
    sums.fate[ABSORBED] += power - (s + p)
    x, z = state[X, i] + way * state[DX, i], state[Z, i] + way * state[DZ, i]
    if worn_out:
        sums.fate[TRUNCATED] += s + p
        note_place(sums, CUT, x, z)
        return 0
    half = phase_turn(k, tables, rules, here, colour, number, hits)
    for row in range(9):
        state[row, left] = state[row, i]
    for row in range(7):
        tags[row, left] = tags[row, i]
    state[DX, left], state[DZ, left] = turned(k, half, state[DX, left], state[DZ, left])
    state[X, left], state[Z, left], state[S, left], state[P, left] = x, z, s, p
    state[AT, left] = k.zero
    state[OPTICAL, left] += tables.refractive_index[colour, here] * way
    tags[HIT, left], tags[LAST, left], tags[REGION, left] = hits + 1, -1, here
    return 1


@called
def trace_rays(  # noqa: C901  one loop: numba passes arrays between functions at a price
    k: Precision, tables: Tables, sums: Sums, rays: Rows, rules: Rules, space: Space, treatments: Floats | None
) -> bool:
    """Trace rays and add up what becomes of them; False where there is no room for all the branches that wait.

    ``treatments`` are those of the tables, or None where there are none.
    """
    state, tags, found = space.state, space.tags, space.found
    x, z, dx, dz, s, p = state[X], state[Z], state[DX], state[DZ], state[S], state[P]
    least, at, optical = state[LEAST], state[AT], state[OPTICAL]
    region, last, hits, branch = tags[REGION], tags[LAST], tags[HIT], tags[BRANCH]
    number, parent, colour = tags[NUMBER], tags[PARENT], tags[COLOUR]
    block = Rays(x, z, dx, dz, last, at)
    waiting_state, waiting_tags, branches = space.waiting_state, space.waiting_tags, space.branches
    keeps_legs, has_monitors = len(sums.legs) > 0, len(tables.monitor) > 0
    n, waiting, launched = 0, 0, 0
    while True:
        while n < BLOCK and waiting > 0:
            waiting -= 1
            for row in range(9):
                state[row, n] = waiting_state[waiting, row]
            for row in range(7):
                tags[row, n] = waiting_tags[waiting, row]
            n += 1
        while n < BLOCK and launched < len(rays.x):
            x[n], z[n], dx[n], dz[n] = rays.x[launched], rays.z[launched], rays.dx[launched], rays.dz[launched]
            s[n], p[n], colour[n] = rays.s[launched], rays.p[launched], rays.colour[launched]
            least[n], at[n], optical[n] = rules.min_weight * (s[n] + p[n]), k.zero, k.zero
            region[n], last[n], hits[n], branch[n], number[n], parent[n] = -1, -1, 0, 0, launched, -1
            launched += 1
            n += 1
        if n == 0:
            return True
        find_block(k, tables, n, block, found)
        left = 0
        for i in range(n):
            c, length, power = found.curve[i], found.distance[i], s[i] + p[i]
            if c < 0:
                loss, fate = escape(k, tables, rules, region[i], colour[i])
                if has_monitors:
                    count_monitors(tables, sums, x[i], z[i], dx[i], dz[i], math.inf, power, loss)
                if keeps_legs:
                    note_leg(sums, rules, state, tags, i, -1, fate, math.inf, 1.0)
                sums.fate[fate] += power
                continue
            place = found.place[i]
            px, pz, nx, nz, here, there, undefined, corner, loss, kept, fate = meet(
                k, tables, rules, c, length, place, x[i], z[i], dx[i], dz[i], last[i], at[i],
                region[i], colour[i], hits[i], power, least[i],
            )  # fmt: skip
            if corner:
                for row in range(9):
                    state[row, left] = state[row, i]
                for row in range(7):
                    tags[row, left] = tags[row, i]
                step = corner_step(k, x[i], z[i])
                x[left], z[left] = x[i] + step * dx[i], z[i] + step * dz[i]
                last[left], at[left] = c, place
                left += 1
                continue
            sums.counts[HITS] += 1
            if rules.turbid and not undefined:
                way = free_path(k, tables, rules, here, colour[i], number[i], hits[i])
                if way < length:
                    left += scatter(k, tables, sums, rules, state, tags, i, left, here, way, loss)
                    continue
            if undefined:
                note_place(sums, UNDEFINED, px, pz)
            elif has_monitors:
                count_monitors(tables, sums, x[i], z[i], dx[i], dz[i], length, power, loss)
            if keeps_legs:
                note_leg(sums, rules, state, tags, i, tables.owner[c], fate, length, kept)
            s_here, p_here = kept * s[i], kept * p[i]
            if loss > 0.0:
                sums.fate[ABSORBED] += power - (s_here + p_here)
                power = s_here + p_here
            way = optical[i] + tables.refractive_index[colour[i], here] * length
            if fate != GOES_ON:
                sums.fate[fate] += power
                if fate == TRUNCATED and not undefined:
                    note_place(sums, CUT, px, pz)
                if fate == DETECTED:
                    sine = dx[i] * nz - dz[i] * nx  # along the curve, as its left normal is (nx, nz)
                    count_arrival(k, tables, sums, c, px, pz, place, sine, power, way)
                continue
            tx, tz, on_s, on_p, bx, bz, back_s, back_p, lost, cut, both, ends, goes_back = leave(
                k, tables, rules, treatments, c, colour[i], here, there, number[i], hits[i],
                px, pz, dx[i], dz[i], nx, nz, s_here, p_here, least[i],
            )  # fmt: skip
            if lost > 0.0:
                sums.fate[ABSORBED] += lost
            if cut > 0.0:
                sums.fate[TRUNCATED] += cut
                note_place(sums, CUT, px, pz)
            if ends:
                continue
            own, above = branch[i], parent[i]
            if both:
                if waiting == len(waiting_state):
                    return False
                w = waiting_state[waiting]
                w[X], w[Z], w[LEAST], w[AT], w[OPTICAL] = px, pz, least[i], place, way
                if goes_back:
                    w[DX], w[DZ], w[S], w[P] = tx, tz, on_s, on_p
                else:
                    w[DX], w[DZ], w[S], w[P] = bx, bz, back_s, back_p
                tag = waiting_tags[waiting]
                tag[REGION], tag[LAST], tag[HIT] = there if goes_back else here, c, hits[i] + 1
                tag[BRANCH], tag[NUMBER], tag[PARENT], tag[COLOUR] = own, number[i], above, colour[i]
                waiting += 1
                own, above = branches[number[i]], own
                branches[number[i]] += 1
            hits[left], number[left], least[left], branch[left], parent[left], colour[left] = (
                hits[i] + 1,
                number[i],
                least[i],
                own,
                above,
                colour[i],
            )
            x[left], z[left], last[left], at[left], optical[left] = px, pz, c, place, way
            if goes_back:
                dx[left], dz[left], s[left], p[left], region[left] = bx, bz, back_s, back_p, here
            else:
                dx[left], dz[left], s[left], p[left], region[left] = tx, tz, on_s, on_p, there
            left += 1
        n = left

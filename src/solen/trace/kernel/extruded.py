"""The compiled loop over rays in space, in scenes that extend along y from a bottom to a top.

Walls are vertical. In projection along y, a ray is straight between two walls, so the planar search finds the next
wall, whatever happens at the top and bottom on the way. A ray is stored as its projection, a unit vector (ux, uz), with
``flat``, the length of the projection of its direction. Light that leaves through the top or bottom never returns: if
it was in the same medium as that beyond, it has *missed* the bodies; otherwise it has *leaked* from them.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.arrays import IntArray
from solen.trace.kernel.block import find_block
from solen.trace.kernel.buffers import BLOCK, Found, Rays, block_buffers, copy_ray, resume
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.nearest import Hit, Ray
from solen.trace.kernel.rows import MIRROR, RECEIVER, REFRACTING, TREATED, Floats, Precision
from solen.trace.kernel.space import (
    Beam,
    Border,
    Coherency,
    Parts,
    Vector,
    bare,
    divided,
    power_of,
    scalar,
    scaled,
    times,
    unpolarised,
    upright,
)
from solen.trace.kernel.step import Load, Rules, carried_on, escape, free_path, meet
from solen.trace.kernel.surface import COUNT, ROULETTE, Event, chance, chance_of, end_fate
from solen.trace.kernel.tally import (
    CUT,
    HITS,
    LEAKED,
    MISSED,
    UNDEFINED,
    Sums,
    count_arrival,
    count_monitors,
    note_place,
)
from solen.trace.kernel.treated import PHASE, Amplitudes, acting
from solen.trace.kernel.treated_space import henyey_greenstein, treated_parts
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON, TRUNCATED
from solen.trace.tables import Tables

X, Z, UX, UZ, AT, Y, DY, FLAT, I1, I2, CR, CI, EX, EY, EZ, LEAST, OPTICAL = range(17)
REGION, LAST, HIT, NUMBER, COLOUR = range(5)
NUMBERS, TAGS = 17, 5
UPRIGHT = 1e-12
"""Minimum length of a projection, used for a ray along y."""


class RowsInSpace(NamedTuple):
    """Rays to be traced (N,)."""

    x: Floats
    y: Floats
    z: Floats
    dx: Floats
    dy: Floats
    dz: Floats
    s: Floats
    p: Floats
    cr: Floats
    ci: Floats
    optical: Floats
    colour: IntArray


class Slab(NamedTuple):
    """Half the thickness in mm, and the refractive indices above and below."""

    half: float
    above: float
    below: float


class BuffersInSpace(NamedTuple):
    """Working memory."""

    state: Floats
    """(NUMBERS, BLOCK)"""
    tags: IntArray
    """(TAGS, BLOCK)"""
    found: Found
    waiting_state: Floats
    """(capacity, NUMBERS) waiting branches"""
    waiting_tags: IntArray
    """(capacity, TAGS)"""


def buffers_in_space(capacity: int) -> BuffersInSpace:
    """Allocate working memory for this many waiting branches."""
    return BuffersInSpace(
        np.empty((NUMBERS, BLOCK)),
        np.empty((TAGS, BLOCK), np.int64),
        block_buffers(np.float64),
        np.empty((capacity, NUMBERS)),
        np.empty((capacity, TAGS), np.int64),
    )


class Leg(NamedTuple):
    """A path through a medium in mm, the absorption coefficient per mm, and the projected length of the direction."""

    way: float
    n1: float
    loss: float
    flat: float


class Flight(NamedTuple):
    """A ray after its path through a medium, including reflections off top and bottom."""

    y: float
    beam: Beam
    hits: int
    ended: bool


@compiled
def fly(tables: Tables, sums: Sums, rules: Rules, slab: Slab, at: Vector, beam: Beam, leg: Leg, load: Load) -> Flight:
    """Advance a ray through a medium; add the powers absorbed and lost at top and bottom."""
    (d, e, light), (x, y, z), (way, n1, loss, flat), hits = beam, at, leg, load.hits
    gone, ended = 0.0, False
    ux, uz, has_monitors = d.x / flat, d.z / flat, len(tables.monitor) > 0
    while True:
        to = way - gone
        reaches = False
        if d.y != 0.0:
            end = slab.half if d.y > 0.0 else -slab.half
            face = max((end - y) / d.y, 0.0)
            reaches = face < to
            to = face if reaches else to
        power = light.i1 + light.i2
        if has_monitors:
            start = gone * flat
            count_monitors(tables, sums, x + start * ux, z + start * uz, ux, uz, to * flat, power, loss / flat)
        if loss > 0.0:
            light = scaled(light, math.exp(-loss * to))
            sums.fate[ABSORBED] += power - (light.i1 + light.i2)
        gone += to
        if not reaches:
            return Flight(y + to * d.y, Beam(d, e, light), hits, False)
        y, upwards = (slab.half, 1.0) if d.y > 0.0 else (-slab.half, -1.0)
        n2 = slab.above if d.y > 0.0 else slab.below
        sums.counts[HITS] += 1
        hits += 1
        power = light.i1 + light.i2
        border = Border(Vector(0.0, -upwards, 0.0), n1, n2, False)
        parts = divided(Beam(d, e, light), border, bare(n1, n2, n1 * abs(d.y)))
        leaves = power_of(parts.on.light)
        if n1 == n2 or (rules.splitting == COUNT and leaves > 0.0):
            leaves, ended = power, True
        sums.fate[ESCAPED] += leaves
        sums.fate[MISSED if n1 == n2 else LEAKED] += leaves
        d, e, light = parts.back
        power = light.i1 + light.i2
        if not ended and (hits + 1 >= rules.max_hits or power < load.least):
            sums.fate[TRUNCATED] += power
            note_place(sums, CUT, x + gone * flat * ux, z + gone * flat * uz)
            ended = True
        if ended:
            return Flight(y, Beam(d, e, light), hits, True)


@compiled
def wall_parts(
    tables: Tables, splitting: int, c: int, behaviour: int, colour: int, event: Event, beam: Beam, border: Border
) -> Parts:
    """Return both parts at a wall, with a behaviour that may differ from that in the table."""
    if behaviour >= TREATED:
        return treated_parts(tables, splitting, c, colour, event, beam, border)
    a = bare(border.n1, border.n2, -border.n1 * scalar(beam.d, border.n))
    if behaviour == MIRROR:
        a = Amplitudes(1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    elif splitting == COUNT and a.on_s > 0.0:
        a = Amplitudes(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    return divided(beam, border, a)


@compiled
def note_beam(row: Floats, beam: Beam) -> None:
    """Write the direction, basis and coherency of a ray."""
    d, e, light = beam
    flat = math.sqrt(d.x * d.x + d.z * d.z)
    if flat < UPRIGHT:
        row[UX], row[UZ], row[FLAT] = 1.0, 0.0, UPRIGHT
    else:
        row[UX], row[UZ], row[FLAT] = d.x / flat, d.z / flat, flat
    row[DY], row[EX], row[EY], row[EZ] = d.y, e.x, e.y, e.z
    row[I1], row[I2], row[CR], row[CI] = light.i1, light.i2, light.cr, light.ci


@called
def trace_in_space(  # noqa: C901  one loop, as in `solen.trace.kernel.loop`
    k: Precision, tables: Tables, sums: Sums, rays: RowsInSpace, rules: Rules, slab: Slab, buffers: BuffersInSpace
) -> bool:
    """Trace rays and add their powers; return False if there is no room for all waiting branches."""
    state, tags, found = buffers.state, buffers.tags, buffers.found
    waiting_state, waiting_tags = buffers.waiting_state, buffers.waiting_tags
    block = Rays(state[X], state[Z], state[UX], state[UZ], tags[LAST], state[AT])
    n, waiting, launched = 0, 0, 0
    while True:
        n, waiting = resume(state, tags, n, waiting_state, waiting_tags, waiting)
        while n < BLOCK and launched < len(rays.x):
            d = Vector(rays.dx[launched], rays.dy[launched], rays.dz[launched])
            s, p = rays.s[launched], rays.p[launched]
            if abs(rays.y[launched]) > slab.half:
                sums.fate[ESCAPED] += s + p
                sums.fate[MISSED] += s + p
                launched += 1
                continue
            state[X, n], state[Y, n], state[Z, n] = rays.x[launched], rays.y[launched], rays.z[launched]
            note_beam(state[:, n], Beam(d, upright(d), Coherency(s, p, rays.cr[launched], rays.ci[launched])))
            state[LEAST, n], state[AT, n], state[OPTICAL, n] = rules.min_weight * (s + p), 0.0, rays.optical[launched]
            tags[REGION, n], tags[LAST, n], tags[HIT, n] = -1, -1, 0
            tags[NUMBER, n], tags[COLOUR, n] = launched, rays.colour[launched]
            launched += 1
            n += 1
        if n == 0:
            return True
        find_block(k, tables, n, block, found)
        left = 0
        for i in range(n):
            hit = Hit(found.distance[i], found.curve[i], found.place[i])
            c, length, place = hit.curve, hit.distance, hit.place
            x, z, y, flat, least = state[X, i], state[Z, i], state[Y, i], state[FLAT, i], state[LEAST, i]
            d = Vector(flat * state[UX, i], state[DY, i], flat * state[UZ, i])
            light = Coherency(state[I1, i], state[I2, i], state[CR, i], state[CI, i])
            beam = Beam(d, Vector(state[EX, i], state[EY, i], state[EZ, i]), light)
            region, colour, number, hits = tags[REGION, i], tags[COLOUR, i], tags[NUMBER, i], tags[HIT, i]
            power = light.i1 + light.i2
            if c < 0:
                loss, fate = escape(k, tables, rules, region, colour)
                if len(tables.monitor) > 0:
                    above = (slab.half - math.copysign(y, y * d.y)) / abs(d.y) if d.y != 0.0 else math.inf
                    ux, uz = state[UX, i], state[UZ, i]
                    count_monitors(tables, sums, x, z, ux, uz, above * flat, power, loss / flat)
                sums.fate[fate] += power
                continue
            ray = Ray(x, z, state[UX, i], state[UZ, i], tags[LAST, i], state[AT, i])
            load = Load(light.i1, light.i2, least, state[OPTICAL, i], region, colour, number, hits)
            met = meet(k, tables, rules, ray, hit, load)
            if met.corner:
                copy_ray(state, tags, i, left)
                ray = carried_on(k, ray, hit)
                state[X, left], state[Z, left], tags[LAST, left], state[AT, left] = ray.x, ray.z, c, place
                left += 1
                continue
            sums.counts[HITS] += 1
            if met.undefined:
                note_place(sums, UNDEFINED, met.x, met.z)
                sums.fate[TRUNCATED] += power
                continue
            n1, way = tables.refractive_index[colour, met.here], length / flat
            scatters = False
            if rules.turbid:
                free = free_path(k, tables, rules, met.here, load)
                scatters = free < way
                way = min(free, way)
            leg = Leg(way, n1, met.loss, flat)
            y, beam, hits, ended = fly(tables, sums, rules, slab, Vector(x, y, z), beam, leg, load)
            if ended:
                continue
            d, power, optical = beam.d, power_of(beam.light), state[OPTICAL, i] + n1 * way
            worn_out = hits + 1 >= rules.max_hits or power < least
            if scatters:
                px, pz = x + way * d.x, z + way * d.z
                if worn_out:
                    sums.fate[TRUNCATED] += power
                    note_place(sums, CUT, px, pz)
                    continue
                event = Event(rules.seed, rules.first + rules.step * number, hits)
                one, two = chance_of(event, PHASE), chance_of(event, PHASE + 1)
                d = henyey_greenstein(one, two, tables.anisotropy[colour, met.here], d)
                copy_ray(state, tags, i, left)
                note_beam(state[:, left], Beam(d, upright(d), unpolarised(beam.light)))
                state[X, left], state[Y, left], state[Z, left] = px, y, pz
                state[AT, left], state[OPTICAL, left] = 0.0, optical
                tags[HIT, left], tags[LAST, left], tags[REGION, left] = hits + 1, -1, met.here
                left += 1
                continue
            from_right = d.x * met.nx + d.z * met.nz > 0.0
            behaviour = tables.behaviour[c]
            acts = acting(tables, c, colour) if behaviour >= TREATED else behaviour
            if acts == RECEIVER and not tables.height[c, 0] <= y <= tables.height[c, 1]:
                behaviour, acts = REFRACTING, REFRACTING
            fate = end_fate(acts, from_right, worn_out)
            if fate != GOES_ON:
                sums.fate[fate] += power
                if fate == TRUNCATED:
                    note_place(sums, CUT, met.x, met.z)
                if fate == DETECTED:
                    count_arrival(k, tables, sums, Ray(x, z, d.x, d.z, c, place), hit, met, power, optical)
                continue
            normal = Vector(-met.nx, 0.0, -met.nz) if from_right else Vector(met.nx, 0.0, met.nz)
            event = Event(rules.seed, rules.first + rules.step * number, hits)
            border = Border(normal, n1, tables.refractive_index[colour, met.there], from_right)
            ahead, behind = wall_parts(tables, rules.splitting, c, behaviour, colour, event, beam, border)
            on, back = power_of(ahead.light), power_of(behind.light)
            sums.fate[ABSORBED] += max(power - on - back, 0.0) if behaviour >= TREATED else 0.0
            if rules.splitting == ROULETTE and on > 0.0 and back > 0.0:
                whole = on + back
                if chance(event.seed, event.ray, hits) * whole < back:
                    behind, back, on = times(behind, whole / back), whole, 0.0
                else:
                    ahead, on, back = times(ahead, whole / on), whole, 0.0
            cut = (on if on < least else 0.0) + (back if back < least else 0.0)
            if cut > 0.0:
                sums.fate[TRUNCATED] += cut
                note_place(sums, CUT, met.x, met.z)
            both = on >= least and back >= least
            if not (on >= least or back >= least):
                continue
            goes_back = back <= on if both else back >= least  # the weaker part is followed first
            if both and waiting == len(waiting_state):
                return False
            if both:
                row, tag = waiting_state[waiting], waiting_tags[waiting]
                if goes_back:
                    note_beam(row, ahead)
                else:
                    note_beam(row, behind)
                row[X], row[Y], row[Z], row[AT] = met.x, y, met.z, place
                row[LEAST], row[OPTICAL] = least, optical
                tag[REGION], tag[LAST], tag[HIT] = met.there if goes_back else met.here, c, hits + 1
                tag[NUMBER], tag[COLOUR] = number, colour
                waiting += 1
            if goes_back:
                note_beam(state[:, left], behind)
            else:
                note_beam(state[:, left], ahead)
            state[X, left], state[Y, left], state[Z, left], state[AT, left] = met.x, y, met.z, place
            state[LEAST, left], state[OPTICAL, left] = least, optical
            tags[REGION, left], tags[LAST, left], tags[HIT, left] = met.here if goes_back else met.there, c, hits + 1
            tags[NUMBER, left], tags[COLOUR, left] = number, colour
            left += 1
        n = left

"""The compiled loop over rays in space, in extruded scenes.

Walls are vertical. In projection along y, a ray is straight between two walls, so the planar search finds the next
wall, whatever happens at the top and bottom on the way. A ray is stored as its projected direction, a unit vector (ux,
uz), and ``flat``, the length of the projection of its direction in space. Light that leaves through the top or bottom
never returns: if the index there equals that of its medium, it has *missed* the bodies; otherwise it has *leaked* from
them.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.arrays import IntArray
from solen.trace.kernel.block import find_block
from solen.trace.kernel.buffers import BLOCK, BlockHits, Rays, block_buffers, copy_ray, resume
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
    dot,
    power_of,
    scaled,
    scaled_beam,
    split_beam,
    unpolarised,
    upright,
)
from solen.trace.kernel.step import Load, Rules, escape, free_path, meet, past_corner
from solen.trace.kernel.surface import COUNT, ROULETTE, Event, end_fate, uniform, uniform_of
from solen.trace.kernel.tally import (
    HITS,
    LEAKED,
    MISSED,
    TRUNCATIONS,
    UNDEFINED,
    Sums,
    count_arrival,
    count_monitors,
    store_location,
)
from solen.trace.kernel.treated import PHASE, Amplitudes, acting
from solen.trace.kernel.treated_space import henyey_greenstein, treated_parts
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON, TRUNCATED
from solen.trace.tables import Tables

X, Z, UX, UZ, U, Y, DY, FLAT, I1, I2, CR, CI, EX, EY, EZ, MIN_POWER, OPTICAL = range(17)
REGION, LAST, HIT, NUMBER, COLOUR = range(5)
NUMBERS, TAGS = 17, 5
MIN_FLAT = 1e-12
"""Minimum length of a projected direction, used for a ray along y."""


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
    hit: BlockHits
    waiting_state: Floats
    """(capacity, NUMBERS) waiting branches"""
    waiting_tags: IntArray
    """(capacity, TAGS)"""


def buffers_in_space(capacity: int) -> BuffersInSpace:
    """Allocate working memory with room for ``capacity`` waiting branches."""
    return BuffersInSpace(
        np.empty((NUMBERS, BLOCK)),
        np.empty((TAGS, BLOCK), np.int64),
        block_buffers(np.float64),
        np.empty((capacity, NUMBERS)),
        np.empty((capacity, TAGS), np.int64),
    )


class MediumPath(NamedTuple):
    """A path from one wall to the next through a medium."""

    length: float
    n1: float
    loss: float
    """absorption coefficient per mm"""
    flat: float
    """length of the projected direction"""


class Traversed(NamedTuple):
    """A ray after its path through a medium, including reflections off top and bottom."""

    y: float
    beam: Beam
    hits: int
    ended: bool


@compiled
def traverse(
    tables: Tables, sums: Sums, rules: Rules, slab: Slab, at: Vector, beam: Beam, path: MediumPath, load: Load
) -> Traversed:
    """Advance a ray through a medium; sum the power that is absorbed and the power lost at top and bottom."""
    (d, e, light), (x, y, z), (length, n1, loss, flat), hits = beam, at, path, load.hits
    travelled, ended = 0.0, False
    ux, uz, has_monitors = d.x / flat, d.z / flat, len(tables.monitor) > 0
    while True:
        step = length - travelled
        reaches = False
        if d.y != 0.0:
            end = slab.half if d.y > 0.0 else -slab.half
            to_face = max((end - y) / d.y, 0.0)
            reaches = to_face < step
            step = to_face if reaches else step
        power = light.i1 + light.i2
        if has_monitors:
            start = travelled * flat
            count_monitors(tables, sums, x + start * ux, z + start * uz, ux, uz, step * flat, power, loss / flat)
        if loss > 0.0:
            light = scaled(light, math.exp(-loss * step))
            sums.fate[ABSORBED] += power - (light.i1 + light.i2)
        travelled += step
        if not reaches:
            return Traversed(y + step * d.y, Beam(d, e, light), hits, False)
        y, upwards = (slab.half, 1.0) if d.y > 0.0 else (-slab.half, -1.0)
        n2 = slab.above if d.y > 0.0 else slab.below
        sums.counts[HITS] += 1
        hits += 1
        power = light.i1 + light.i2
        border = Border(Vector(0.0, -upwards, 0.0), n1, n2, False)
        parts = split_beam(Beam(d, e, light), border, bare(n1, n2, n1 * abs(d.y)))
        leaving = power_of(parts.on.light)
        if n1 == n2 or (rules.splitting == COUNT and leaving > 0.0):
            leaving, ended = power, True
        sums.fate[ESCAPED] += leaving
        sums.fate[MISSED if n1 == n2 else LEAKED] += leaving
        d, e, light = parts.back
        power = light.i1 + light.i2
        if not ended and (hits + 1 >= rules.max_hits or power < load.min_power):
            sums.fate[TRUNCATED] += power
            store_location(sums, TRUNCATIONS, x + travelled * flat * ux, z + travelled * flat * uz)
            ended = True
        if ended:
            return Traversed(y, Beam(d, e, light), hits, True)


@compiled
def wall_parts(
    tables: Tables, splitting: int, c: int, behaviour: int, colour: int, event: Event, beam: Beam, border: Border
) -> Parts:
    """Return both parts at a wall, with a behaviour that may differ from that in the table."""
    if behaviour >= TREATED:
        return treated_parts(tables, splitting, c, colour, event, beam, border)
    a = bare(border.n1, border.n2, -border.n1 * dot(beam.d, border.n))
    if behaviour == MIRROR:
        a = Amplitudes(1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    elif splitting == COUNT and a.on_s > 0.0:
        a = Amplitudes(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    return split_beam(beam, border, a)


@compiled
def store_beam(row: Floats, beam: Beam) -> None:
    """Write the direction, basis and coherency matrix of a ray."""
    d, e, light = beam
    flat = math.sqrt(d.x * d.x + d.z * d.z)
    if flat < MIN_FLAT:
        row[UX], row[UZ], row[FLAT] = 1.0, 0.0, MIN_FLAT
    else:
        row[UX], row[UZ], row[FLAT] = d.x / flat, d.z / flat, flat
    row[DY], row[EX], row[EY], row[EZ] = d.y, e.x, e.y, e.z
    row[I1], row[I2], row[CR], row[CI] = light.i1, light.i2, light.cr, light.ci


@called
def trace_in_space(  # noqa: C901  one loop, as in `solen.trace.kernel.loop`
    k: Precision, tables: Tables, sums: Sums, rays: RowsInSpace, rules: Rules, slab: Slab, buffers: BuffersInSpace
) -> bool:
    """Trace rays and add their powers; return False if there is no room for all waiting branches."""
    state, tags, block_hits = buffers.state, buffers.tags, buffers.hit
    waiting_state, waiting_tags = buffers.waiting_state, buffers.waiting_tags
    block = Rays(state[X], state[Z], state[UX], state[UZ], tags[LAST], state[U])
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
            store_beam(state[:, n], Beam(d, upright(d), Coherency(s, p, rays.cr[launched], rays.ci[launched])))
            state[MIN_POWER, n], state[U, n] = rules.min_weight * (s + p), 0.0
            state[OPTICAL, n] = rays.optical[launched]
            tags[REGION, n], tags[LAST, n], tags[HIT, n] = -1, -1, 0
            tags[NUMBER, n], tags[COLOUR, n] = launched, rays.colour[launched]
            launched += 1
            n += 1
        if n == 0:
            return True
        find_block(k, tables, n, block, block_hits)
        remaining = 0
        for i in range(n):
            hit = Hit(block_hits.distance[i], block_hits.curve[i], block_hits.u[i])
            c, length, u = hit.curve, hit.distance, hit.u
            x, z, y, flat, min_power = state[X, i], state[Z, i], state[Y, i], state[FLAT, i], state[MIN_POWER, i]
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
            ray = Ray(x, z, state[UX, i], state[UZ, i], tags[LAST, i], state[U, i])
            load = Load(light.i1, light.i2, min_power, state[OPTICAL, i], region, colour, number, hits)
            arrival = meet(k, tables, rules, ray, hit, load)
            if arrival.corner:
                copy_ray(state, tags, i, remaining)
                ray = past_corner(k, ray, hit)
                state[X, remaining], state[Z, remaining], tags[LAST, remaining], state[U, remaining] = (
                    ray.x,
                    ray.z,
                    c,
                    u,
                )
                remaining += 1
                continue
            sums.counts[HITS] += 1
            if arrival.undefined:
                store_location(sums, UNDEFINED, arrival.x, arrival.z)
                sums.fate[TRUNCATED] += power
                continue
            n1, path_mm = tables.refractive_index[colour, arrival.medium], length / flat
            scatters = False
            if rules.turbid:
                free = free_path(k, tables, rules, arrival.medium, load)
                scatters = free < path_mm
                path_mm = min(free, path_mm)
            path = MediumPath(path_mm, n1, arrival.loss, flat)
            y, beam, hits, ended = traverse(tables, sums, rules, slab, Vector(x, y, z), beam, path, load)
            if ended:
                continue
            d, power, optical = beam.d, power_of(beam.light), state[OPTICAL, i] + n1 * path_mm
            exhausted = hits + 1 >= rules.max_hits or power < min_power
            if scatters:
                px, pz = x + path_mm * d.x, z + path_mm * d.z
                if exhausted:
                    sums.fate[TRUNCATED] += power
                    store_location(sums, TRUNCATIONS, px, pz)
                    continue
                event = Event(rules.seed, rules.first + rules.step * number, hits)
                random_1, random_2 = uniform_of(event, PHASE), uniform_of(event, PHASE + 1)
                d = henyey_greenstein(random_1, random_2, tables.anisotropy[colour, arrival.medium], d)
                copy_ray(state, tags, i, remaining)
                store_beam(state[:, remaining], Beam(d, upright(d), unpolarised(beam.light)))
                state[X, remaining], state[Y, remaining], state[Z, remaining] = px, y, pz
                state[U, remaining], state[OPTICAL, remaining] = 0.0, optical
                tags[HIT, remaining], tags[LAST, remaining], tags[REGION, remaining] = hits + 1, -1, arrival.medium
                remaining += 1
                continue
            from_right = d.x * arrival.nx + d.z * arrival.nz > 0.0
            behaviour = tables.behaviour[c]
            acts = acting(tables, c, colour) if behaviour >= TREATED else behaviour
            if acts == RECEIVER and not tables.height[c, 0] <= y <= tables.height[c, 1]:
                behaviour, acts = REFRACTING, REFRACTING
            fate = end_fate(acts, from_right, exhausted)
            if fate != GOES_ON:
                sums.fate[fate] += power
                if fate == TRUNCATED:
                    store_location(sums, TRUNCATIONS, arrival.x, arrival.z)
                if fate == DETECTED:
                    count_arrival(k, tables, sums, Ray(x, z, d.x, d.z, c, u), hit, arrival, power, optical)
                continue
            normal = Vector(-arrival.nx, 0.0, -arrival.nz) if from_right else Vector(arrival.nx, 0.0, arrival.nz)
            event = Event(rules.seed, rules.first + rules.step * number, hits)
            border = Border(normal, n1, tables.refractive_index[colour, arrival.beyond], from_right)
            through, reflected = wall_parts(tables, rules.splitting, c, behaviour, colour, event, beam, border)
            on, back = power_of(through.light), power_of(reflected.light)
            sums.fate[ABSORBED] += max(power - on - back, 0.0) if behaviour >= TREATED else 0.0
            if rules.splitting == ROULETTE and on > 0.0 and back > 0.0:
                total = on + back
                if uniform(event.seed, event.ray, hits) * total < back:
                    reflected, back, on = scaled_beam(reflected, total / back), total, 0.0
                else:
                    through, on, back = scaled_beam(through, total / on), total, 0.0
            truncated_power = (on if on < min_power else 0.0) + (back if back < min_power else 0.0)
            if truncated_power > 0.0:
                sums.fate[TRUNCATED] += truncated_power
                store_location(sums, TRUNCATIONS, arrival.x, arrival.z)
            both = on >= min_power and back >= min_power
            if not (on >= min_power or back >= min_power):
                continue
            reflected_first = back <= on if both else back >= min_power  # the weaker part is followed first
            if both and waiting == len(waiting_state):
                return False
            if both:
                row, tag = waiting_state[waiting], waiting_tags[waiting]
                if reflected_first:
                    store_beam(row, through)
                else:
                    store_beam(row, reflected)
                row[X], row[Y], row[Z], row[U] = arrival.x, y, arrival.z, u
                row[MIN_POWER], row[OPTICAL] = min_power, optical
                tag[REGION], tag[LAST], tag[HIT] = arrival.beyond if reflected_first else arrival.medium, c, hits + 1
                tag[NUMBER], tag[COLOUR] = number, colour
                waiting += 1
            if reflected_first:
                store_beam(state[:, remaining], reflected)
            else:
                store_beam(state[:, remaining], through)
            state[X, remaining], state[Y, remaining], state[Z, remaining], state[U, remaining] = (
                arrival.x,
                y,
                arrival.z,
                u,
            )
            state[MIN_POWER, remaining], state[OPTICAL, remaining] = min_power, optical
            tags[REGION, remaining] = arrival.medium if reflected_first else arrival.beyond
            tags[LAST, remaining], tags[HIT, remaining] = c, hits + 1
            tags[NUMBER, remaining], tags[COLOUR, remaining] = number, colour
            remaining += 1
        n = remaining

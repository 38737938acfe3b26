"""The compiled loop over rays: tables in, sums out, with the same physics as `solen.trace.reference`.

Rays are advanced in blocks (see `solen.trace.kernel.block`). Each ray is taken through the interface that it meets;
rays that end are replaced by waiting branches and by rays not yet launched. For a ray that starts on a curve, the root
at zero is divided out algebraically (the constant term is zero) and never excluded by a distance threshold.
"""

import math
from typing import Any

import numpy as np

from solen.trace.kernel.block import find_block
from solen.trace.kernel.block_step import DEFERRED, UNTREATED, absorbs, pass_block
from solen.trace.kernel.buffers import (
    BLOCK,
    BRANCH,
    COLOUR,
    DX,
    DZ,
    HIT,
    LAST,
    MIN_POWER,
    NUMBER,
    OPTICAL,
    PARENT,
    REGION,
    Buffers,
    Loads,
    P,
    Rays,
    Rows,
    S,
    U,
    X,
    Z,
    copy_ray,
    resume,
)
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.nearest import Hit, Ray
from solen.trace.kernel.rows import Floats, Precision, Tags
from solen.trace.kernel.step import (
    Arrival,
    Load,
    Rules,
    attenuated,
    escape,
    free_path,
    leave,
    meet,
    part,
    past_corner,
    phase_turn,
    rotated,
)
from solen.trace.kernel.surface import COUNT, ROULETTE
from solen.trace.kernel.tally import (
    HITS,
    TRUNCATIONS,
    UNDEFINED,
    Lineage,
    Sums,
    count_arrival,
    count_monitors,
    store_location,
    store_segment,
)
from solen.trace.result import ABSORBED, DETECTED, GOES_ON, TRUNCATED
from solen.trace.tables import Tables

FEW = BLOCK // 8
"""Number of rays in a block at or below which further rays are launched."""
WHOLE: Any = np.int64
"""Integer type for single rays, the same for both precisions."""


@compiled
def read(row: Floats, tag: Tags) -> tuple[Ray, Load, Lineage]:
    """Read a ray from its row."""
    ray = Ray(row[X], row[Z], row[DX], row[DZ], WHOLE(tag[LAST]), row[U])
    region, colour, number, hits = WHOLE(tag[REGION]), WHOLE(tag[COLOUR]), WHOLE(tag[NUMBER]), WHOLE(tag[HIT])
    load = Load(row[S], row[P], row[MIN_POWER], row[OPTICAL], region, colour, number, hits)
    return ray, load, Lineage(WHOLE(tag[BRANCH]), WHOLE(tag[PARENT]))


@compiled
def write(row: Floats, tag: Tags, ray: Ray, load: Load, lineage: Lineage) -> None:
    """Write a ray to its row."""
    row[X], row[Z], row[DX], row[DZ], tag[LAST], row[U] = ray
    row[S], row[P], row[MIN_POWER], row[OPTICAL], tag[REGION], tag[COLOUR], tag[NUMBER], tag[HIT] = load
    tag[BRANCH], tag[PARENT] = lineage


@compiled
def launch(
    k: Precision, rules: Rules, rays: Rows, first: int, n: int, many: int, buffers: Buffers, with_lineage: bool
) -> None:
    """Add ``many`` rays from index ``first`` on to the n rays of a block; ``with_lineage`` also sets their branches."""
    state, tags = buffers.state, buffers.tags
    for row, numbers in ((X, rays.x), (Z, rays.z), (DX, rays.dx), (DZ, rays.dz), (S, rays.s), (P, rays.p)):
        for i in range(many):
            state[row, n + i] = numbers[first + i]
    for i in range(n, n + many):
        state[MIN_POWER, i], state[OPTICAL, i] = rules.min_weight * (state[S, i] + state[P, i]), k.zero
    for row, tag in ((REGION, -1), (LAST, -1), (HIT, 0), (BRANCH, 0), (PARENT, -1)):
        for i in range(many if with_lineage or row not in (BRANCH, PARENT) else 0):
            tags[row, n + i] = tag
    for i in range(many):
        tags[NUMBER, n + i] = first + i
    for i in range(many):
        tags[COLOUR, n + i] = rays.colour[first + i]


@compiled
def close_up(n: int, state: Floats, tags: Tags, fate: Tags) -> int:
    """Move the last continuing rays to the positions of rays that have ended; return the number of continuing rays."""
    first = 0
    while True:
        while first < n and fate[first] == GOES_ON:
            first += 1
        while first < n and fate[n - 1] != GOES_ON:
            n -= 1
        if first >= n:
            return n
        n -= 1
        copy_ray(state, tags, n, first)
        first += 1


@called
def scatter(
    k: Precision,
    tables: Tables,
    sums: Sums,
    rules: Rules,
    ray: Ray,
    load: Load,
    lineage: Lineage,
    arrival: Arrival,
    way: float,
) -> tuple[bool, Ray, Load]:
    """Scatter a ray in a medium after the distance ``way``; return whether it continues, and the scattered ray."""
    kept = math.exp(-arrival.loss * way) if arrival.loss > 0.0 else k.one
    after = attenuated(load, kept, tables.refractive_index[load.colour, arrival.medium] * way)
    power, left = load.s + load.p, after.s + after.p
    exhausted = load.hits + 1 >= rules.max_hits or left < load.min_power
    if len(tables.monitor) > 0:
        count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, way, power, arrival.loss)
    if len(sums.segments) > 0:
        store_segment(sums, rules, ray, load, lineage, -1, TRUNCATED if exhausted else GOES_ON, way, kept)
    sums.fate[ABSORBED] += power - left
    x, z = ray.x + way * ray.dx, ray.z + way * ray.dz
    if exhausted:
        sums.fate[TRUNCATED] += left
        store_location(sums, TRUNCATIONS, x, z)
    dx, dz = rotated(k, phase_turn(k, tables, rules, arrival.medium, load), ray.dx, ray.dz)
    ahead = Load(
        after.s, after.p, load.min_power, after.optical, arrival.medium, load.colour, load.number, load.hits + 1
    )
    return not exhausted, Ray(x, z, dx, dz, -1, k.zero), ahead


@called
def trace_rays(  # noqa: C901  one loop, as passing arrays takes time
    k: Precision, tables: Tables, sums: Sums, rays: Rows, rules: Rules, buffers: Buffers, treatments: Floats | None
) -> bool:
    """Trace rays and add their powers; return False if there is no room for all waiting branches.

    ``treatments`` are those of the tables, or None if there are none.
    """
    state, tags, block_hits = buffers.state, buffers.tags, buffers.hit
    block = Rays(state[X], state[Z], state[DX], state[DZ], tags[LAST], state[U])
    waiting_state, waiting_tags, branches = buffers.waiting_state, buffers.waiting_tags, buffers.branches
    stores_segments, has_monitors = len(sums.segments) > 0, len(tables.monitor) > 0
    n, waiting, launched, fates = 0, 0, 0, block_hits.int_work
    loads = Loads(state[S], state[P], state[MIN_POWER], state[OPTICAL], tags[REGION], tags[COLOUR], tags[HIT])
    clear = rules.splitting == COUNT or not absorbs(tables.absorption)
    special = stores_segments or has_monitors or rules.turbid or sums.position.shape[1] > 0 or sums.angle.shape[1] > 0
    side_by_side = rules.splitting != ROULETTE and not special
    while True:
        n, waiting = resume(state, tags, n, waiting_state, waiting_tags, waiting)
        fresh = n <= FEW  # rays launched together meet the same curves and are not mixed with others
        if fresh:
            many = min(BLOCK - n, len(rays.x) - launched)
            launch(k, rules, rays, launched, n, many, buffers, not side_by_side)
            launched += many
            n += many
        if n == 0:
            return True
        find_block(k, tables, n, block, block_hits)
        left = n
        if side_by_side:
            if waiting + n > len(waiting_state):
                return False
            waiting, left = pass_block(k, tables, rules, sums, n, block, loads, buffers, clear, waiting)
        else:
            for i in range(n):
                fates[i] = DEFERRED
        for i in range(n if left > 0 else 0):
            if fates[i] > UNTREATED:
                continue
            fates[i] = GOES_ON
            ray, load, lineage = read(state[:, i], tags[:, i])
            hit, power = Hit(block_hits.distance[i], WHOLE(block_hits.curve[i]), block_hits.u[i]), load.s + load.p
            if hit.curve < 0:
                loss, fate = escape(k, tables, rules, load.region, load.colour)
                if has_monitors:
                    count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, math.inf, power, loss)
                if stores_segments:
                    store_segment(sums, rules, ray, load, lineage, -1, fate, math.inf, 1.0)
                sums.fate[fate] += power
                fates[i] = fate
                continue
            arrival = meet(k, tables, rules, ray, hit, load)
            if arrival.corner:
                write(state[:, i], tags[:, i], past_corner(k, ray, hit), load, lineage)
                continue
            sums.counts[HITS] += 1
            if rules.turbid and not arrival.undefined:
                way = free_path(k, tables, rules, arrival.medium, load)
                if way < hit.distance:
                    goes_on, ray, load = scatter(k, tables, sums, rules, ray, load, lineage, arrival, way)
                    write(state[:, i], tags[:, i], ray, load, lineage)
                    fates[i] = GOES_ON if goes_on else TRUNCATED
                    continue
            if arrival.undefined:
                store_location(sums, UNDEFINED, arrival.x, arrival.z)
            elif has_monitors:
                count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, hit.distance, power, arrival.loss)
            if stores_segments:
                store_segment(
                    sums, rules, ray, load, lineage, tables.owner[hit.curve], arrival.fate, hit.distance, arrival.kept
                )
            load = attenuated(load, arrival.kept, tables.refractive_index[load.colour, arrival.medium] * hit.distance)
            if arrival.loss > 0.0:
                sums.fate[ABSORBED] += power - (load.s + load.p)
                power = load.s + load.p
            if arrival.fate != GOES_ON:
                fates[i] = arrival.fate
                sums.fate[arrival.fate] += power
                if arrival.fate == TRUNCATED and not arrival.undefined:
                    store_location(sums, TRUNCATIONS, arrival.x, arrival.z)
                if arrival.fate == DETECTED:
                    count_arrival(k, tables, sums, ray, hit, arrival, power, load.optical)
                continue
            departure = leave(k, tables, rules, treatments, ray, hit.curve, arrival, load)
            if departure.absorbed > 0.0:
                sums.fate[ABSORBED] += departure.absorbed
            if departure.truncated > 0.0:
                sums.fate[TRUNCATED] += departure.truncated
                store_location(sums, TRUNCATIONS, arrival.x, arrival.z)
            if departure.ends:
                fates[i] = TRUNCATED
                continue
            if departure.both:
                if waiting == len(waiting_state):
                    return False
                ray, other_load = part(hit, arrival, departure.parts, load, not departure.reflected_first)
                write(waiting_state[waiting], waiting_tags[waiting], ray, other_load, lineage)
                waiting += 1
                lineage = Lineage(branches[load.number], lineage.branch)
                branches[load.number] += 1
            ray, load = part(hit, arrival, departure.parts, load, departure.reflected_first)
            write(state[:, i], tags[:, i], ray, load, lineage)
        n = close_up(n, state, tags, fates)

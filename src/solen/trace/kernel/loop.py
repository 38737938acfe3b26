"""The compiled loop over rays: tables in, sums out, with the same physics as `solen.trace.reference`.

Rays are advanced in blocks (see `solen.trace.kernel.block`). Each ray is taken through the interface that it meets;
rays that end are replaced by waiting branches and by rays not yet launched. For a ray that starts on a curve, the root
at zero is divided out algebraically (the constant term is zero) and never excluded by a distance threshold.
"""

import math
from typing import Any

import numpy as np

from solen.trace.kernel.block import find_block
from solen.trace.kernel.block_step import ASIDE, LEFT, absorbs, pass_block
from solen.trace.kernel.buffers import (
    AT,
    BLOCK,
    BRANCH,
    COLOUR,
    DX,
    DZ,
    HIT,
    LAST,
    LEAST,
    NUMBER,
    OPTICAL,
    PARENT,
    REGION,
    Buffers,
    Carried,
    P,
    Rays,
    Rows,
    S,
    X,
    Z,
    copy_ray,
    resume,
)
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.nearest import Hit, Ray
from solen.trace.kernel.rows import Floats, Precision, Tags
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
from solen.trace.kernel.surface import COUNT, ROULETTE
from solen.trace.kernel.tally import (
    CUT,
    HITS,
    UNDEFINED,
    Stem,
    Sums,
    count_arrival,
    count_monitors,
    note_leg,
    note_place,
)
from solen.trace.result import ABSORBED, DETECTED, GOES_ON, TRUNCATED
from solen.trace.tables import Tables

FEW = BLOCK // 8
"""Number of rays left in a block at which further rays are launched."""
WHOLE: Any = np.int64
"""Integer type for single rays, the same for both precisions."""


@compiled
def read(row: Floats, tag: Tags) -> tuple[Ray, Load, Stem]:
    """Read a ray from its row."""
    ray = Ray(row[X], row[Z], row[DX], row[DZ], WHOLE(tag[LAST]), row[AT])
    region, colour, number, hits = WHOLE(tag[REGION]), WHOLE(tag[COLOUR]), WHOLE(tag[NUMBER]), WHOLE(tag[HIT])
    load = Load(row[S], row[P], row[LEAST], row[OPTICAL], region, colour, number, hits)
    return ray, load, Stem(WHOLE(tag[BRANCH]), WHOLE(tag[PARENT]))


@compiled
def write(row: Floats, tag: Tags, ray: Ray, load: Load, stem: Stem) -> None:
    """Write a ray to its row."""
    row[X], row[Z], row[DX], row[DZ], tag[LAST], row[AT] = ray
    row[S], row[P], row[LEAST], row[OPTICAL], tag[REGION], tag[COLOUR], tag[NUMBER], tag[HIT] = load
    tag[BRANCH], tag[PARENT] = stem


@compiled
def launch(
    k: Precision, rules: Rules, rays: Rows, first: int, n: int, many: int, buffers: Buffers, stems: bool
) -> None:
    """Add rays from number ``first`` on behind the n rays of a block, row by row; ``stems`` numbers their branches."""
    state, tags = buffers.state, buffers.tags
    for row, numbers in ((X, rays.x), (Z, rays.z), (DX, rays.dx), (DZ, rays.dz), (S, rays.s), (P, rays.p)):
        for i in range(many):
            state[row, n + i] = numbers[first + i]
    for i in range(n, n + many):
        state[LEAST, i], state[OPTICAL, i] = rules.min_weight * (state[S, i] + state[P, i]), k.zero
    for row, tag in ((REGION, -1), (LAST, -1), (HIT, 0), (BRANCH, 0), (PARENT, -1)):
        for i in range(many if stems or row not in (BRANCH, PARENT) else 0):
            tags[row, n + i] = tag
    for i in range(many):
        tags[NUMBER, n + i] = first + i
    for i in range(many):
        tags[COLOUR, n + i] = rays.colour[first + i]


@compiled
def close_up(n: int, state: Floats, tags: Tags, fate: Tags) -> int:
    """Move the last continuing rays to the positions of rays that ended; return the number of continuing rays."""
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
    k: Precision, tables: Tables, sums: Sums, rules: Rules, ray: Ray, load: Load, stem: Stem, met: Meeting, way: float
) -> tuple[bool, Ray, Load]:
    """Scatter a ray in a medium after the distance ``way``; return whether it continues, and the scattered ray."""
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
    k: Precision, tables: Tables, sums: Sums, rays: Rows, rules: Rules, buffers: Buffers, treatments: Floats | None
) -> bool:
    """Trace rays and add their powers; return False if there is no room for all waiting branches.

    ``treatments`` are those of the tables, or None if there are none.
    """
    state, tags, found = buffers.state, buffers.tags, buffers.found
    block = Rays(state[X], state[Z], state[DX], state[DZ], tags[LAST], state[AT])
    waiting_state, waiting_tags, branches = buffers.waiting_state, buffers.waiting_tags, buffers.branches
    keeps_legs, has_monitors = len(sums.legs) > 0, len(tables.monitor) > 0
    n, waiting, launched, fates = 0, 0, 0, found.pick
    carried = Carried(state[S], state[P], state[LEAST], state[OPTICAL], tags[REGION], tags[COLOUR], tags[HIT])
    clear = rules.splitting == COUNT or not absorbs(tables.absorption)
    special = keeps_legs or has_monitors or rules.turbid or sums.position.shape[1] > 0 or sums.angle.shape[1] > 0
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
        find_block(k, tables, n, block, found)
        left = n
        if side_by_side:
            if waiting + n > len(waiting_state):
                return False
            waiting, left = pass_block(k, tables, rules, sums, n, block, carried, buffers, clear, waiting)
        else:
            for i in range(n):
                fates[i] = LEFT
        for i in range(n if left > 0 else 0):
            if fates[i] > ASIDE:
                continue
            fates[i] = GOES_ON
            ray, load, stem = read(state[:, i], tags[:, i])
            hit, power = Hit(found.distance[i], WHOLE(found.curve[i]), found.place[i]), load.s + load.p
            if hit.curve < 0:
                loss, fate = escape(k, tables, rules, load.region, load.colour)
                if has_monitors:
                    count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, math.inf, power, loss)
                if keeps_legs:
                    note_leg(sums, rules, ray, load, stem, -1, fate, math.inf, 1.0)
                sums.fate[fate] += power
                fates[i] = fate
                continue
            met = meet(k, tables, rules, ray, hit, load)
            if met.corner:
                write(state[:, i], tags[:, i], carried_on(k, ray, hit), load, stem)
                continue
            sums.counts[HITS] += 1
            if rules.turbid and not met.undefined:
                way = free_path(k, tables, rules, met.here, load)
                if way < hit.distance:
                    goes_on, ray, load = scatter(k, tables, sums, rules, ray, load, stem, met, way)
                    write(state[:, i], tags[:, i], ray, load, stem)
                    fates[i] = GOES_ON if goes_on else TRUNCATED
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
                fates[i] = met.fate
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
                fates[i] = TRUNCATED
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
            write(state[:, i], tags[:, i], ray, load, stem)
        n = close_up(n, state, tags, fates)

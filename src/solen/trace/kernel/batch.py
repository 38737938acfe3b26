"""Many scenes in one call: their tables and rays one after the other in long arrays, and where each begins."""

from typing import NamedTuple

from solen.arrays import IntArray
from solen.trace.kernel.compiled import called
from solen.trace.kernel.loop import trace_rays
from solen.trace.kernel.room import Rows, Space
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.step import Rules
from solen.trace.kernel.tally import Sums
from solen.trace.tables import Tables


class Starts(NamedTuple):
    """Where the rows of each scene begin in the arrays of `Tables` (S + 1,)."""

    piece: IntArray
    wavelength: IntArray
    monitor: IntArray
    cell: IntArray
    item: IntArray
    treatment: IntArray
    layer: IntArray


class Tasks(NamedTuple):
    """One source of one scene and one group of its rays each: (J,) or, of what begins where, (J + 1,)."""

    scene: IntArray
    first: IntArray
    """number of the first ray"""
    step: IntArray
    ray: IntArray
    receiver: IntArray
    monitor: IntArray
    bin: IntArray


@called
def trace_tasks(
    k: Precision,
    tables: Tables,
    starts: Starts,
    tasks: Tasks,
    sums: Sums,
    rays: Rows,
    rules: Rules,
    space: Space,
    treatments: Floats | None,
    begin: int,
    stop: int,
) -> bool:
    """Trace the tasks from ``begin`` up to ``stop``; False where there is no room for all the branches that wait.

    Of ``sums``, fate, counts and place have a row for every task; of receivers, monitors and bins each has its own.
    """
    for j in range(begin, stop):
        i = tasks.scene[j]
        p, q = starts.piece[i], starts.piece[i + 1]
        v, w = starts.wavelength[i], starts.wavelength[i + 1]
        m, n = starts.monitor[i], starts.monitor[i + 1]
        mine = Tables(
            tables.kind[p:q],
            tables.shape[p:q],
            tables.middle[p:q],
            tables.box[p:q],
            tables.owner[p:q],
            tables.before[p:q],
            tables.behaviour[p:q],
            tables.treatment[p:q],
            tables.left[p:q],
            tables.right[p:q],
            tables.receiver[p:q],
            tables.height[p:q],
            tables.refractive_index[v:w],
            tables.absorption[v:w],
            tables.scattering[v:w],
            tables.anisotropy[v:w],
            tables.wavelength[v:w],
            tables.treatments[starts.treatment[i] : starts.treatment[i + 1]],
            tables.layers[starts.layer[i] : starts.layer[i + 1]],
            tables.monitor[m:n],
            tables.bins[m:n],
            tables.first_bin[m:n],
            tables.grid_low[2 * i : 2 * i + 2],
            tables.grid_cell[2 * i : 2 * i + 2],
            tables.grid_many[2 * i : 2 * i + 2],
            tables.grid_first[starts.cell[i] : starts.cell[i + 1]],
            tables.grid_item[starts.item[i] : starts.item[i + 1]],
        )
        d, e = tasks.receiver[j], tasks.receiver[j + 1]
        a, b = tasks.monitor[j], tasks.monitor[j + 1]
        own = Sums(
            sums.fate[j],
            sums.detected[d:e],
            sums.arrived[d:e],
            sums.optical[d:e],
            sums.position,
            sums.angle,
            sums.crossed[a:b],
            sums.crossings[a:b],
            sums.maps[tasks.bin[j] : tasks.bin[j + 1]],
            sums.counts[j],
            sums.place[j],
            sums.legs,
        )
        x, y = tasks.ray[j], tasks.ray[j + 1]
        some = Rows(rays.x[x:y], rays.z[x:y], rays.dx[x:y], rays.dz[x:y], rays.s[x:y], rays.p[x:y], rays.colour[x:y])
        rule = Rules(
            rules.splitting,
            rules.min_weight,
            rules.max_hits,
            rules.seed,
            tasks.first[j],
            tasks.step[j],
            rules.turbid,
        )
        room = Space(
            space.state, space.tags, space.found, space.waiting_state, space.waiting_tags, space.branches[: y - x]
        )
        for ray in range(y - x):
            room.branches[ray] = 1
        if not trace_rays(k, mine, own, some, rule, room, None if treatments is None else mine.treatments):
            return False
    return True

"""Many scenes in one call, in the plane or in space, with their tables and rays concatenated in long arrays."""

from typing import NamedTuple

from solen.arrays import IntArray
from solen.trace.kernel.buffers import Buffers, Rows
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.extruded import BuffersInSpace, RowsInSpace, Slab, trace_in_space
from solen.trace.kernel.loop import trace_rays
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.step import Rules
from solen.trace.kernel.tally import Sums
from solen.trace.tables import Tables


class Starts(NamedTuple):
    """Start of the rows of each scene in the arrays of `Tables` (S + 1,)."""

    piece: IntArray
    wavelength: IntArray
    monitor: IntArray
    cell: IntArray
    item: IntArray
    treatment: IntArray
    layer: IntArray


class Tasks(NamedTuple):
    """Tasks (J,), each with one group of the rays of one source of one scene; starts of rows are (J + 1,)."""

    scene: IntArray
    first: IntArray
    """number of the first ray of each task"""
    step: IntArray
    ray: IntArray
    receiver: IntArray
    monitor: IntArray
    bin: IntArray


@compiled
def tables_of(tables: Tables, starts: Starts, i: int) -> Tables:
    """Return the tables of one scene."""
    p, q = starts.piece[i], starts.piece[i + 1]
    v, w = starts.wavelength[i], starts.wavelength[i + 1]
    m, n = starts.monitor[i], starts.monitor[i + 1]
    g, h = 2 * i, 2 * i + 2
    return Tables(
        tables.kind[p:q], tables.shape[p:q], tables.middle[p:q], tables.box[p:q], tables.owner[p:q],
        tables.previous[p:q], tables.behaviour[p:q], tables.treatment[p:q], tables.left[p:q], tables.right[p:q],
        tables.receiver[p:q], tables.height[p:q], tables.refractive_index[v:w], tables.absorption[v:w],
        tables.scattering[v:w], tables.anisotropy[v:w], tables.wavelength[v:w],
        tables.treatments[starts.treatment[i] : starts.treatment[i + 1]],
        tables.layers[starts.layer[i] : starts.layer[i + 1]],
        tables.monitor[m:n], tables.bins[m:n], tables.first_bin[m:n],
        tables.grid_low[g:h], tables.grid_cell[g:h], tables.grid_count[g:h],
        tables.grid_first[starts.cell[i] : starts.cell[i + 1]], tables.grid_item[starts.item[i] : starts.item[i + 1]],
    )  # fmt: skip


@compiled
def sums_of(sums: Sums, tasks: Tasks, j: int) -> Sums:
    """Return the sums of one task."""
    d, e = tasks.receiver[j], tasks.receiver[j + 1]
    a, b = tasks.monitor[j], tasks.monitor[j + 1]
    return Sums(
        sums.fate[j], sums.detected[d:e], sums.arrived[d:e], sums.optical[d:e], sums.position, sums.angle,
        sums.crossed[a:b], sums.crossings[a:b], sums.maps[tasks.bin[j] : tasks.bin[j + 1]], sums.counts[j],
        sums.location[j], sums.segments,
    )  # fmt: skip


@called
def trace_tasks(
    k: Precision,
    tables: Tables,
    starts: Starts,
    tasks: Tasks,
    sums: Sums,
    rays: Rows,
    rules: Rules,
    buffers: Buffers,
    treatments: Floats | None,
    begin: int,
    stop: int,
) -> bool:
    """Trace the tasks from ``begin`` up to ``stop``; return False if there is no room for all waiting branches.

    In ``sums``, fate, counts and location have one row per task; ``tasks`` contains the first row of each task's
    receivers, monitors and bins.
    """
    for j in range(begin, stop):
        i = tasks.scene[j]
        task_tables, task_sums = tables_of(tables, starts, i), sums_of(sums, tasks, j)
        x, y = tasks.ray[j], tasks.ray[j + 1]
        task_rays = Rows(
            rays.x[x:y], rays.z[x:y], rays.dx[x:y], rays.dz[x:y], rays.s[x:y], rays.p[x:y], rays.colour[x:y]
        )
        task_rules = Rules(
            rules.splitting,
            rules.min_weight,
            rules.max_hits,
            rules.seed,
            tasks.first[j],
            tasks.step[j],
            rules.turbid,
        )
        task_buffers = Buffers(
            buffers.state,
            buffers.tags,
            buffers.hit,
            buffers.waiting_state,
            buffers.waiting_tags,
            buffers.branches[: y - x],
        )
        for ray in range(y - x):
            task_buffers.branches[ray] = 1
        if not trace_rays(
            k,
            task_tables,
            task_sums,
            task_rays,
            task_rules,
            task_buffers,
            None if treatments is None else task_tables.treatments,
        ):
            return False
    return True


@called
def trace_tasks_in_space(
    k: Precision, tables: Tables, starts: Starts, tasks: Tasks, sums: Sums, rays: RowsInSpace, rules: Rules, slab: Slab,
    buffers: BuffersInSpace,
) -> bool:  # fmt: skip
    """As `trace_tasks`, for all tasks in space, where all scenes share one slab."""
    for j in range(len(tasks.scene)):
        i = tasks.scene[j]
        task_tables, task_sums = tables_of(tables, starts, i), sums_of(sums, tasks, j)
        x, y = tasks.ray[j], tasks.ray[j + 1]
        task_rays = RowsInSpace(
            rays.x[x:y], rays.y[x:y], rays.z[x:y], rays.dx[x:y], rays.dy[x:y], rays.dz[x:y], rays.s[x:y], rays.p[x:y],
            rays.cr[x:y], rays.ci[x:y], rays.optical[x:y], rays.colour[x:y],
        )  # fmt: skip
        if not trace_in_space(k, task_tables, task_sums, task_rays, rules, slab, buffers):
            return False
    return True

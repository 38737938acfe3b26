"""Many tasks in space in one call; as `solen.trace.kernel.batch` does in the plane."""

from solen.trace.kernel.batch import Starts, Tasks
from solen.trace.kernel.compiled import called
from solen.trace.kernel.extruded import RoomInSpace, RowsInSpace, Slab, trace_in_space
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.step import Rules
from solen.trace.kernel.tally import Sums
from solen.trace.tables import Tables


@called
def trace_tasks_in_space(
    k: Precision, tables: Tables, starts: Starts, tasks: Tasks, sums: Sums, rays: RowsInSpace, rules: Rules, slab: Slab,
    room: RoomInSpace,
) -> bool:  # fmt: skip
    """Trace tasks of scenes of one slab; False where there is no room for all the branches that wait."""
    for j in range(len(tasks.scene)):
        i = tasks.scene[j]
        p, q = starts.piece[i], starts.piece[i + 1]
        v, w = starts.wavelength[i], starts.wavelength[i + 1]
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
            tables.treatments,
            tables.layers,
            tables.monitor,
            tables.bins,
            tables.first_bin,
            tables.grid_low[2 * i : 2 * i + 2],
            tables.grid_cell[2 * i : 2 * i + 2],
            tables.grid_many[2 * i : 2 * i + 2],
            tables.grid_first[starts.cell[i] : starts.cell[i + 1]],
            tables.grid_item[starts.item[i] : starts.item[i + 1]],
        )
        d, e = tasks.receiver[j], tasks.receiver[j + 1]
        own = Sums(
            sums.fate[j], sums.detected[d:e], sums.arrived[d:e], sums.optical[d:e], sums.position, sums.angle,
            sums.crossed, sums.crossings, sums.maps, sums.counts[j], sums.place[j], sums.legs,
        )  # fmt: skip
        x, y = tasks.ray[j], tasks.ray[j + 1]
        some = RowsInSpace(
            rays.x[x:y], rays.y[x:y], rays.z[x:y], rays.dx[x:y], rays.dy[x:y], rays.dz[x:y], rays.s[x:y], rays.p[x:y],
            rays.cr[x:y], rays.ci[x:y], rays.optical[x:y], rays.colour[x:y],
        )  # fmt: skip
        if not trace_in_space(k, mine, own, some, rules, slab, room):
            return False
    return True

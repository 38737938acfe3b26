"""A sweep: a design as input; a table of merits and responses as output."""

from pathlib import Path
from typing import Annotated

from solen import files
from solen.explore.axes import check_not_set
from solen.explore.machines import machine_at
from solen.explore.request import Request
from solen.explore.store import Store
from solen.explore.sweep import SweepOptions
from solen.explore.sweep import sweep as sweep_design
from solen.explore.swept import Sweep
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.trace.dataset import check_installed, netcdf_writer


def sweep(
    file: Path,
    /,
    *,
    out: Path,
    options: Annotated[SweepOptions, FLAT] = SweepOptions(),
    cluster: str | None = None,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[Sweep]:
    """Trace a design over values of its parameters, and compute the figures of merit of each response.

    Points are saved as they are traced: after an interruption, the same command continues where it stopped, and a point
    in the folder is not traced again, even if another sweep traced it.

    Parameters
    ----------
    file
        The design file.
    out
        Folder for the table, NAME-sweep.nc or, for a part of a sweep, NAME-sweep-3-of-10.nc, its options,
        NAME-sweep.json, and the traced points; created if missing. A table of other options is not overwritten.
    cluster
        Trace on the workers of a Dask cluster, specified by the address of its scheduler, tcp://HOST:PORT, or by a file
        that describes a SLURM cluster (.toml).
    """
    figure.check()
    check_installed()
    check_not_set("--over", options.over, set_)
    design = open_design(file, set_)
    stem = f"{stem_of(file)}-{options.stem}"
    request = Request(out / f"{stem}.json", design, options)
    request.check()
    with files.output_folder(out):
        result = sweep_design(design, options, Store(options.folder(out)), progress, machine_at(cluster))
        table = out / f"{stem}.nc"
        tables = {table: netcdf_writer(result.to_dataset())}
        files.write_all(drawn(result, figure, "sweep") | request.content | tables)
    return Outcome(result, named(figure=figure.figure, table=table))

"""Tolerance analysis: a design as input; yields, yield losses and a table of prints as output."""

from pathlib import Path
from typing import Annotated

from solen import files
from solen.explore.axes import check_not_set
from solen.explore.machines import machine_at
from solen.explore.request import Request
from solen.explore.store import Store
from solen.explore.tolerance import ToleranceOptions, Tolerances, print_design
from solen.explore.tolerance import tolerance as tolerance_of_design
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec import save


def tolerance(
    file: Path,
    /,
    *,
    out: Path,
    options: Annotated[ToleranceOptions, FLAT] = ToleranceOptions(),
    cluster: str | None = None,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[Tolerances]:
    """Trace prints of a design whose parameters vary: yield, largest yield losses, and acceptable tolerances.

    Prints are saved as they are traced: after an interruption, the same command continues where it stopped.

    Parameters
    ----------
    file
        The design file.
    out
        Folder for the table of prints, NAME-prints.csv, its options, NAME-prints.json, and the traced responses;
        created if missing. A table of other options is not overwritten.
    cluster
        Trace on the workers of a Dask cluster, specified by the address of its scheduler, tcp://HOST:PORT, or by a file
        that describes a SLURM cluster (.toml).
    """
    figure.check()
    check_not_set("--vary", options.vary, set_)
    design = open_design(file, set_)
    print_ = print_design(design, options)
    request = Request(out / f"{stem_of(file)}-prints.json", design, options)
    request.check()
    with files.output_folder(out):
        result = tolerance_of_design(design, options, Store(out), progress, machine_at(cluster))
        table = out / f"{stem_of(file)}-prints.csv"
        files.write_all(drawn(result, figure, "tolerance") | request.content | {table: result.table().encode()})
        printed = None if print_ is None else save(out / f"{stem_of(file)}-print-{options.print_number}.toml", print_)
    return Outcome(result, named(figure=figure.figure, table=table, print=printed))

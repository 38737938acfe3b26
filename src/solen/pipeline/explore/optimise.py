"""Inverse design: a design as input; a better design and the options of the search as output."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from solen import files
from solen.explore.axes import check_not_set
from solen.explore.optimise import Front, NondominatedDesign, OptimiseOptions, Optimum, check_prints, with_prints
from solen.explore.optimise import optimise as optimise_design
from solen.explore.request import Request
from solen.explore.store import Store
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import drawn, named
from solen.progress import part_of
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec import save


def optimise(
    file: Path,
    /,
    *,
    out: Path,
    options: Annotated[OptimiseOptions, FLAT] = OptimiseOptions(),
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[Optimum | Front]:
    """Search for design parameters that optimise a figure of merit, within limits and under deviations.

    Whenever a better design is found, it is written to a file; Ctrl-C ends the search and keeps the best design so far.
    The same command continues where it stopped. At the end, prints of the original design and of the result are
    compared; their parameters vary as in solen explore tolerance. With two goals, the search gives a front of designs.

    Parameters
    ----------
    file
        The design file.
    out
        Folder for the best design, NAME-best.toml, or the designs of a front, NAME-front-1.toml and so on, the options
        of the search, NAME-optimise.json, and the traced responses; created if missing. Designs of another search are
        not overwritten.
    """
    figure.check()
    check_not_set("--free", options.free, set_)
    design = open_design(file, set_)
    request = Request(out / f"{stem_of(file)}-optimise.json", design, options)
    request.check()
    parts = 2 if check_prints(design, options) else 1
    with files.output_folder(out):
        best = out / f"{stem_of(file)}-best.toml"

        def keep(designs: Sequence[NondominatedDesign]) -> None:
            if len(designs[0].by_goal) == 1:
                files.write_all(request.content)
                save(best, designs[0].design)

        store = Store(out)
        result = optimise_design(design, options, store, part_of(progress, 0, parts), keep)
        if isinstance(result, Optimum):
            result = with_prints(result, design, options, store, part_of(progress, 1, parts))
        files.write_all(drawn(result, figure, "optimise") | request.content)
        designs = _front_files(result, out, stem_of(file)) if isinstance(result, Front) else {"best": best}
    return Outcome(result, named(figure=figure.figure, **designs))


def _front_files(front: Front, out: Path, stem: str) -> dict[str, Path]:
    """Write the designs of a front in place of those of an earlier front, and return their files."""
    for old in out.glob(f"{stem}-front-*.toml"):
        files.remove(old)
    paths = {design.number: out / f"{stem}-front-{design.number}.toml" for design in front.designs}
    return {f"design {design.number}": save(paths[design.number], design.design) for design in front.designs}

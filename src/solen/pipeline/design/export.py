"""Export of a design: its solid and drawings, written into one folder after everything has been computed."""

from collections.abc import Sequence
from pathlib import Path

from solen import files
from solen.fabricate import DEFAULT_FORMATS, FORMATS, Export, ExportedSolid, cut_for, exported_solid
from solen.fabricate.layers import Slicing, printable_design
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.outputs import check_sources, drawn
from solen.pipeline.print.layers import layer_files, with_figure
from solen.progress import Progress
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor
from solen.spec import Design


def export(
    design: Path | Design,
    out: Path,
    formats: Sequence[str] = (),
    assignments: Sequence[str] = (),
    *,
    tolerance_mm: float = 1e-3,
    figure: FigureOptions = FigureOptions(),
    slicing: Slicing | None = None,
    progress: Progress | None = None,
) -> Outcome[ExportedSolid]:
    """Write a design's solid and drawings into a folder.

    Parameters
    ----------
    design
        The design or its file; the written files have its name.
    out
        Folder for the files, created if missing; files of the same names are replaced.
    formats
        Some of `FORMATS`; default: `DEFAULT_FORMATS`, or with ``slicing`` none.
    assignments
        ``key=value`` assignments to the design.
    tolerance_mm
        Largest distance of a mesh from the exact walls.
    figure
        Draw the solid into this file.
    slicing
        Also cut the part into layers.
    progress
        Called with the completed share of the layers.

    Raises
    ------
    SolenError
        If the design cannot be built, an extra is missing, or a file cannot be written; then nothing is written.
    """
    figure.check()
    chosen = [kind for kind in FORMATS if kind in (formats or (DEFAULT_FORMATS if slicing is None else ()))]
    for kind in chosen:
        FORMATS[kind].needs()
    part = design if isinstance(design, Design) else open_design(design, assignments)
    part = part if slicing is None else cut_for(part, slicing.layer_um)
    path = Path(f"{part.name}.toml") if isinstance(design, Design) else design
    made = Export(part, Sensor.of(part).body(), tolerance_mm)
    stem = stem_of(path)
    with files.output_folder(out):
        targets = with_figure({kind: out / f"{stem}{FORMATS[kind].ending}" for kind in chosen}, figure.figure)
        contents: dict[Path, files.Content] = {targets[kind]: FORMATS[kind].write(made) for kind in chosen}
        contents |= drawn(made, figure, "solid")
        layers = None
        if slicing is not None:
            printable = printable_design(part, made.part, path, slicing)
            layers = layer_files(printable, slicing, out, stem, FigureOptions(), progress)
            targets |= layers.targets
            contents |= layers.contents()
        check_sources(contents, [path, *part.files.values()])
        files.write_all(contents)
    return Outcome(exported_solid(made, chosen, None if layers is None else layers.result), targets)

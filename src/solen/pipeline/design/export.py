"""Export of a design: its solid and drawings, written to a folder after all of them have been computed."""

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
    """Write the solid and the drawings of a design to a folder.

    Parameters
    ----------
    design
        The design or its file; the files are named after it.
    out
        Folder for the files, created if missing; existing files of the same names are replaced.
    formats
        Keys of `FORMATS`; default: `DEFAULT_FORMATS`, or none with ``slicing``.
    assignments
        ``key=value`` assignments to the design.
    tolerance_mm
        Maximum distance of a mesh from the exact walls.
    figure
        File and style of a figure of the solid.
    slicing
        Slicing options; if they are specified, the layer images are also written.
    progress
        Called with the completed fraction of the layers.

    Raises
    ------
    SolenError
        If the design cannot be built, an extra is missing, or a file cannot be written; then nothing is written.
    """
    figure.check()
    kinds = [kind for kind in FORMATS if kind in (formats or (DEFAULT_FORMATS if slicing is None else ()))]
    for kind in kinds:
        FORMATS[kind].needs()
    sensor = design if isinstance(design, Design) else open_design(design, assignments)
    sensor = sensor if slicing is None else cut_for(sensor, slicing.layer_um)
    path = Path(f"{sensor.name}.toml") if isinstance(design, Design) else design
    solid = Export(sensor, Sensor.of(sensor).body(), tolerance_mm)
    stem = stem_of(path)
    with files.output_folder(out):
        targets = with_figure({kind: out / f"{stem}{FORMATS[kind].ending}" for kind in kinds}, figure.figure)
        contents: dict[Path, files.Content] = {targets[kind]: FORMATS[kind].write(solid) for kind in kinds}
        contents |= drawn(solid, figure, "solid")
        layers = None
        if slicing is not None:
            printable = printable_design(sensor, solid.part, path, slicing)
            layers = layer_files(printable, slicing, out, stem, FigureOptions(), progress)
            targets |= layers.targets
            contents |= layers.contents()
        check_sources(contents, [path, *sensor.files.values()])
        files.write_all(contents)
    return Outcome(exported_solid(solid, kinds, None if layers is None else layers.result), targets)

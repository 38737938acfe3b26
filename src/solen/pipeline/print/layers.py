"""Layers of a part: a design or a mesh as input; layer images, STL, settings and a figure as output.

Images are written one by one into an archive under a temporary name. Overview sheet, STL and figure follow, and
either all files are renamed to their final names or none.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from solen import fabricate, files
from solen.errors import OutputError, SpecError
from solen.fabricate.coupons import printable_coupon
from solen.fabricate.grey import Greys
from solen.fabricate.layers import (
    Job,
    Layer,
    LayeredPrint,
    Printable,
    Slicing,
    Stack,
    as_sheet,
    layered_print,
    lift_of,
    printable_design,
    printable_mesh,
    write_archive,
    write_goo,
)
from solen.fabricate.process import Process, ProcessOptions, files_read, process_of
from solen.fabricate.seats import SeatOptions
from solen.parts import printer_of
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import check_sources, drawn
from solen.progress import Progress
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor


@dataclass
class LayerFiles:
    """Files of a job, written in the order of `contents`: images come first, because the other files report on them."""

    job: Job
    part: Printable
    targets: dict[str, Path]
    figure: FigureOptions
    progress: Progress | None
    stack: Stack | None = None

    def contents(self) -> dict[Path, files.Content]:
        """Return the content of each file."""
        makers: dict[str, files.Content] = {
            "layers": self._write_images,
            "placed": self.part.write_stl,
            "sheet": lambda path: path.write_bytes(as_sheet(self.result.settings, self.result.warnings).encode()),
            "settings": lambda path: path.write_bytes(self._settings()),
        }
        contents = {self.targets[kind]: make for kind, make in makers.items() if kind in self.targets}
        return contents | drawn(self.result, self.figure, "layers")

    @property
    def result(self) -> LayeredPrint:
        """The numbers of the job."""
        return layered_print(self.job, self.part, self.targets["placed"].name, self.stack)

    def _write_images(self, path: Path) -> None:
        def watch(layer: Layer) -> None:
            if self.progress is not None:
                self.progress((layer.index + 1) / self.job.count)

        writer = {"zip": write_archive, "goo": write_goo}[self.job.slicing.format]
        self.stack = writer(path, self.job, self.part, watch)

    def _settings(self) -> bytes:
        data = self.result.settings.to_dict() | {"warnings": list(self.result.warnings)}
        return f"{json.dumps(data, indent=1, allow_nan=False)}\n".encode()


def layers(
    file: Path,
    /,
    *,
    out: Path,
    slicing: Annotated[Slicing, FLAT] = Slicing(),
    seats: Annotated[SeatOptions, FLAT] = SeatOptions(),
    set_: Set = None,
    run: str | None = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[LayeredPrint]:
    """Cut a design, a coupon's job or a mesh into anti-aliased layers for a printer, with STL and settings.

    Parameters
    ----------
    file
        A design (.toml), the job of a coupon (.json) or a closed mesh (.stl in mm, .3mf); the written files have its
        name.
    out
        Folder for the files; created if missing.
    run
        The run to prepare, for a coupon printed in several runs: base or layer of film-layer.

    Raises
    ------
    SolenError
        If the file or an option is invalid, or the part does not fit; then nothing is written.
    """
    figure.check()
    assignments = [*(set_ or ()), *seats.assignments]
    if figure.figure is not None and slicing.sheet_only:
        raise SpecError("--figure", limit="draws layers, but --sheet-only makes none", remedy="leave one of them out")
    if file.suffix.lower() != ".json":
        slicing = with_process_defaults(slicing)
    sources = files_read(slicing.process, slicing.cure)
    if file.suffix.lower() == ".toml":
        design = fabricate.cut_for(open_design(file, assignments), slicing.layer_um)
        part = printable_design(design, fabricate.sensor_part(design, Sensor.of(design).body()), file, slicing)
        sources += design.files.values()
    elif assignments:
        raise SpecError("--set", value=assignments[0], limit="applies to a design only")
    elif file.suffix.lower() == ".json":
        part, slicing = printable_coupon(file, slicing, run)
    else:
        part = printable_mesh(file, slicing)
    if run is not None and file.suffix.lower() != ".json":
        raise SpecError("--run", value=run, limit="applies to the job of a coupon only", remedy="leave it out")
    stem = part.label.name if file.suffix.lower() == ".json" else stem_of(file)
    with files.output_folder(out):
        made = layer_files(part, slicing, out, stem, figure, progress)
        check_sources(made.targets.values(), [file, *sources])
        files.write_all(made.contents())
    return Outcome(made.result, made.targets)


def printed_by(slicing: Slicing) -> Process | None:
    """Return the process for a slicing, with the specified working curve; None if neither is specified."""
    if slicing.process is None and slicing.cure is None:
        return None
    return process_of(ProcessOptions(process=slicing.process, cure=slicing.cure))[0]


def with_process_defaults(slicing: Slicing) -> Slicing:
    """Return slicing options with the layer heights and exposures of their process."""
    process = None if slicing.process is None else printed_by(slicing)
    return slicing if process is None else slicing.with_defaults_of(process.process)


def layer_files(
    part: Printable, slicing: Slicing, out: Path, stem: str, figure: FigureOptions, progress: Progress | None
) -> LayerFiles:
    """Check a job and return it with the names of its files."""
    process = printed_by(slicing)
    greys = Greys() if process is None else process.greys
    job = Job(part.solid, printer_of(slicing.printer), slicing, greys, process)
    if slicing.format == "goo":
        lift_of(job)
    layers = {"zip": "-layers.zip", "goo": ".goo"}[slicing.format]
    endings = {"layers": layers, "placed": "-placed.stl", "sheet": "-settings.md", "settings": "-settings.json"}
    if slicing.sheet_only:
        del endings["layers"]
    targets = {kind: out / f"{stem}{ending}" for kind, ending in endings.items()}
    return LayerFiles(job, part, with_figure(targets, figure.figure), figure, progress)


def with_figure(targets: dict[str, Path], figure: Path | None) -> dict[str, Path]:
    """Add the requested figure to the files of a command; raise `OutputError` if it is one of them already."""
    if figure is None:
        return targets
    if figure.resolve() in {target.resolve() for target in targets.values()}:
        raise OutputError(str(figure), limit="is also another output of this command", remedy="rename the figure")
    return targets | {"figure": figure}

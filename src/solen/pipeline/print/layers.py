"""Layers of a part: a design, a coupon job or a mesh as input; layer images, STL, settings and a figure as output.

Images are written one after the other into a file with a temporary name, followed by the other files; then either all
files are renamed or none.
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
    """Files of a job, written in the order of `contents`: images first, because others contain their statistics."""

    job: Job
    part: Printable
    targets: dict[str, Path]
    figure: FigureOptions
    progress: Progress | None
    stack: Stack | None = None

    def contents(self) -> dict[Path, files.Content]:
        """Return the contents of the files."""
        writers: dict[str, files.Content] = {
            "layers": self._write_images,
            "placed": self.part.write_stl,
            "sheet": lambda path: path.write_bytes(as_sheet(self.result.settings, self.result.warnings).encode()),
            "settings": lambda path: path.write_bytes(self._settings()),
        }
        contents = {self.targets[kind]: write for kind, write in writers.items() if kind in self.targets}
        return contents | drawn(self.result, self.figure, "layers")

    @property
    def result(self) -> LayeredPrint:
        """The result of the job, with the statistics of the images if they have been written."""
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
    """Slice a design, a coupon job or a mesh into anti-aliased layers for a printer, with STL and settings.

    Parameters
    ----------
    file
        A design (.toml), a coupon job (.json) or a closed mesh (.stl in mm, .3mf); the files are named after it.
    out
        Folder for the files; created if missing.
    run
        The run of a coupon that is printed in several runs: base or layer of film-layer.

    Raises
    ------
    SolenError
        If the file or an option is invalid, or the part does not fit; then nothing is written.
    """
    figure.check()
    assignments = [*(set_ or ()), *seats.assignments]
    if figure.figure is not None and slicing.sheet_only:
        limit = "cannot be combined with --sheet-only, which writes no layers"
        raise SpecError("--figure", limit=limit, remedy="omit one of them")
    kind = file.suffix.lower()
    if assignments and kind != ".toml":
        raise SpecError("--set", value=assignments[0], limit="applies to designs only", remedy="omit it")
    if run is not None and kind != ".json":
        raise SpecError("--run", value=run, limit="applies to coupon jobs only", remedy="omit it")
    sources = [file, *files_read(slicing.process, slicing.cure)]
    if kind == ".json":
        part, slicing = printable_coupon(file, slicing, run)
    else:
        slicing = with_process_defaults(slicing)
        if kind == ".toml":
            design = fabricate.cut_for(open_design(file, assignments), slicing.layer_um)
            sources += design.files.values()
            part = printable_design(design, fabricate.sensor_part(design, Sensor.of(design).body()), file, slicing)
        else:
            part = printable_mesh(file, slicing)
    stem = part.label.name if kind == ".json" else stem_of(file)
    with files.output_folder(out):
        job_files = layer_files(part, slicing, out, stem, figure, progress)
        check_sources(job_files.targets.values(), sources)
        files.write_all(job_files.contents())
    return Outcome(job_files.result, job_files.targets)


def process_for(slicing: Slicing) -> Process | None:
    """Return the process of slicing options, with their working curve; None if they specify neither."""
    if slicing.process is None and slicing.cure is None:
        return None
    return process_of(ProcessOptions(process=slicing.process, cure=slicing.cure))[0]


def with_process_defaults(slicing: Slicing) -> Slicing:
    """Return slicing options with the layer thickness and exposures of their process."""
    process = None if slicing.process is None else process_for(slicing)
    return slicing if process is None else slicing.with_defaults_of(process.process)


def layer_files(
    part: Printable, slicing: Slicing, out: Path, stem: str, figure: FigureOptions, progress: Progress | None
) -> LayerFiles:
    """Check a job, and return it with the paths of its files."""
    process = process_for(slicing)
    greys = Greys() if process is None else process.greys
    job = Job(part.solid, printer_of(slicing.printer), slicing, greys, process)
    if slicing.format == "goo":
        lift_of(job)
    images = {"zip": "-layers.zip", "goo": ".goo"}[slicing.format]
    endings = {"layers": images, "placed": "-placed.stl", "sheet": "-settings.md", "settings": "-settings.json"}
    if slicing.sheet_only:
        del endings["layers"]
    targets = {kind: out / f"{stem}{ending}" for kind, ending in endings.items()}
    return LayerFiles(job, part, with_figure(targets, figure.figure), figure, progress)


def with_figure(targets: dict[str, Path], figure: Path | None) -> dict[str, Path]:
    """Add the requested figure to the files of a command; raise `OutputError` if it is already one of them."""
    if figure is None:
        return targets
    if figure.resolve() in {target.resolve() for target in targets.values()}:
        limit = "is also another output of this command"
        raise OutputError(str(figure), limit=limit, remedy="choose another name for the figure")
    return targets | {"figure": figure}

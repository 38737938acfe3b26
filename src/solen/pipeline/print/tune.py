"""Tuning of a lens from print to print: an image and a design as input; a new drawing, layers and a log as output."""

import tempfile
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import fabricate, files
from solen.explore import TunedPrint, TuneOptions, TuningLog, check_tunable, log_text, read_log
from solen.explore import tune as tune_print
from solen.fabricate.layers import Slicing, printable_design
from solen.fabricate.process import compensation_files
from solen.metrology import measure_lens, read_image
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import check_ending, drawn
from solen.pipeline.print.layers import LayerFiles, layer_files, with_figure, with_process_defaults
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor


def tune(
    image: Path,
    /,
    *,
    design: Path,
    out: Path,
    options: Annotated[TuneOptions, FLAT] = TuneOptions(),
    slicing: Annotated[Slicing, FLAT] = Slicing(),
    log: Path | None = None,
    response: Annotated[bool, Parameter(negative="--no-response")] = True,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[TunedPrint]:
    """Correct the drawing of a lens for its next print, from an image of this print and the log of earlier prints.

    Parameters
    ----------
    image
        A micrograph of the printed lens, viewed along y: TIFF, OME-TIFF, PNG, JPEG (requires the extra vision).
    design
        The design file of the intended part.
    out
        Folder for the corrected drawing, its layers, STL and settings; created if missing.
    log
        Log of all prints (.json), continued if it exists; default: a log in the folder.
    response
        Trace the sensor with the designed, the printed and the predicted lens.

    Raises
    ------
    SolenError
        If the image, the design or the log is invalid, or the log is of another drawing; then nothing is written.
    """
    figure.check()
    check_ending(log, "a log", ".json")
    intended = open_design(design, set_)
    sensor = Sensor.of(intended)
    check_tunable(sensor)
    log = out / f"{stem_of(design)}-tuning.json" if log is None else log
    before = read_log(log) if log.exists() else None
    slicing = with_process_defaults(slicing)
    micrograph = read_image(image, options=options)
    measured = measure_lens(micrograph, intended, edge=options.edge, priors=options, seen_from=options.seen_from)
    name = f"{stem_of(design)}-tuned-{_next(before)}"
    tuned = tune_print(
        measured, sensor, slicing, options, before, file=f"{name}.toml", response=response, progress=progress
    )
    with files.output_folder(out):
        targets, contents = ({}, {}) if tuned.kept else _printed(tuned, sensor, slicing, out, name)
        targets = with_figure({**targets, "log": log}, figure.figure)
        files.write_all(contents | drawn(tuned, figure, "tune") | {log: log_text(tuned.log).encode()})
    return Outcome(tuned, targets)


def _next(log: TuningLog | None) -> int:
    return 1 if log is None else len(log.prints) + 1


def _printed(
    tuned: TunedPrint, sensor: Sensor, slicing: Slicing, out: Path, name: str
) -> tuple[dict[str, Path], dict[Path, files.Content]]:
    """Return the files for the next print, keyed by kind, and their contents: the drawing and its layers."""
    layers, path = _layers(tuned, sensor, slicing, out, name), out / f"{name}.toml"
    return {"drawn": path, **layers.targets}, layers.contents() | _drawing(tuned, sensor, path)


def _drawing(tuned: TunedPrint, sensor: Sensor, path: Path) -> dict[Path, files.Content]:
    """Return the files of a corrected drawing, with their contents: design, outline and predicted profile."""
    return dict(compensation_files(path, sensor, tuned.compensation, tuned.profile, tuned.process))


def _layers(tuned: TunedPrint, sensor: Sensor, slicing: Slicing, out: Path, name: str) -> LayerFiles:
    """Slice the part as drawn, and return the files of its layers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.toml"
        files.write_all(_drawing(tuned, sensor, path))
        design = open_design(path)
        part = printable_design(design, fabricate.sensor_part(design, Sensor.of(design).body().prism()), path, slicing)
    return layer_files(part, slicing, out, name, FigureOptions(), None)

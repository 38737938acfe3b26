"""Tuning of a lens, print by print: a picture and its design in; the drawing against it, its layers and the log out."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from solen import fabricate, files
from solen.arrays import Progress
from solen.explore import TunedPrint, TuneOptions, TuningLog, log_text, read_log, tune
from solen.fabricate.layers import Slicing, printable_design
from solen.fabricate.process import compensation_files
from solen.metrology import measure_lens, read_image
from solen.pipeline.design.designs import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.outputs import check_ending, drawn
from solen.pipeline.print.layers import LayerFiles, exposed_as_printed, layer_files, with_figure
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor


def tune_print(
    picture: Path,
    design: Path,
    out: Path,
    options: TuneOptions = TuneOptions(),
    slicing: Slicing = Slicing(),
    *,
    log: Path | None = None,
    assignments: Sequence[str] = (),
    response: bool = True,
    figure: FigureOptions = FigureOptions(),
    progress: Progress = lambda _: None,
) -> Outcome[TunedPrint]:
    """Measure a print and draw its lens so that the next print comes out nearer to the design.

    Parameters
    ----------
    picture
        Any file that `solen.metrology.read_image` takes.
    design
        The design file, as it is wanted.
    out
        Folder for the drawing, its layers, STL and settings.
    options
        How the picture is measured, and what is known of prints.
    slicing
        How the part is printed.
    log
        File of the log, read where it is there; None for one in the folder.
    assignments
        ``key=value`` of the design.
    response
        Whether the response before and after is traced.
    figure
        Draw the deviations before and after into this file.
    progress
        Called with the share done, up to 1.

    Raises
    ------
    SolenError
        Where the picture, the design or the log cannot be used, or the print is of another drawing; nothing is written
        then.
    """
    figure.check()
    check_ending(log, "a log", ".json")
    wanted = open_design(design, assignments)
    log = out / f"{stem_of(design)}-tuning.json" if log is None else log
    before = read_log(log) if log.exists() else None
    slicing, _ = exposed_as_printed(slicing)
    image = read_image(picture, options=options)
    measured = measure_lens(image, wanted, edge=options.edge, priors=options, seen_from=options.seen_from)
    sensor = Sensor.of(wanted)
    name = f"{stem_of(design)}-tuned-{_next(before)}"
    tuned = tune(measured, sensor, slicing, options, before, file=f"{name}.toml", response=response, progress=progress)
    with files.output_folder(out):
        layers = _layers(tuned, sensor, slicing, out, name)
        targets = {"drawn": out / f"{name}.toml", **layers.targets, "log": log}
        targets = with_figure(targets, figure.figure)
        contents = layers.contents() | _drawing(tuned, sensor, targets["drawn"]) | drawn(tuned, figure, "tune")
        files.write_all(contents | {log: log_text(tuned.log).encode()})
    return Outcome(tuned, targets)


def _next(log: TuningLog | None) -> int:
    return 1 if log is None else len(log.prints) + 1


def _drawing(tuned: TunedPrint, sensor: Sensor, path: Path) -> dict[Path, files.Content]:
    """Design, outline and predicted profile of the drawing."""
    return dict(compensation_files(path, sensor, tuned.made, tuned.profile, tuned.process))


def _layers(tuned: TunedPrint, sensor: Sensor, slicing: Slicing, out: Path, name: str) -> LayerFiles:
    """Files of the drawing's layers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.toml"
        files.write_all(_drawing(tuned, sensor, path))
        design = open_design(path)
        part = printable_design(design, fabricate.sensor_part(design, Sensor.of(design).body()), path, slicing)
    return layer_files(part, slicing, out, name, FigureOptions(), lambda _: None)

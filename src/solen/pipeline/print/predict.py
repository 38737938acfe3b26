"""Prediction of a print: a design and a process in; the printed lens, a drawing, a figure and a solid out."""

from collections.abc import Sequence
from pathlib import Path

from solen import files
from solen.arrays import Progress
from solen.fabricate import MESH_WRITERS
from solen.fabricate.process import PrintedDesign, PrintOptions, compensation_files, print_design
from solen.lens.profile import profile_text
from solen.pipeline.design.designs import open_design
from solen.pipeline.outputs import check_ending, check_outputs, drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor


def predict(
    path: Path,
    options: PrintOptions = PrintOptions(),
    assignments: Sequence[str] = (),
    *,
    response: bool = True,
    out: Path | None = None,
    compensate: Path | None = None,
    figure: FigureOptions = FigureOptions(),
    solid: Path | None = None,
    progress: Progress | None = None,
) -> Outcome[PrintedDesign]:
    """Predict the printed lens of a design.

    Parameters
    ----------
    path
        The design file.
    options
        The process and the orientation.
    assignments
        ``key=value`` of the design.
    response
        Whether the sensor's response is traced with both lenses.
    out, compensate, figure, solid
        Files of the printed lens's profile, of the drawing that prints as wanted, of a figure and of the whole part.
    progress
        Called with the share done, up to 1.

    Raises
    ------
    SolenError
        Where the design, the process or the files cannot be; nothing is written then.
    """
    check_outputs(out, figure)
    check_ending(compensate, "a design", ".toml")
    check_ending(solid, "a solid", *(f".{kind}" for kind in MESH_WRITERS))
    sensor = Sensor.of(open_design(path, assignments))
    prediction = print_design(
        sensor,
        options,
        response=response,
        compensate=compensate is not None,
        part=solid is not None,
        progress=progress,
    )
    contents = drawn(prediction, figure, "printed")
    if out is not None:
        contents[out] = profile_text(prediction.profile).encode()
    if compensate is not None:
        contents |= compensation_files(compensate, sensor, prediction)
    if solid is not None and prediction.part is not None:
        contents[solid] = MESH_WRITERS[solid.suffix.lower()[1:]](prediction.part.mesh, prediction.part.label)
    files.write_all(contents)
    return Outcome(prediction, named(figure=figure.figure, out=out, compensated=compensate, solid=solid))

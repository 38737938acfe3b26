"""Prediction of a print: a design and a process as input; printed lens, drawing, figure and solid as output."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.fabricate import MESH_WRITERS
from solen.fabricate.process import (
    PrintedDesign,
    PrintedLayers,
    PrintOptions,
    compensation_files,
    files_read,
    layer_files,
    print_design,
    print_layers,
    targets_of,
)
from solen.lens.profile import profile_text
from solen.pipeline.design.designs import open_design
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import check_different, check_ending, check_outputs, check_sources, drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor


def predict(
    file: Path,
    /,
    *,
    options: Annotated[PrintOptions, FLAT] = PrintOptions(),
    compensate: Path | None = None,
    solid: Path | None = None,
    response: Annotated[bool, Parameter(negative="--no-response")] = True,
    set_: Set = None,
    out: Annotated[
        Path | None, Parameter(name="--out", help="Write the profile of the printed lens to this .json.")
    ] = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[PrintedDesign | PrintedLayers]:
    """Predict the printed lens of a design: its deviation from the designed lens, and the response lost.

    Parameters
    ----------
    file
        The design file.
    compensate
        Write a compensated design to this .toml, whose outline, printed flat, becomes the designed lens; for a lens
        that varies with height, a design with compensated layers.
    solid
        Write the predicted solid of the part, printed flat, to this .stl, .3mf or .glb.
    response
        Trace the sensor with the designed and the printed lens.

    Raises
    ------
    SolenError
        If the design, the process or a file is invalid; then nothing is written.
    """
    check_outputs(out, figure)
    check_ending(compensate, "a design", ".toml")
    check_ending(solid, "a solid", *(f".{kind}" for kind in MESH_WRITERS))
    sensor = Sensor.of(open_design(file, set_))
    compensated = {} if compensate is None else targets_of(compensate, "drawn" if sensor.is_sampled else "outline")
    targets = named(figure=figure.figure, out=out, **compensated, solid=solid)
    check_different(targets.values())
    check_sources(targets.values(), [file, *sensor.design.files.values(), *files_read(options.process, options.cure)])
    prediction = (print_layers if sensor.is_sampled else print_design)(
        sensor,
        options,
        response=response,
        compensate=compensate is not None,
        part=solid is not None,
        progress=progress,
    )
    contents = drawn(prediction, figure, "printed")
    if isinstance(prediction, PrintedLayers):
        contents |= layer_files(prediction, out, compensate)
    else:
        if out is not None:
            contents[out] = profile_text(prediction.profile).encode()
        if compensate is not None:
            profile = prediction.compensated_profile
            contents |= compensation_files(compensate, sensor, prediction.compensation, profile, prediction.process)
        if solid is not None and prediction.part is not None:
            contents[solid] = MESH_WRITERS[solid.suffix.lower()[1:]](prediction.part.mesh, prediction.part.label)
    files.write_all(contents)
    return Outcome(prediction, targets)

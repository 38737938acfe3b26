"""Objective scale: an image of a stage micrometer as input, a scale file for other commands as output."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.metrology.image import read_plane
from solen.metrology.micrometer import MeasuredScale, MicrometerOptions, measured_scale
from solen.metrology.scale import scale_text
from solen.pipeline.options import FLAT, Force
from solen.pipeline.outputs import check_ending, check_new, named, toml_bytes
from solen.results import Outcome


def scale(
    image: Path,
    /,
    *,
    options: Annotated[MicrometerOptions, FLAT],
    out: Annotated[
        Path | None,
        Parameter(name="--out", help="Write the scale to this .toml, for --scale of other commands."),
    ] = None,
    force: Force = False,
) -> Outcome[MeasuredScale]:
    """Measure the scale of an objective from an image of a stage micrometer.

    Parameters
    ----------
    image
        An image of equidistant parallel lines: TIFF, PNG, JPEG, … (requires the extra vision).

    Raises
    ------
    SolenError
        If the image cannot be read or shows no equidistant lines; then nothing is written.
    """
    check_ending(out, "a scale", ".toml")
    check_new(out, force=force)
    plane, source = read_plane(image)
    measured = measured_scale(plane.grey, source, options)
    if out is not None:
        files.write_bytes(out, toml_bytes(scale_text(measured.file), "print scale"))
    return Outcome(measured, named(out=out))

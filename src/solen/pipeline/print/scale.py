"""Scale of an objective: a picture of a stage micrometer in, a file that other commands take out."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import __version__, files
from solen.metrology.image import read_plane
from solen.metrology.micrometer import MeasuredScale, MicrometerOptions, measured_scale
from solen.metrology.scale import scale_text
from solen.pipeline.options import FLAT, Force
from solen.pipeline.outputs import check_ending, check_new, named
from solen.results import Outcome


def scale(
    picture: Path,
    /,
    *,
    options: Annotated[MicrometerOptions, FLAT],
    out: Annotated[
        Path | None,
        Parameter(name="--out", help="Write the scale to this .toml, which --scale of other commands takes."),
    ] = None,
    force: Force = False,
) -> Outcome[MeasuredScale]:
    """Measure the scale of an objective once, in a picture of a stage micrometer.

    Parameters
    ----------
    picture
        A picture of even parallel lines: TIFF, PNG, JPEG and others (needs the extra vision).

    Raises
    ------
    SolenError
        Where the picture cannot be read or shows no even lines; nothing is written then.
    """
    check_ending(out, "a scale", ".toml")
    check_new(out, force=force)
    plane, source = read_plane(picture)
    measured = measured_scale(plane.grey, source, options)
    if out is not None:
        comment = f"# Written by solen {__version__} print scale.\n"
        files.write_all({out: (comment + scale_text(measured.file)).encode()})
    return Outcome(measured, named(out=out))

"""Scale of an objective: a picture of a stage micrometer in, a file that other commands take out."""

from pathlib import Path

from solen import __version__, files
from solen.metrology.image import read_plane
from solen.metrology.micrometer import MeasuredScale, MicrometerOptions, measured_scale
from solen.metrology.scale import scale_text
from solen.pipeline.outputs import check_ending, named
from solen.results import Outcome


def scale(picture: Path, options: MicrometerOptions, out: Path | None = None) -> Outcome[MeasuredScale]:
    """Side of a pixel with its uncertainty, from even lines of a known distance.

    Parameters
    ----------
    picture
        Any file that `solen.metrology.read_image` takes; it need state no scale.
    options
        The lines' distance.
    out
        Write the scale here.

    Raises
    ------
    SolenError
        Where the picture cannot be read or shows no even lines; nothing is written then.
    """
    check_ending(out, "a scale", ".toml")
    plane, source = read_plane(picture)
    measured = measured_scale(plane.grey, source, options)
    if out is not None:
        comment = f"# Written by solen {__version__} print scale.\n"
        files.write_all({out: (comment + scale_text(measured.file)).encode()})
    return Outcome(measured, named(out=out))

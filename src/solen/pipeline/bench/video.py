"""A motion log from a video of a marker."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.bench.video import VideoMotion, VideoOptions, motion_of
from solen.pipeline.options import FLAT, Force
from solen.pipeline.outputs import check_table, named
from solen.results import Outcome

Log = Annotated[Path | None, Parameter(name="--out", help="Write the angle over time to this .csv, a motion log.")]


def video(
    file: Path, /, *, options: Annotated[VideoOptions, FLAT] = VideoOptions(), out: Log = None, force: Force = False
) -> Outcome[VideoMotion]:
    """Measure the angle of an ArUco or AprilTag marker in a video, as a motion log for solen bench analyse.

    Parameters
    ----------
    file
        A video that OpenCV can read, recorded with a fixed camera.

    Raises
    ------
    DataError, SpecError, OutputError
        If the file, an option or an output is invalid.
    """
    check_table(out, "a motion log", file, force=force)
    motion = motion_of(file, options)
    if out is not None:
        files.write_all({out: motion.csv.encode("utf-8")})
    return Outcome(motion, named(out=out))

"""Archives of a sensor: pack files into an archive to share it, and check and unpack a received archive."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from solen.archive import Archive, Limits, Opened, PackOptions, opened
from solen.archive import pack as packed
from solen.pipeline.options import FLAT, ProgressBar
from solen.results import Outcome


def pack(
    file: Path,
    further: Sequence[Path] = (),
    *,
    out: Path,
    options: Annotated[PackOptions, FLAT],
    progress: ProgressBar = None,
) -> Outcome[Archive]:
    """Pack a design and everything that belongs to its sensor into an archive with a description.

    Parameters
    ----------
    file
        The design file; files that it names are included.
    further
        Files and folders: print settings, images, recordings, calibrations, figures.
    out
        The archive: a zip file if the name ends in .zip, otherwise a new folder.
    """
    archive = packed(file, further, options, exclude=out, progress=progress)
    return Outcome(archive, {"out": archive.save(out)})


def unpack(file: Path, *, out: Path, limits: Annotated[Limits, FLAT] = Limits()) -> Outcome[Opened]:
    """Check a received archive and unpack it into a new folder.

    Parameters
    ----------
    file
        The archive: a zip file or folder.
    out
        New folder.
    """
    archive = opened(file, limits)
    return Outcome(archive, {"out": archive.save(out)})

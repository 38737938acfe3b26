"""Light of grey pixels: a table of discs in, a process file out."""

from pathlib import Path

from solen import __version__, files
from solen.fabricate.process import (
    GreyOptions,
    MeasuredGreys,
    default_process,
    measured_greys,
    process_text,
    read_process,
)
from solen.pipeline.outputs import check_ending, named
from solen.recording import read
from solen.results import Outcome


def grey(
    file: Path,
    options: GreyOptions = GreyOptions(),
    *,
    process: Path | None = None,
    sheet: str | None = None,
    out: Path | None = None,
) -> Outcome[MeasuredGreys]:
    """Which light grey pixels let through, from the thicknesses of discs of several greys.

    Parameters
    ----------
    file
        A table with columns of greys and thicknesses.
    options
        Which rows, and their uncertainty.
    process
        The process that the greys are added to; its Dp is used. None for the default.
    sheet
        Of a workbook.
    out
        Write the process with the greys here.

    Raises
    ------
    SolenError
        Where a file cannot be read, or no curve follows; nothing is written then.
    """
    check_ending(out, "a process", ".toml")
    before = default_process() if process is None else read_process(process)
    found = measured_greys(read(file, sheet=sheet), before, options)
    if out is not None:
        comment = f"# Written by solen {__version__} print grey.\n"
        files.write_all({out: (comment + process_text(found.process)).encode()})
    return Outcome(found, named(out=out))

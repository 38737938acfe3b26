"""Light of grey pixels: a table of discs as input, a process file as output."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.fabricate.process import (
    GreyOptions,
    MeasuredGreys,
    default_process,
    measured_greys,
    process_text,
    read_process,
)
from solen.pipeline.options import FLAT, Force
from solen.pipeline.outputs import check_ending, check_new, named, toml_bytes
from solen.recording import read
from solen.results import Outcome


def grey(
    file: Path,
    /,
    *,
    options: Annotated[GreyOptions, FLAT] = GreyOptions(),
    process: Path | None = None,
    sheet: str | None = None,
    out: Annotated[
        Path | None, Parameter(name="--out", help="Write the process with the grey response to this .toml.")
    ] = None,
    force: Force = False,
) -> Outcome[MeasuredGreys]:
    """Measure the light of grey pixels with discs of the grey-steps coupon.

    Parameters
    ----------
    file
        A table of grey levels (fractions, % or 0 to 255) and thicknesses of discs cured in the same exposure.
    process
        The process to which the grey response is added, and whose Dp converts thickness to light; default: the
        published settings.
    sheet
        Sheet of a workbook.

    Raises
    ------
    SolenError
        If a file cannot be read, or the discs do not determine the response; then nothing is written.
    """
    check_ending(out, "a process", ".toml")
    check_new(out, force=force)
    prior = default_process() if process is None else read_process(process)
    result = measured_greys(read(file, sheet=sheet), prior, options)
    if out is not None:
        files.write_bytes(out, toml_bytes(process_text(result.process), "print grey"))
    return Outcome(result, named(out=out))

"""Subtraction of ambient light from a recording: any table as input; a table of readings and a figure as output."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.analysis.demodulation import Demodulation, DemodulationOptions, demodulated, readings_csv
from solen.pipeline.options import FLAT, Force, Sheet
from solen.pipeline.outputs import check_table, drawn, named
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome

Table = Annotated[Path | None, Parameter(name="--out", help="Write the readings to this .csv.")]


def demodulate(
    file: Path,
    /,
    *,
    options: Annotated[DemodulationOptions, FLAT] = DemodulationOptions(),
    sheet: Sheet = None,
    out: Table = None,
    force: Force = False,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[Demodulation]:
    """Subtract ambient light from a recording of switched emitters: on minus off, with its uncertainty.

    Parameters
    ----------
    file
        A table with a time and a column for each receiver.

    Raises
    ------
    DataError, SpecError, OutputError
        If the file, an option or an output is invalid.
    """
    figure.check()
    check_table(out, "a table of readings", file, force=force)
    recording = read(file, sheet=sheet)
    result = demodulated(recording, options)
    contents = drawn(result, figure, "demodulation")
    if out is not None:
        contents[out] = readings_csv(result, recording).encode("utf-8")
    files.write_all(contents)
    return Outcome(result, named(figure=figure.figure, out=out))

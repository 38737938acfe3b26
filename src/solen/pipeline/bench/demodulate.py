"""Ambient light out of a recording: from any table to a table of readings, with what was missing and what is left."""

from pathlib import Path

from solen import files
from solen.analysis.demodulation import Demodulation, DemodulationOptions, demodulated, readings_csv
from solen.pipeline.outputs import check_table, drawn, named
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def demodulate(
    file: Path,
    options: DemodulationOptions | None = None,
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[Demodulation]:
    """Readings of a recording without its ambient light; ``out`` is a .csv table of them.

    Raises
    ------
    DataError, SpecError, OutputError
        In one line, where the file, an option or an output is not what it should be.
    """
    figure.check()
    check_table(out, "readings")
    recording = read(file, sheet=sheet)
    result = demodulated(recording, options)
    contents = drawn(result, figure, "demodulation")
    if out is not None:
        contents[out] = readings_csv(result, recording).encode("utf-8")
    files.write_all(contents)
    return Outcome(result, named(figure=figure.figure, out=out))

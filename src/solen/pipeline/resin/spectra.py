"""Spectra in files: a list and a figure of their contents."""

from pathlib import Path
from typing import Annotated

from solen.material.rows import RowOptions, chosen_rows, refuse_unused
from solen.pipeline.options import FLAT, Sheet
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.recording.spectrum import Listing, listing
from solen.report.options import FigureOptions
from solen.results import Outcome


def spectra(
    files: list[Path],
    /,
    *,
    rows: Annotated[RowOptions, FLAT] = RowOptions(),
    sheet: Sheet = None,
    trace: tuple[str, ...] = (),
    repeats: bool = False,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[Listing]:
    """List the spectra in files: traces, quantities, units, wavelengths, and warnings.

    Parameters
    ----------
    files
        A Cary export, a table with a column of wavelengths, or a workbook of either; several are drawn in one figure.
    trace
        Name of a trace; repeatable; default: all.
    repeats
        Draw the mean and standard deviation of traces whose names differ only in their last number.
    """
    check_outputs(None, figure)
    recordings = [chosen_rows(read(path, sheet=sheet), rows) for path in files]
    for recording in recordings:
        refuse_unused(recording, rows, (), labels_only=True)
    return write(listing(recordings, trace, repeats=repeats), "spectra", figure=figure)

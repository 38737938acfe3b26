"""The command that lists the spectra in a file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from solen.cli.app import FLAT, Sheet, lines
from solen.material.rows import RowOptions
from solen.recording.spectrum import Listing
from solen.report.options import FigureOptions
from solen.results import Outcome


def spectra(
    file: Path,
    /,
    *,
    rows: Annotated[RowOptions, FLAT] = RowOptions(),
    sheet: Sheet = None,
    trace: tuple[str, ...] = (),
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[Listing]:
    """List the spectra in a file: traces, quantities, units, wavelengths, and what to beware of.

    Parameters
    ----------
    file
        A Cary export, a table with a column of wavelengths, or a workbook of either.
    trace
        Name of a trace; repeatable; default: all.
    """
    from solen.pipeline.resin import spectra as pipeline

    return pipeline.spectra(file, rows, sheet=sheet, trace=trace, figure=figure)


@lines.register
def _(listing: Listing) -> Iterator[str]:
    source = listing.sources[0]
    origin = ", ".join(filter(None, (source.instrument, source.date, f"sha256 {source.sha256[:12]}")))
    yield f"{listing.file} ({listing.format}): {len(listing.traces)} traces; {origin}"
    width = max(len(trace.name) for trace in listing.traces)
    for trace in listing.traces:
        unit = {"1": "", None: " without a unit"}.get(trace.unit, f" in {trace.unit}")
        reach = "no wavelengths" if trace.range_nm is None else "{:g} to {:g} nm".format(*trace.range_nm)
        what = f"{trace.quantity or 'unknown quantity'}{unit}"
        yield f"  {trace.name:{width}}  {trace.points:5} points  {reach}  {what}"

"""The command that lists the spectra in a file."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from solen.cli.app import FLAT, Sheet, lines
from solen.material.rows import RowOptions
from solen.recording.spectrum import Listing, Trace
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
    """List the spectra in files: traces, quantities, units, wavelengths, and what to beware of.

    Parameters
    ----------
    files
        A Cary export, a table with a column of wavelengths, or a workbook of either; several are drawn into one figure.
    trace
        Name of a trace; repeatable; default: all.
    repeats
        Draw traces whose names differ in their last number alone as one, its mean and standard deviation.
    """
    from solen.pipeline.resin import spectra as pipeline

    return pipeline.spectra(files, rows, sheet=sheet, trace=trace, repeats=repeats, figure=figure)


@lines.register
def _(listing: Listing) -> Iterator[str]:
    for source in listing.sources:
        origin = ", ".join(filter(None, (source.instrument, source.date, f"sha256 {source.sha256[:12]}")))
        traces = [trace for trace in listing.traces if trace.file == source.file]
        yield f"{source.file} ({source.format}): {len(traces)} traces; {origin}"
        yield from _lines(traces)


def _lines(traces: Sequence[Trace]) -> Iterator[str]:
    width = max((len(trace.name) for trace in traces), default=0)
    for trace in traces:
        unit = {"1": "", None: " without a unit"}.get(trace.unit, f" in {trace.unit}")
        reach = "no wavelengths" if trace.range_nm is None else "{:g} to {:g} nm".format(*trace.range_nm)
        what = f"{trace.quantity or 'unknown quantity'}{unit}"
        yield f"  {trace.name:{width}}  {trace.points:5} points  {reach}  {what}"

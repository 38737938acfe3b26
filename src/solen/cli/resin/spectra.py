"""The command that lists the spectra in a file."""

from collections.abc import Iterator, Sequence

from solen.cli.app import lines
from solen.pipeline.resin.spectra import spectra as spectra
from solen.recording.spectrum import Listing, Trace


@lines.register
def _(listing: Listing) -> Iterator[str]:
    for source in listing.sources:
        origin = ", ".join(filter(None, (source.instrument, source.date, f"sha256 {source.sha256[:12]}")))
        traces = [trace for trace in listing.traces if trace.file == source.file]
        yield f"{source.file} ({source.format}): {len(traces)} traces; {origin}"
        yield from _trace_lines(traces)


def _trace_lines(traces: Sequence[Trace]) -> Iterator[str]:
    width = max((len(trace.name) for trace in traces), default=0)
    for trace in traces:
        unit = {"1": "", None: " without a unit"}.get(trace.unit, f" in {trace.unit}")
        wavelengths = "no wavelengths" if trace.range_nm is None else "{:g} to {:g} nm".format(*trace.range_nm)
        quantity = f"{trace.quantity or 'unknown quantity'}{unit}"
        yield f"  {trace.name:{width}}  {trace.points:5} points  {wavelengths}  {quantity}"

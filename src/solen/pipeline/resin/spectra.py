"""The spectra in a file: the file in, what it holds and its figure out."""

from pathlib import Path

from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.recording.spectrum import Listing, listing
from solen.report.plot import plot
from solen.results import Outcome


def spectra(
    file: Path, *, sheet: str | None = None, trace: tuple[str, ...] = (), figure: Path | None = None
) -> Outcome[Listing]:
    """Traces of a file, all or those of some names, with what each is and how far it reaches."""
    check_outputs(None, figure)
    result = listing(read(file, sheet=sheet), trace)
    return write(result, "spectra", None, {"figure": (figure, lambda: plot(result))})

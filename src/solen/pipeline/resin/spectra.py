"""The spectra in a file: the file in, what it holds and its figure out."""

from pathlib import Path

from solen.material.rows import RowOptions, chosen_rows, refuse_unused
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.recording.spectrum import Listing, listing
from solen.report.options import FigureOptions
from solen.results import Outcome


def spectra(
    file: Path,
    rows: RowOptions = RowOptions(),
    *,
    sheet: str | None = None,
    trace: tuple[str, ...] = (),
    figure: FigureOptions = FigureOptions(),
) -> Outcome[Listing]:
    """Traces of a file, all or by name, with what each is and how far it reaches."""
    check_outputs(None, figure)
    recording = chosen_rows(read(file, sheet=sheet), rows)
    refuse_unused(recording, rows, (), labels_only=True)
    return write(listing(recording, trace), "spectra", figure=figure)

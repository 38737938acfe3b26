"""The spectra in files: the files in, what they hold and its figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen.material.rows import RowOptions, chosen_rows, refuse_unused
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.recording.spectrum import Listing, listing
from solen.report.options import FigureOptions
from solen.results import Outcome


def spectra(
    paths: Sequence[Path],
    rows: RowOptions = RowOptions(),
    *,
    sheet: str | None = None,
    trace: tuple[str, ...] = (),
    repeats: bool = False,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[Listing]:
    """Traces of files, all or by name, with what each is and how far it reaches."""
    check_outputs(None, figure)
    recordings = [chosen_rows(read(path, sheet=sheet), rows) for path in paths]
    for recording in recordings:
        refuse_unused(recording, rows, (), labels_only=True)
    return write(listing(recordings, trace, repeats=repeats), "spectra", figure=figure)

"""Index of a layer: a file of its spectra in, the result and its figure out."""

from pathlib import Path

from solen.material.index.layer import LayerIndex, index_of_layer
from solen.material.index.options import IndexOptions
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def index(
    file: Path,
    options: IndexOptions = IndexOptions(),
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[LayerIndex]:
    """Index against wavelength from any file of spectra that `solen.recording.read` takes."""
    check_outputs(out, figure)
    result = index_of_layer(read(file, sheet=sheet), options)
    return write(result, "index", out, figure=figure)

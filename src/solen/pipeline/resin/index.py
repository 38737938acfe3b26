"""Index of a layer: a file of its spectra as input, the result and its figure as output."""

from pathlib import Path
from typing import Annotated

from solen.material.index.layer import LayerIndex, index_of_layer
from solen.material.index.options import IndexOptions
from solen.pipeline.options import FLAT, Out, Sheet
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def index(
    file: Path,
    /,
    *,
    options: Annotated[IndexOptions, FLAT] = IndexOptions(),
    sheet: Sheet = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[LayerIndex]:
    """Compute the index of a printed layer from its spectra, with its uncertainty.

    Parameters
    ----------
    file
        Export of the spectrophotometer, or a table with columns wavelength_nm, T and R (fractions, or % in the
        header).
    """
    check_outputs(out, figure)
    result = index_of_layer(read(file, sheet=sheet), options)
    return write(result, "index", out, figure=figure)

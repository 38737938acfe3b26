"""Penetration depth of a resin: an absorbance file as input, the result and its figure as output."""

from pathlib import Path
from typing import Annotated

from solen.material.cure.penetration import Penetration, PenetrationOptions, penetration_of
from solen.pipeline.options import FLAT, Out, Sheet
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def penetration(
    file: Path,
    /,
    *,
    options: Annotated[PenetrationOptions, FLAT],
    sheet: Sheet = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[Penetration]:
    """Compute the penetration depth of a resin from its absorbance, for the spectrum of the printer's lamp.

    Parameters
    ----------
    file
        A spectrum of the liquid resin: absorbance, base 10, or transmittance.
    """
    check_outputs(out, figure)
    result = penetration_of(read(file, sheet=sheet), options)
    return write(result, "penetration", out, figure=figure)

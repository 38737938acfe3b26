"""A resin's working curve: a table of discs as input, the result and its figure as output."""

from pathlib import Path
from typing import Annotated

from solen.material.cure import CureOptions, MeasuredCurve
from solen.material.cure.discs import curves_of_discs, with_spectral_law
from solen.material.resin_from_results import spectral_fit
from solen.pipeline.options import FLAT, Out, Sheet
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def cure(
    files: list[Path],
    /,
    *,
    options: Annotated[CureOptions, FLAT] = CureOptions(),
    penetration: Path | None = None,
    sheet: Sheet = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[MeasuredCurve]:
    """Fit the working curve of a resin, Dc = Dp ln(E/Ec), and apply it to a print in layers.

    Parameters
    ----------
    files
        A table with a row for each cured disc: thickness, and dose or time. Further tables, for example of other
        resins, are fitted separately and drawn in the same figure.
    penetration
        Result of solen resin penetration (.json) for the printer's lamp: the cure law for the spectrum of the lamp is
        compared with Jacobs' law.
    """
    check_outputs(out, figure)
    result = curves_of_discs([read(path, sheet=sheet) for path in files], options)
    if penetration is not None:
        result = with_spectral_law(result, spectral_fit(penetration, result))
    return write(result, "cure", out, figure=figure)

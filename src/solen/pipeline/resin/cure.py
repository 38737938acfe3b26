"""The working curve of a resin: a table of discs in, the result and its figure out."""

from pathlib import Path

from solen.material.cure import CureOptions, MeasuredCurve, curve_of_discs
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def cure(
    file: Path,
    options: CureOptions = CureOptions(),
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[MeasuredCurve]:
    """Penetration depth and critical dose with their intervals; with a layer, what they mean for it."""
    check_outputs(out, figure)
    return write(curve_of_discs(read(file, sheet=sheet), options), "cure", out, figure=figure)

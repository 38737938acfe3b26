"""The working curve of a resin: a table of discs in, the result and its figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen.material.cure import CureOptions, MeasuredCurve
from solen.material.cure.discs import curves_of_discs
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def cure(
    paths: Sequence[Path],
    options: CureOptions = CureOptions(),
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[MeasuredCurve]:
    """Penetration depth and critical dose with intervals; what they mean for a layer; further tables beside."""
    check_outputs(out, figure)
    result = curves_of_discs([read(path, sheet=sheet) for path in paths], options)
    return write(result, "cure", out, figure=figure)

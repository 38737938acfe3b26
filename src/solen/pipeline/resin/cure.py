"""The working curve of a resin: a table of discs in, the result and its figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen.material.cure import CureOptions, MeasuredCurve
from solen.material.cure.discs import curves_of_discs, with_lamp
from solen.material.resin_from_results import lamp_fit
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def cure(
    paths: Sequence[Path],
    options: CureOptions = CureOptions(),
    *,
    penetration: Path | None = None,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[MeasuredCurve]:
    """Penetration depth and critical dose with intervals; what they mean for a layer; further tables beside."""
    check_outputs(out, figure)
    result = curves_of_discs([read(path, sheet=sheet) for path in paths], options)
    if penetration is not None:
        result = with_lamp(result, lamp_fit(penetration, result))
    return write(result, "cure", out, figure=figure)

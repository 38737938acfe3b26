"""Penetration depth of a resin: a file of its absorbance in, the result and its figure out."""

from pathlib import Path

from solen.material.cure.penetration import Penetration, PenetrationOptions, penetration_of
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def penetration(
    file: Path,
    options: PenetrationOptions,
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[Penetration]:
    """Penetration depth against wavelength, and in a lamp's light."""
    check_outputs(out, figure)
    result = penetration_of(read(file, sheet=sheet), options)
    return write(result, "penetration", out, figure=figure)

"""Loss of a guide: a file of received powers in, the result and its figure out."""

from pathlib import Path

from solen.material.loss import CutbackOptions, GuideLoss, guide_loss
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def cutback(
    file: Path,
    options: CutbackOptions = CutbackOptions(),
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[GuideLoss]:
    """Loss in dB/cm from any file that `solen.recording.read` takes, with a column of lengths and one of powers."""
    check_outputs(out, figure)
    return write(guide_loss(read(file, sheet=sheet), options), "cutback", out, figure=figure)

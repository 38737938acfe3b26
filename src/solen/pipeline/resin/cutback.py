"""Loss of a guide: a file of received powers as input, the result and its figure as output."""

from pathlib import Path
from typing import Annotated

from solen.material.loss import CutbackOptions, GuideLoss, guide_loss
from solen.pipeline.options import FLAT, Out, Sheet
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def cutback(
    file: Path,
    /,
    *,
    options: Annotated[CutbackOptions, FLAT] = CutbackOptions(),
    sheet: Sheet = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[GuideLoss]:
    """Compute the loss of a guide in dB/cm from the power that guides of several lengths transmit.

    Parameters
    ----------
    file
        A table with a row for each reading: length, power, and preferably also guide and orientation.
    """
    check_outputs(out, figure)
    return write(guide_loss(read(file, sheet=sheet), options), "cutback", out, figure=figure)

"""The command that computes the loss of a guide."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from solen.cli.app import FLAT, Out, Sheet, lines
from solen.material.loss import CutbackOptions, GuideLoss
from solen.material.loss.cutback import LAYER_UM, U_T
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
        A table with a row for each reading: length, power, and best also guide and orientation.
    """
    from solen.pipeline.resin import cutback as pipeline

    return pipeline.cutback(file, options, sheet=sheet, out=out, figure=figure)


@lines.register
def _(loss: GuideLoss) -> Iterator[str]:
    low, high = loss.interval95_loss_dB_per_cm
    shortest, longest = loss.lengths_mm
    yield (
        f"loss {loss.loss_dB_per_cm:.3g} dB/cm ({low:.3g} to {high:.3g}, 95 %), from {loss.readings} readings "
        f"of {loss.guides} guides, {shortest:g} to {longest:g} mm long"
    )
    if loss.absorption_per_mm is None:
        yield "absorption per mm: none, as the loss is not positive"
    else:
        yield f"absorption {loss.absorption_per_mm:.3g} ± {loss.u_absorption_per_mm:.2g} per mm of guide, base e"
    if loss.interval95_coupling_loss_dB is not None:
        low, high = loss.interval95_coupling_loss_dB
        yield f"coupling and ends {loss.coupling_loss_dB:.3g} dB ({low:.3g} to {high:.3g})"
    for line in loss.by_orientation:
        low, high = line.interval95_loss_dB_per_cm
        yield f"  {line.orientation}: {line.loss_dB_per_cm:.3g} dB/cm ({low:.3g} to {high:.3g})"
    yield (
        f"one layer of {LAYER_UM:g} µm cannot show this: {100.0 * U_T:g} % in its transmittance "
        f"is {loss.layer_limit_dB_per_cm:.1f} dB/cm"
    )

"""The command that computes the loss of a guide."""

from collections.abc import Iterator

from solen.cli.app import lines, simulated
from solen.material.loss import GuideLoss
from solen.material.loss.cutback import LAYER_UM, U_T
from solen.pipeline.resin.cutback import cutback as cutback


@lines.register
def _(loss: GuideLoss) -> Iterator[str]:
    low, high = loss.interval95_loss_dB_per_cm
    shortest, longest = loss.lengths_mm
    yield (
        f"{simulated(loss)}loss {loss.loss_dB_per_cm:.3g} dB/cm ({low:.3g} to {high:.3g}, 95 %), from "
        f"{loss.readings} readings of {loss.guides} guides, {shortest:g} to {longest:g} mm long"
    )
    if loss.absorption_per_mm is None:
        yield "absorption coefficient: undefined, because the loss is not positive"
    else:
        yield (
            f"absorption coefficient {loss.absorption_per_mm:.3g} ± {loss.u_absorption_per_mm:.2g} "
            "per mm of guide, base e"
        )
    if loss.interval95_coupling_loss_dB is not None:
        low, high = loss.interval95_coupling_loss_dB
        yield f"loss of the coupling and the ends {loss.coupling_loss_dB:.3g} dB ({low:.3g} to {high:.3g})"
    for line in loss.by_orientation:
        low, high = line.interval95_loss_dB_per_cm
        yield f"  {line.orientation}: {line.loss_dB_per_cm:.3g} dB/cm ({low:.3g} to {high:.3g})"
    yield (
        f"for comparison: an error of {100.0 * U_T:g} % in the transmittance of one layer of {LAYER_UM:g} µm "
        f"corresponds to {loss.layer_limit_dB_per_cm:.1f} dB/cm"
    )

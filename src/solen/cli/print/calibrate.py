"""The command that calibrates a printer with measured coupons."""

from collections.abc import Iterator

from solen.cli.app import lines, simulated
from solen.fabricate.process import PrinterCalibration
from solen.pipeline.print.calibrate import calibrate as calibrate


@lines.register
def _(fit: PrinterCalibration) -> Iterator[str]:
    yield f"{simulated(fit)}{fit.name}"
    for number in fit.numbers:
        yield f"  {number.key} {number.value:.4g} ± {number.u:.2g} (before: ± {number.u_before:.2g})"
    for scale in fit.scales:
        error, u = 100.0 * (scale.factor - 1.0), 100.0 * scale.u_factor
        prior = f"{'specified' if scale.stated else 'assumed'}: ± {100.0 * scale.u_before:.2g} %"
        yield f"  {scale.axis} scale of {scale.file} deviates by {error:+.2f} ± {u:.2g} % ({prior})"
    yield f"  effective Ec {fit.Ec_mJ_per_cm2:.3g} ± {fit.u_Ec_mJ_per_cm2:.2g} mJ/cm²"
    yield (
        f"{len(fit.features)} of {fit.given} features used, residual {fit.rms_um:.2g} µm RMS; uncertainties "
        f"multiplied by {fit.scale:.2g}"
    )

"""The command that calibrates a printer by measured coupons."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.cli.app import FLAT, lines
from solen.fabricate.process import PrinterCalibration
from solen.report.options import FigureOptions
from solen.results import Outcome


def calibrate(
    files: list[Path],
    /,
    *,
    process: Path | None = None,
    out: Annotated[Path | None, Parameter(name="--out", help="Write the process to this .toml.")] = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[PrinterCalibration]:
    """Find a printer's blur, edge growth and shrinkage from measured coupons, for solen print predict.

    Parameters
    ----------
    files
        Files of measured features (JSON), as solen print fidelity --out writes them of a coupon.
    process
        Process that the coupons were printed with, as far as it is known; default: the published settings.
    """
    from solen.pipeline.print import calibrate as pipeline

    return pipeline.calibrate_printer(files, process, out, figure)


@lines.register
def _(fit: PrinterCalibration) -> Iterator[str]:
    yield f"{'simulated: ' if fit.simulated else ''}{fit.name}"
    for number in fit.numbers:
        yield f"  {number.key} {number.value:.4g} ± {number.u:.2g} (before: ± {number.u_before:.2g})"
    for scale in fit.scales:
        off, u = 100.0 * (scale.factor - 1.0), 100.0 * scale.u_factor
        before = f"{'stated' if scale.stated else 'assumed'}: ± {100.0 * scale.u_before:.2g} %"
        yield f"  {scale.axis} scale of {scale.file} off by {off:+.2f} ± {u:.2g} % ({before})"
    yield f"  effective Ec {fit.Ec_mJ_per_cm2:.3g} ± {fit.u_Ec_mJ_per_cm2:.2g} mJ/cm²"
    yield (
        f"{len(fit.features)} of {fit.given} features used, off by {fit.rms_um:.2g} µm rms; uncertainties widened "
        f"{fit.scale:.2g} times"
    )

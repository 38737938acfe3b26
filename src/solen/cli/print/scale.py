"""The command that measures the scale of an objective."""

from collections.abc import Iterator

from solen.cli.app import lines, simulated
from solen.metrology.micrometer import MeasuredScale
from solen.pipeline.print.scale import scale as scale


@lines.register
def _(measured: MeasuredScale) -> Iterator[str]:
    name = simulated(measured) + (f"{measured.objective}: " if measured.objective else "")
    u_percent = 100.0 * measured.u_um_per_px / measured.um_per_px
    yield f"{name}{measured.um_per_px:.6g} ± {measured.u_um_per_px:.2g} µm per pixel ({u_percent:.2g} %)"
    yield (
        f"{measured.lines} lines {measured.spacing_mm:g} mm apart, {measured.period_px:.6g} ± "
        f"{measured.u_period_px:.2g} pixels in the image; the direction across them is {measured.angle_deg:.3g} deg "
        f"from the rows; RMS residual {measured.rms_um:.2g} µm"
    )
    if measured.stretch_percent is not None:
        yield f"the scale changes by {measured.stretch_percent:+.2g} % across the image"

"""The command that measures a printed coupon."""

from collections.abc import Iterator

from solen.cli.app import lines, short, simulated
from solen.metrology.coupons import CouponMeasurement, Limit
from solen.pipeline.print.fidelity import fidelity as fidelity

MINIMA = {
    "positive_diameter": "smallest standing pillar",
    "gap": "smallest gap that is open",
    "hole": "smallest hole that is open",
    "hole_variation": "smallest difference between holes",
    "z_step": "smallest height step",
}


@lines.register
def _(measured: CouponMeasurement) -> Iterator[str]:
    article, scale = "an" if measured.image == "image" else "a", f"{measured.scale.um_per_px:.4g} µm per pixel"
    yield f"{simulated(measured)}{measured.coupon} in {article} {measured.image} of {scale}{_seen(measured)}"
    for limit in measured.limits:
        yield _minimum(limit)
    yield f"  {'':24} nominal    measured   u (mm)"
    for feature in (*measured.features, *measured.undecided):
        size = "   -    " if feature.measured_mm is None else f"{feature.measured_mm:.5f}"
        u = "-" if feature.u_measured_mm is None else short(feature.u_measured_mm)
        yield f"  {feature.name:24} {feature.nominal_mm:<8.4g}   {size}   {u}" + (
            "" if feature.resolved else f"  {feature.reason}"
        )


def _seen(measured: CouponMeasurement) -> str:
    """Return the addition to the first line if the marks show that the coupon is mirrored."""
    if not measured.location.oriented:
        return ""
    return ", seen mirrored: from below, or in a flipped image" if measured.location.pose.mirrored else ""


def _minimum(limit: Limit) -> str:
    """Return a line with the smallest resolved size, its measurement, and the next smaller size."""
    if limit.nominal_mm is None:
        return f"{MINIMA[limit.kind]}: none; not resolved even at {limit.next_mm:g} mm"
    line = f"{MINIMA[limit.kind]}: {'at most ' if limit.bound else ''}{limit.nominal_mm:g} mm"
    if limit.measured_mm is not None:
        line += f", printed {limit.measured_mm:.4f} ± {short(limit.u_measured_mm)} mm"
    return line + (f"; {limit.next_mm:g} mm is not resolved" if limit.next_mm is not None else "")

"""The command that measures a printed coupon."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.cli.app import FLAT, lines, short
from solen.metrology.coupons import CouponMeasurement, Limit
from solen.metrology.zmap import ZMapOptions
from solen.report.options import FigureOptions
from solen.results import Outcome

Choose = Annotated[
    list[str] | None,
    Parameter(name="--set", negative=(), help="A parameter and its value, as in --set spacing_mm=2; repeatable."),
]
MINIMA = {
    "positive_diameter": "smallest pillar that stands",
    "gap": "smallest gap that is open",
    "hole": "smallest hole that is open",
    "hole_variation": "smallest variation of holes",
    "z_step": "smallest step of height",
}


def fidelity(
    file: Path,
    /,
    *,
    coupon: str | None = None,
    job: Path | None = None,
    options: Annotated[ZMapOptions, FLAT] = ZMapOptions(),
    set_: Choose = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Annotated[
        Path | None, Parameter(help="Write the result, with nominal and measured sizes, to this .json.")
    ] = None,
) -> Outcome[CouponMeasurement]:
    """Measure a printed coupon in a picture or a z map, and the smallest features that are resolved.

    Parameters
    ----------
    file
        A picture (TIFF, PNG and others), or with --z-um a z map (TIFF of 16 bits or with points, or a table of text).
    coupon
        Which coupon it shows: group-a, group-b, group-c, holes or z-reference; default: that of the job.
    job
        The job file that solen print coupons wrote beside the coupon, with the coupon's parameters.
    """
    from solen.pipeline.print import fidelity as pipeline

    return pipeline.fidelity(file, coupon, options, job=job, assignments=set_ or (), figure=figure, out=out)


@lines.register
def _(measured: CouponMeasurement) -> Iterator[str]:
    yield f"{measured.coupon} in a {measured.image} of {measured.scale.um_per_px:.4g} µm per pixel{_seen(measured)}"
    for limit in measured.limits:
        yield _minimum(limit)
    yield f"  {'':24} nominal    measured   u (mm)"
    for one in (*measured.features, *measured.undecided):
        size = "   -    " if one.measured_mm is None else f"{one.measured_mm:.5f}"
        u = "-" if one.u_measured_mm is None else short(one.u_measured_mm)
        yield f"  {one.name:24} {one.nominal_mm:<8.4g}   {size}   {u}" + ("" if one.resolved else f"  {one.reason}")


def _seen(measured: CouponMeasurement) -> str:
    """From which face the coupon is seen, where its marks show it."""
    if not measured.location.oriented:
        return ""
    return ", seen mirrored: from below, or the picture is flipped" if measured.location.pose.mirrored else ""


def _minimum(limit: Limit) -> str:
    """A limit with what it rests on."""
    if limit.nominal_mm is None:
        return f"{MINIMA[limit.kind]}: none; not even {limit.next_mm:g} mm is resolved"
    line = f"{MINIMA[limit.kind]}: {'at most ' if limit.bound else ''}{limit.nominal_mm:g} mm"
    if limit.measured_mm is not None:
        line += f", printed {limit.measured_mm:.4f} ± {short(limit.u_measured_mm)} mm"
    return line + (f"; {limit.next_mm:g} mm is not" if limit.next_mm is not None else "")

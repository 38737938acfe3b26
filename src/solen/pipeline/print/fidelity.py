"""Fidelity of a printed coupon: an image or height map as input; sizes, resolution limits and a figure as output."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.errors import SpecError
from solen.fabricate.coupons import read_job
from solen.geometry.coupons import Coupon, CouponOptions, layout
from solen.metrology.coupons import CouponMeasurement, measure_coupon
from solen.metrology.height_map import HeightMapOptions, read_image_or_height_map
from solen.pipeline.options import FLAT
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec.toml import parse_assignment

CouponParameters = Annotated[
    list[str] | None,
    Parameter(name="--set", negative=(), help="Set a parameter of the coupon, as in --set spacing_mm=2; repeatable."),
]


def fidelity(
    file: Path,
    /,
    *,
    coupon: str | None = None,
    job: Path | None = None,
    options: Annotated[HeightMapOptions, FLAT] = HeightMapOptions(),
    set_: CouponParameters = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Annotated[
        Path | None, Parameter(help="Write the result, with nominal and measured sizes, to this .json.")
    ] = None,
) -> Outcome[CouponMeasurement]:
    """Measure a printed coupon in an image or a height map, and the smallest resolved features.

    Parameters
    ----------
    file
        An image (TIFF, PNG, …), or with --z-um a height map (16-bit or floating-point TIFF, or a text table).
    coupon
        The coupon in the image: group-a, group-b, group-c, holes or z-reference. Default: that of the job.
    job
        The job file that solen print coupons wrote with the coupon; it contains the parameters.

    Raises
    ------
    SolenError
        If the files cannot be read, or the coupon is not recognised in the image.
    """
    check_outputs(out, figure)
    nominal = _coupon_of(coupon, job, set_ or ())
    measured = measure_coupon(read_image_or_height_map(file, options), nominal)
    return write(measured, "fidelity", out, figure=figure)


def _coupon_of(name: str | None, job: Path | None, assignments: Sequence[str]) -> Coupon:
    """Return the coupon that the job defines, or else the options."""
    if job is None:
        if name is None:
            raise SpecError("--coupon", limit="is missing", remedy="name the coupon, or specify its --job")
        return layout(name, CouponOptions(**dict(map(parse_assignment, assignments))))
    if assignments:
        raise SpecError("--set", limit="cannot be combined with --job, which defines the coupon", remedy="omit one")
    coupon, _ = read_job(job)
    if name is not None and name != coupon.name:
        raise SpecError(
            "--coupon", value=name, limit=f"does not match the job, which is for {coupon.name}", remedy="omit it"
        )
    return coupon

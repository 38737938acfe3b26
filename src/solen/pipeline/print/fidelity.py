"""Fidelity of a printed coupon: a picture or z map in; sizes, the smallest resolved ones and a figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen.errors import SpecError
from solen.fabricate.coupons import read_job
from solen.geometry.coupons import Coupon, CouponOptions, layout
from solen.metrology.coupons import CouponMeasurement, measure_coupon
from solen.metrology.zmap import ZMapOptions, read_image_or_z_map
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.spec.toml import parse_assignment


def fidelity(
    path: Path,
    coupon: str | None = None,
    options: ZMapOptions = ZMapOptions(),
    *,
    job: Path | None = None,
    assignments: Sequence[str] = (),
    figure: FigureOptions = FigureOptions(),
    out: Path | None = None,
) -> Outcome[CouponMeasurement]:
    """Sizes of a printed coupon from its picture or z map, and the smallest features that are resolved.

    Parameters
    ----------
    path
        Picture, or with ``z_um`` a z map.
    coupon
        Name of the coupon; default: that of the job.
    options
        The scales.
    job
        Job file of the coupon; default: the coupon is laid out with ``assignments``.
    assignments
        ``key=value`` of the coupon's parameters, where there is no job.
    figure, out
        Where to draw the result, and where to write it.

    Raises
    ------
    SolenError
        Where the files cannot be read, or the coupon is not found in the picture.
    """
    check_outputs(out, figure)
    printed = _layout(coupon, job, assignments)
    measured = measure_coupon(read_image_or_z_map(path, options), printed)
    return write(measured, "fidelity", out, figure=figure)


def _layout(name: str | None, job: Path | None, assignments: Sequence[str]) -> Coupon:
    """The coupon of a job or of the options."""
    if job is None:
        if name is None:
            raise SpecError("--coupon", limit="is missing", remedy="name the coupon, or give its --job")
        return layout(name, CouponOptions(**dict(map(parse_assignment, assignments))))
    if assignments:
        raise SpecError("--set", limit="has no effect beside --job, which holds the layout", remedy="leave one out")
    coupon, _ = read_job(job)
    if name is not None and name != coupon.name:
        raise SpecError("--coupon", value=name, limit=f"the job is one of {coupon.name}", remedy="leave it out")
    return coupon

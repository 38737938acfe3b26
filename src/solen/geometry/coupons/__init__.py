"""Coupon layouts: features with nominal positions and sizes, on parts that are printed to be measured.

`COUPONS` contains the coupons; `layout` returns one of them. Where the source is ambiguous, `CouponOptions` has an
option, and the ``readings`` of a coupon report the selected interpretation.
"""

from collections.abc import Callable

from solen.errors import SpecError
from solen.geometry.coupons.model import Coupon, Feature, Gap, Kind, Reading, Slab, Stage, Step, coupon_of
from solen.geometry.coupons.options import CouponOptions
from solen.geometry.coupons.pieces import cubes, cure_discs, film_layer, grey_steps, guides, ledges
from solen.geometry.coupons.raised import group_a, group_b, group_c, z_reference
from solen.geometry.coupons.recessed import holes

COUPONS: dict[str, Callable[[CouponOptions], Coupon]] = {
    "group-a": group_a,
    "group-b": group_b,
    "group-c": group_c,
    "holes": holes,
    "z-reference": z_reference,
    "cure-discs": cure_discs,
    "grey-steps": grey_steps,
    "ledges": ledges,
    "film-layer": film_layer,
    "cubes": cubes,
    "guides": guides,
}


def layout(name: str, options: CouponOptions = CouponOptions()) -> Coupon:
    """Return the coupon with a given name; raise `SpecError` if there is none or it cannot be laid out."""
    if name not in COUPONS:
        raise SpecError("coupon", value=name, limit=f"must be one of {', '.join(COUPONS)}")
    return COUPONS[name](options)


def layouts(only: str | None = None, options: CouponOptions = CouponOptions()) -> list[Coupon]:
    """Return the coupons with comma-separated names, in the order of `COUPONS`; all coupons by default."""
    names = list(COUPONS) if only is None else [name.strip() for name in only.split(",")]
    for name in names:
        if name not in COUPONS:
            raise SpecError("--only", value=name, limit=f"must be one or more of {', '.join(COUPONS)}")
    return [layout(name, options) for name in COUPONS if name in names]


__all__ = [
    "COUPONS",
    "Coupon",
    "CouponOptions",
    "Feature",
    "Gap",
    "Kind",
    "Reading",
    "Slab",
    "Stage",
    "Step",
    "coupon_of",
    "group_a",
    "group_b",
    "group_c",
    "holes",
    "layout",
    "layouts",
]

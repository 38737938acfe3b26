"""Layouts of coupons, which are parts printed to be measured, as features with nominal positions and sizes.

`COUPONS` lists them; `layout` makes one. Ambiguities of the source are options of `CouponOptions`, and a coupon states
the chosen interpretation in its ``readings``.
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
    """Coupon with a given name; raises `SpecError` if there is none or it cannot be laid out."""
    if name not in COUPONS:
        raise SpecError("coupon", value=name, limit=f"must be one of {', '.join(COUPONS)}")
    return COUPONS[name](options)


def layouts(only: str | None = None, options: CouponOptions = CouponOptions()) -> list[Coupon]:
    """Coupons by name, separated by commas, in the order of `COUPONS`; all coupons if no name is given."""
    wanted = list(COUPONS) if only is None else [name.strip() for name in only.split(",")]
    for name in wanted:
        if name not in COUPONS:
            raise SpecError("--only", value=name, limit=f"must be some of {', '.join(COUPONS)}")
    return [layout(name, options) for name in COUPONS if name in wanted]


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

"""Layouts of coupons: parts that are printed in order to be measured, as features of nominal places and sizes.

`COUPONS` names them; `layout` makes one. What the source leaves open or contradicts is a parameter in `Choices`, and a
coupon says in its ``readings`` what was taken.
"""

from collections.abc import Callable

from solen.errors import SpecError
from solen.geometry.coupons.choices import Choices, chosen
from solen.geometry.coupons.file import as_data, coupon_of
from solen.geometry.coupons.model import Coupon, Feature, Gap, Kind, Reading, Slab, Stage, Step
from solen.geometry.coupons.pieces import cubes, cure_discs, film_layer, guides
from solen.geometry.coupons.raised import group_a, group_b, group_c, z_reference
from solen.geometry.coupons.recessed import holes

COUPONS: dict[str, Callable[[Choices], Coupon]] = {
    "group-a": group_a,
    "group-b": group_b,
    "group-c": group_c,
    "holes": holes,
    "z-reference": z_reference,
    "cure-discs": cure_discs,
    "film-layer": film_layer,
    "cubes": cubes,
    "guides": guides,
}


def layout(name: str, choices: Choices | None = None) -> Coupon:
    """Coupon of a name; `SpecError` where there is none or it cannot be laid out."""
    if name not in COUPONS:
        raise SpecError("coupon", value=name, limit=f"must be one of {', '.join(COUPONS)}")
    return COUPONS[name](choices or Choices())


__all__ = [
    "COUPONS",
    "Choices",
    "Coupon",
    "Feature",
    "Gap",
    "Kind",
    "Reading",
    "Slab",
    "Stage",
    "Step",
    "as_data",
    "chosen",
    "coupon_of",
    "cubes",
    "cure_discs",
    "film_layer",
    "group_a",
    "group_b",
    "group_c",
    "guides",
    "holes",
    "layout",
    "z_reference",
]

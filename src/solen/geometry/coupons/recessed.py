"""Coupon with recessed features: a slab of 16 x 3 x 1 mm with eight through-holes in one row.

The walls between holes and at both ends have the same thickness. A chamfered corner orients an image.
"""

from collections.abc import Sequence

from solen.errors import SpecError
from solen.geometry.coupons.model import Coupon, Feature, Reading, Slab, unique_names
from solen.geometry.coupons.options import CouponOptions

SLAB_MM = (16.0, 3.0, 1.0)
HOLE_COUNT = 8
MIN_MM, MAX_MM = 1.40, 1.65
INTERPRETATIONS: dict[str, tuple[tuple[float, ...], str]] = {
    "repeats": (
        (1.65, 1.65, 1.60, 1.55, 1.50, 1.45, 1.40, 1.40),
        "steps of 0.05 mm over the range, as required by the resolved 50 µm; the largest and the smallest hole are "
        "repeated, which makes eight holes and shows how reproducible equal holes are",
    ),
    "even": (
        tuple(round(MAX_MM - number * (MAX_MM - MIN_MM) / (HOLE_COUNT - 1), 6) for number in range(HOLE_COUNT)),
        "eight sizes in uniform steps of 0.0357 mm over the range",
    ),
    "tenths": (
        tuple(round(MIN_MM + number * 0.1, 2) for number in reversed(range(HOLE_COUNT))),
        "steps of 0.1 mm from 1.40 mm: eight holes reach 2.10 mm, which is outside the range",
    ),
}


def holes(options: CouponOptions = CouponOptions(), diameters_mm: Sequence[float] | None = None) -> Coupon:
    """Return through-holes of decreasing diameter, to find the smallest diameter difference that is resolved."""
    sizes_mm, taken = INTERPRETATIONS[options.hole_reading]
    sizes = tuple(diameters_mm) if diameters_mm is not None else sizes_mm
    width, depth, thickness = SLAB_MM
    wall = (width - sum(sizes)) / (len(sizes) + 1)
    if wall <= 0.0:
        limit = f"do not fit side by side into a slab of {width:g} mm"
        raise SpecError("holes diameters_mm", value=list(sizes), limit=limit, remedy="use fewer or smaller holes")
    printed = "eight circular through-holes … 1.40–1.65 mm (steps of 0.1 mm)"
    reading = Reading("diameters", printed, taken if diameters_mm is None else "diameters specified by the caller")
    slab = Slab(width, depth, thickness, options.bevel_mm)
    return Coupon("holes", "holes of decreasing diameter", _row(sizes, wall, thickness), slab, readings=(reading,))


def _row(sizes: Sequence[float], wall: float, thickness: float) -> tuple[Feature, ...]:
    """Return holes along x, separated by equal walls; repeated sizes are distinguished by a letter."""
    names = unique_names((f"hole-{size:g}" for size in sizes), lambda number: chr(ord("a") + number - 1))
    holes, edge = [], -0.5 * SLAB_MM[0] + wall
    for name, size in zip(names, sizes, strict=True):
        holes.append(Feature(name, "hole", edge + 0.5 * size, 0.0, size, size, 0.0, thickness))
        edge += size + wall
    return tuple(holes)

"""Coupon with recessed features: a slab of 16 x 3 x 1 mm with eight through-holes in one row.

The walls between holes and at both ends have the same thickness. A bevelled corner orients an image.
"""

from collections.abc import Sequence

from solen.errors import SpecError
from solen.geometry.coupons.model import Coupon, Feature, Reading, Slab, distinct
from solen.geometry.coupons.options import CouponOptions

SLAB_MM = (16.0, 3.0, 1.0)
HOLES = 8
FROM_MM, TO_MM = 1.40, 1.65
READINGS: dict[str, tuple[tuple[float, ...], str]] = {
    "repeats": (
        (1.65, 1.65, 1.60, 1.55, 1.50, 1.45, 1.40, 1.40),
        "steps of 0.05 mm over the range, as required by the resolved 50 µm; the largest and smallest holes are "
        "repeated, which gives eight holes and shows how reproducible equal holes are",
    ),
    "even": (
        tuple(round(TO_MM - number * (TO_MM - FROM_MM) / (HOLES - 1), 6) for number in range(HOLES)),
        "eight uniform steps of 0.0357 mm over the range",
    ),
    "tenths": (
        tuple(round(FROM_MM + number * 0.1, 2) for number in reversed(range(HOLES))),
        "steps of 0.1 mm from 1.40 mm: eight holes then reach 2.10 mm, beyond the range",
    ),
}


def holes(options: CouponOptions = CouponOptions(), diameters_mm: Sequence[float] | None = None) -> Coupon:
    """Return through-holes of decreasing diameter, for finding the smallest resolved diameter difference."""
    read, taken = READINGS[options.hole_reading]
    sizes = tuple(diameters_mm) if diameters_mm is not None else read
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
    """Return holes along x with equal walls; repeated sizes are distinguished by a letter."""
    names = distinct((f"hole-{size:g}" for size in sizes), lambda number: chr(ord("a") + number - 1))
    holes, edge = [], -0.5 * SLAB_MM[0] + wall
    for name, size in zip(names, sizes, strict=True):
        holes.append(Feature(name, "hole", edge + 0.5 * size, 0.0, size, size, 0.0, thickness))
        edge += size + wall
    return tuple(holes)

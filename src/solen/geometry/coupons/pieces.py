"""Coupons of separate parts: cure discs, grey steps, ledges, a single layer on a film, cubes and cut-back guides."""

from collections.abc import Sequence

from solen.geometry.coupons.model import Coupon, Feature, Reading, Stage, unique_names
from solen.geometry.coupons.options import CouponOptions
from solen.geometry.coupons.raised import snapped

DISC_MM = 3.0
FILM_BASE_MM = 0.5
CUBE_BEVEL_MM = 0.5
BAR_MM, BAR_DEPTH_MM = 3.0, 4.0
"""Width of the ledge bars at their top and bottom, and their depth."""
SPACING_MM = 5.0
"""Free distance between parts, which are removed from the plate one by one."""


def cure_discs(options: CouponOptions = CouponOptions()) -> Coupon:
    """Return discs 3 mm in diameter, each cured by one exposure of a drop of resin, for the working curve."""
    exposures = options.disc_exposures_s
    names = unique_names(f"t-{exposure:g}s" for exposure in exposures)
    discs = _disc_row(options, names, exposures, [None] * len(names))
    cautions = (
        "the thickness of a disc is its cure depth, not the height of the solid: without the build platform, project "
        "the circle onto a drop on the floor of the vat, for each exposure in turn",
        "at low doses the discs are too thin and soft to be measured reliably: report this with the thickness",
    )
    printed = "progressively increasing exposure time"
    taken = f"{', '.join(f'{exposure:g}' for exposure in exposures)} s"
    readings = (Reading("exposures", printed, taken),)
    return Coupon("cure-discs", "discs for the working curve", discs, readings=readings, cautions=cautions)


def grey_steps(options: CouponOptions = CouponOptions()) -> Coupon:
    """Return discs 3 mm in diameter in one image, with different grey levels, to measure the dose of grey pixels."""
    names = unique_names(f"g-{grey:g}" for grey in options.greys)
    discs = _disc_row(options, names, [options.grey_exposure_s] * len(names), options.greys)
    cautions = (
        "the thickness of a disc is its cure depth: without the build platform, project the image once onto a "
        "drop on the floor of the vat; the first disc has the full grey level",
        "enter the thicknesses next to their grey levels in a table for solen print grey; measure Dp with the "
        "cure-discs coupon on the same day",
    )
    readings = (
        Reading(
            "greys", "none", "added by solen: the light of the grey pixels at an edge determines the position of a wall"
        ),
    )
    return Coupon("grey-steps", "discs with several grey levels", discs, readings=readings, cautions=cautions)


def ledges(options: CouponOptions = CouponOptions()) -> Coupon:
    """Return bars with a waist: layers recede by a ledge up to mid-height and protrude by one above, like a lens.

    The light of later layers cures resin beneath the ledges of the upper half. The first and the last layer are
    designed identical: images of the bottom and the top show the effect of the exposures, and a side view shows the
    waist.
    """
    layer, half_count = 1e-3 * options.layer_um, options.ledge_layers // 2
    bars = (0.0, *options.ledges_um)
    features = []
    for x, ledge_um in zip(_centred_mm(len(bars), BAR_MM + SPACING_MM), bars, strict=True):
        x_mm = snapped(x, options)
        for index in range(2 * half_count) if ledge_um else (0,):
            width = BAR_MM - 2e-3 * ledge_um * min(index, 2 * half_count - 1 - index)
            bottom, top = (index, index + 1) if ledge_um else (0, 2 * half_count)
            box = (x_mm, 0.0, width, BAR_DEPTH_MM, bottom * layer, top * layer)
            features.append(Feature(f"ledge-{ledge_um:g}um-layer-{index + 1}", "ledge", *box, round=False))
    cautions = (
        "take images of the top, the bottom, and the side view along the bars: the upper half of the waist shows the "
        "resin that later light cures below a ledge, the lower half the resin that is missing; the first bar has no "
        "ledges",
        "print the bars flat, with the layer thickness for which they were designed: --layer-um",
    )
    taken = f"{', '.join(f'{ledge:g}' for ledge in options.ledges_um)} µm per layer, over {2 * half_count} layers"
    readings = (Reading("ledges", "none", f"added by solen, for layered lenses: {taken}"),)
    return Coupon("ledges", "bars with a waist made of ledges", tuple(features), readings=readings, cautions=cautions)


def film_layer(options: CouponOptions = CouponOptions()) -> Coupon:
    """Return a layer on a film on a base of 0.5 mm, to measure the index of a layer with a spectrophotometer."""
    side, layer = options.film_side_mm, 1e-3 * options.layer_um
    stages = (
        Stage("base", 0.0, "print the base and leave it on the build platform"),
        Stage(
            "layer",
            FILM_BASE_MM + options.film_mm,
            f"cure a film of {options.film_mm:g} mm onto the base, then set the zero of the printer on this film: at "
            f"the first layer, the platform must be {FILM_BASE_MM + options.film_mm:g} mm higher than without base and "
            f"film, and {options.film_mm:g} mm higher than with the base alone",
        ),
    )
    pieces = (
        Feature("base", "layer", 0.0, 0.0, side, side, 0.0, FILM_BASE_MM, False, options.bevel_mm, "base"),
        Feature(
            "layer", "layer", 0.0, 0.0, side, side, 0.0, layer, False, options.bevel_mm, "layer", options.exposure_s
        ),
    )
    cautions = (
        "the layer is as thick as the gap, which depends on how the zero was set: measure it, do not assume it",
        "the baseline of the spectrum is the bare film: run solen resin index with --baseline substrate",
    )
    readings = (
        Reading("size", "not specified", f"{side:g} x {side:g} mm, to cover the beam of a spectrophotometer"),
        Reading("z", "after calibrating the printer for the new thickness", stages[1].note),
    )
    return Coupon("film-layer", "single layer on film", pieces, stages=stages, readings=readings, cautions=cautions)


def cubes(options: CouponOptions = CouponOptions()) -> Coupon:
    """Return cubes of 1 cm for compression tests; a chamfered vertical edge marks the printing direction."""
    side, count = options.cube_mm, options.cubes
    bevel = min(CUBE_BEVEL_MM, 0.25 * side)
    pieces = tuple(
        Feature(f"cube-{number}", "cube", x, 0.0, side, side, 0.0, side, False, bevel)
        for number, x in enumerate(_centred_mm(count, side + SPACING_MM), 1)
    )
    area = side * side - 0.5 * bevel * bevel
    readings = (
        Reading("number", "not specified", f"{count}"),
        Reading(
            "mark",
            "none",
            f"a vertical edge is chamfered by {bevel:g} mm, which leaves a cross-section of {area:.6g} mm²",
        ),
    )
    return Coupon("cubes", "cubes for compression", pieces, readings=readings)


def guides(options: CouponOptions = CouponOptions()) -> Coupon:
    """Return straight guides to measure the loss by cut-back, identified by their lengths instead of marks."""
    width, height = options.guide_width_mm, options.guide_height_mm
    lengths = options.guide_lengths_mm
    names = unique_names(f"l-{length:g}" for length in lengths)
    y_mm = _centred_mm(len(lengths), width + SPACING_MM)[::-1]
    pieces = tuple(
        Feature(name, "guide", 0.0, y, length, width, 0.0, height, round=False)
        for name, y, length in zip(names, y_mm, lengths, strict=True)
    )
    readings = (
        Reading(
            "guides", "none", "added by solen: a single layer cannot show the loss of a guide several centimetres long"
        ),
    )
    cautions = (
        "print the guides in the same direction as the sensor, and another set perpendicular to it, because scattering "
        "depends on the direction of the layers",
        "the guides have no marks, because a mark would scatter light: label them when you remove them from the plate",
    )
    return Coupon("guides", "cut-back guides", pieces, readings=readings, cautions=cautions)


def _disc_row(
    options: CouponOptions, names: Sequence[str], exposures_s: Sequence[float], greys: Sequence[float | None]
) -> tuple[Feature, ...]:
    """Return a row of discs along x, one layer thick."""
    x_mm = _centred_mm(len(names), DISC_MM + SPACING_MM)
    return tuple(
        Feature(name, "disc", x, 0.0, DISC_MM, DISC_MM, 0.0, 1e-3 * options.layer_um, exposure_s=exposure, grey=grey)
        for name, x, exposure, grey in zip(names, x_mm, exposures_s, greys, strict=True)
    )


def _centred_mm(count: int, pitch_mm: float) -> list[float]:
    """Return equidistant positions about 0."""
    return [(i - 0.5 * (count - 1)) * pitch_mm for i in range(count)]

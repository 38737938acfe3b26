"""Parameters of coupons, and interpretations of the source where it is incomplete or contradicts itself.

The source is the Methods section of the paper on 3D-printed soft optical sensors with a lens. Four of its statements
cannot be printed as written; each is an option here, and the `Reading` of the coupon explains the interpretation.
"""

from typing import Annotated, Literal

from pydantic import Field

from solen.spec.strict import Options

Size = Annotated[float, Field(gt=0, le=1e6)]
Sizes = Annotated[tuple[Size, ...], Field(min_length=1)]


class CouponOptions(Options):
    """Parameters of all coupons; quotations are from the paper."""

    hole_reading: Literal["repeats", "even", "tenths"] = "repeats"
    """Eight holes of "1.40–1.65 mm (steps of 0.1 mm)". repeats: steps of 0.05 mm, with the first and last size twice;
    even: eight uniformly spaced sizes over the range; tenths: steps of 0.1 mm from 1.40 mm.
    """
    step_reading: Literal["halving", "literal"] = "halving"
    """Rows of group C of "heights 0.2 mm - 0.5 mm (0.5 mm steps) … (0.25 steps)". halving: steps of 0.05 and 0.025 mm;
    literal: the steps as written, with which the range contains one and two heights.
    """
    reference_reading: Literal["literal", "staircase"] = "literal"
    """Pillars of "1.000 mm, 1.025 mm, and 0.025 mm". literal: as written; staircase: 1.050 mm as the third."""
    gap_reading: Literal["pairs", "row"] = "pairs"
    """Arrangement of the twelve gaps of group B: between separate pairs of cylinders, or in one row of thirteen."""
    spacing_mm: Size = 1.0
    """Free distance between separate features."""
    bevel_mm: Annotated[float, Field(ge=0, le=1e6)] = 0.6
    """Leg length of the chamfer on the corner that orients a slab; 0 omits the chamfer."""
    marks: bool = True
    """Three round marks on slabs with pillars, which orient an image; --marks=false omits them."""
    layer_um: Size = 25.0
    """Layer thickness of discs, ledges and the single layer."""
    pitch_um: Size | None = None
    """Pixel pitch of the printer; if specified, all features are centred on pixel corners, so equal features have equal
    pixels.
    """
    exposure_s: Size = 2.0
    """Exposure time of a layer."""
    burn_in_layers: Annotated[int, Field(ge=0, le=1000)] = 6
    """Number of first layers with a longer exposure (burn-in)."""
    burn_in_s: Size = 3.0
    """Exposure time of the burn-in layers."""
    irradiance_mW_per_cm2: Size = 13.0
    """Irradiance at the window of the vat."""
    disc_exposures_s: Sizes = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
    """Exposure times of the cure discs, in printing order."""
    greys: Sizes = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 1.0)
    """Grey levels of the discs of the grey-steps coupon, as fractions of the full level."""
    grey_exposure_s: Size = 6.0
    """Exposure of the grey-steps coupon; it must be long enough to cure the darkest disc."""
    ledges_um: Sizes = (5.0, 10.0, 20.0)
    """Ledges between the layers of each ledge bar, first inwards, then outwards."""
    ledge_layers: Annotated[int, Field(ge=4, le=400)] = 40
    """Number of layers of a ledge bar; an odd number is reduced by one."""
    film_mm: Size = 0.1
    """Thickness of the film under the single layer."""
    film_side_mm: Size = 20.0
    """Side of the single layer."""
    cubes: Annotated[int, Field(ge=1, le=100)] = 5
    """Number of compression cubes."""
    cube_mm: Size = 10.0
    """Side of the compression cubes."""
    guide_lengths_mm: Sizes = (5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
    """Lengths of the cut-back guides."""
    guide_width_mm: Size = 3.0
    """Width of the guides."""
    guide_height_mm: Size = 3.0
    """Height of the guides."""

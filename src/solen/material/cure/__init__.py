"""Cure: how deep light hardens a resin, and what dose the parts of a print receive.

`curve` fits the working curve; `discs` selects the columns of a table for it and derives the consequences for a print;
`layers` adds up the doses in a print; `penetration` computes the penetration depth from an absorbance;
`published_bounds` turns statements of the kind "200 µm at 39 mJ/cm²" into bounds; `exposures` compares the optics of
layers with different exposures.
"""

from solen.material.cure.curve import WorkingCurve, working_curve
from solen.material.cure.discs import CureOptions, MeasuredCurve, curve_of_discs
from solen.material.cure.layers import cure_depth_um, dose_below, stack_dose, stack_print_through_um
from solen.material.cure.published_bounds import largest_Ec

__all__ = [
    "CureOptions",
    "MeasuredCurve",
    "WorkingCurve",
    "cure_depth_um",
    "curve_of_discs",
    "dose_below",
    "largest_Ec",
    "stack_dose",
    "stack_print_through_um",
    "working_curve",
]

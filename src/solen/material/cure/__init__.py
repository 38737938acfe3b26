"""Cure: how deep light cures a resin, and the dose that each layer of a print receives.

`working_curve_fit` fits the working curve; `discs` reads the discs of a table and applies their working curve to a
print; `layers` adds up the doses in a print; `penetration` computes the penetration depth from an absorbance;
`spectral` fits the cure law for a lamp with a spectrum; `published_bounds` converts statements such as "200 µm at 39
mJ/cm²" into bounds; `exposures` compares the optical properties of layers with different exposures.
"""

from solen.material.cure.discs import CureOptions, MeasuredCurve, curve_of_discs
from solen.material.cure.layers import cure_depth_um, dose_below, stack_dose, stack_print_through_um
from solen.material.cure.published_bounds import largest_Ec
from solen.material.cure.working_curve_fit import WorkingCurve, working_curve

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

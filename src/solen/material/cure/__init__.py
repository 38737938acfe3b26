"""Cure: how deep light hardens a resin, and what dose the parts of a print receive.

`solen.material.cure.curve` fits the working curve, `solen.material.cure.layers` says what it means for a print in
layers, `solen.material.cure.colour` finds the penetration depth from an absorbance, `solen.material.cure.stated` turns
statements of the kind "200 µm at 39 mJ/cm²" into bounds, `solen.material.cure.exposure` looks at a layer's optics
against its exposure.
"""

from solen.material.cure.colour import Attenuation, attenuation, penetration_depth_um
from solen.material.cure.curve import Disc, LackOfFit, LeftOut, WorkingCurve, working_curve
from solen.material.cure.exposure import Sample, Trend, trend
from solen.material.cure.layers import (
    StackDose,
    cure_depth_um,
    dose_below,
    dose_for_depth,
    stack_dose,
    stack_print_through_um,
)
from solen.material.cure.stated import PAPER, Statement, binding, largest_Ec

__all__ = [
    "PAPER",
    "Attenuation",
    "Disc",
    "LackOfFit",
    "LeftOut",
    "Sample",
    "StackDose",
    "Statement",
    "Trend",
    "WorkingCurve",
    "attenuation",
    "binding",
    "cure_depth_um",
    "dose_below",
    "dose_for_depth",
    "largest_Ec",
    "penetration_depth_um",
    "stack_dose",
    "stack_print_through_um",
    "trend",
    "working_curve",
]

"""Coupons measured: the layout found in a picture or a z map, each feature's size, and the smallest that is resolved.

`measure` does it all and gives a `Fidelity`. `register` finds the coupon, `fit_disc` and `fit_gap` measure, `height_of`
and `steps_of` read a z map, `limits` says what the smallest resolved features are and how that is defined.
"""

from solen.metrology.coupons.disc import Disc, fit_disc
from solen.metrology.coupons.fidelity import Fidelity, limits_of, measure
from solen.metrology.coupons.gap import GapFit, fit_gap
from solen.metrology.coupons.heights import Height
from solen.metrology.coupons.limits import Limit, Measured
from solen.metrology.pose import Placement
from solen.metrology.coupons.locate import Registration, register

__all__ = [
    "Disc",
    "Fidelity",
    "GapFit",
    "Height",
    "Limit",
    "Measured",
    "Placement",
    "Registration",
    "fit_disc",
    "fit_gap",
    "limits_of",
    "measure",
    "register",
]

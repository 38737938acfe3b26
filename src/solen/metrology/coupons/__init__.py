"""Measurement of coupons in images or height maps: location, feature sizes, and the smallest resolved features.

`measure_coupon` does all of this and returns a `CouponMeasurement`. `locate` finds the coupon, `fit_disc` and `fit_gap`
measure its features, `height_of` and `steps_of` evaluate a height map, and `limits` defines the smallest resolved
features.
"""

from solen.metrology.coupons.disc import fit_disc
from solen.metrology.coupons.limits import Limit, MeasuredSize, limits_of
from solen.metrology.coupons.measurement import CouponMeasurement, measure_coupon

__all__ = ["CouponMeasurement", "Limit", "MeasuredSize", "fit_disc", "limits_of", "measure_coupon"]

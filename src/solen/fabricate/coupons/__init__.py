"""Printable coupons: solids of their layouts, a job file, and a plan at true scale."""

from solen.fabricate.coupons.job import as_job, cautions, read_job
from solen.fabricate.coupons.plan import as_plan
from solen.fabricate.coupons.printable import printable_coupon
from solen.fabricate.coupons.solid import coupon_parts
from solen.fabricate.coupons.written import CouponOutput, CouponSet, coupon_set, written_coupons

__all__ = [
    "CouponOutput",
    "CouponSet",
    "as_job",
    "as_plan",
    "cautions",
    "coupon_parts",
    "coupon_set",
    "printable_coupon",
    "read_job",
    "written_coupons",
]

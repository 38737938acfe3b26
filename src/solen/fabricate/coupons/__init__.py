"""Coupons as parts to print: solids of their layouts, the job that goes with them, and a plan at true scale."""

from solen.fabricate.coupons.job import JOB_KIND, as_job, cautions, job_sha256, read_job
from solen.fabricate.coupons.plan import as_plan
from solen.fabricate.coupons.solid import check_plate, coupon_parts

__all__ = [
    "JOB_KIND",
    "as_job",
    "as_plan",
    "cautions",
    "check_plate",
    "coupon_parts",
    "job_sha256",
    "read_job",
]

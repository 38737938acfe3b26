"""Sizes compared with the paper are measured on the body."""

import math

import pytest

from solen.paper.design_numbers import (
    body_sizes,
    coupon_sizes,
    lens_sizes,
    peak_nm,
    pivot_deviation_mm,
    source_of,
    u_major_base_mm,
)
from solen.paper.sensor_numbers import POINT, shipped
from solen.paper.statements import compared, paper_value


def test_sizes_of_body_follow_design() -> None:
    changed = {
        "body.stem_length_mm": 15.0,
        "body.stem_curve_per_mm": 0.005,
        "body.arm_length_mm": 20.0,
        "body.arm_width_mm": 2.5,
        "lens.half_width_mm": 1.8,
        "emitter.distance_mm": 1.2,
        "emitter.rays": 50,
        "emitter.cone_deg": 90.0,
        "emitter.wavelength_nm": 850.0,
    }
    sensor = shipped(POINT).set(changed)
    expected = {
        "stem-length": 15.0,
        "stem-curve": 0.005,
        "minor-base": 3.6,
        "major-base": 3.6 + 2.0 * 0.005 * 15.0**2,
        "arm-length": 20.0,
        "arm-width": 2.5,
        "lens-width": 1.8,
        "emitter-distance": 1.2,
        "rays": 50.0,
        "cone": 90.0,
        "wavelength": 850.0,
    }
    assert body_sizes(sensor) | lens_sizes(sensor) | source_of(sensor) == pytest.approx(expected, abs=1e-9)


def test_uncertainty_of_width_at_fork_follows_from_reported_digits() -> None:
    """The reported 0.004 stands for 0.0035 to 0.0045, which alone gives a width of 5.8 to 6.4 mm at the fork."""
    sizes = body_sizes(shipped(POINT))
    low, high = (4.0 + 2.0 * curve * 16.2**2 for curve in (0.0035, 0.0045))
    contributions = ((high - low) / math.sqrt(12.0), 1.0 / math.sqrt(12.0), 4.0 * 0.004 * 16.2 * 0.1 / math.sqrt(12.0))
    assert u_major_base_mm(sizes) == pytest.approx(math.hypot(*contributions))
    row = compared("major-base", sizes["major-base"], u_major_base_mm(sizes))
    assert low < paper_value("major-base") < high
    assert row.verdict == "agrees"


def test_centre_of_rotation_follows_from_lens() -> None:
    sensor = shipped(POINT)
    assert pivot_deviation_mm(sensor, -3.0) == pytest.approx(0.0, abs=1e-9)
    base, emitter = sensor.body().marks["stem-base"], sensor.body().emitter.point
    assert pivot_deviation_mm(sensor.set({"motion.pivot": "emitter"}), -3.0) == pytest.approx(base[1] - emitter[1])


def test_only_inconsistent_steps_of_paper_differ() -> None:
    sizes = coupon_sizes()
    differ = {key for key, size in sizes.items() if size != pytest.approx(paper_value(key))}
    assert differ == {"group-c-step-2", "group-c-step-3", "holes-step"}


def test_peaks_of_parts_agree_with_datasheets() -> None:
    assert peak_nm("VSMY1850") == (850.0, 0.0)
    nm, u = peak_nm("TEMT7100X01")
    assert abs(nm - paper_value("receiver-peak")) < u
    with pytest.raises(ValueError, match="USB-6218"):
        peak_nm("USB-6218")

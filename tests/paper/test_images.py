"""Sizes measured in simulated images agree with those of the print model."""

from pathlib import Path

import numpy as np

from solen.fabricate.process import MeasuredFeature, printed_mm
from solen.fabricate.process.process_file import default_process
from solen.geometry.coupons import layout
from solen.metrology import InspectOptions, read_image
from solen.metrology.coupons import measure_coupon
from solen.paper.images import COUPON_UM_PER_PX, coupon_image


def test_measured_holes_of_simulated_print_agree_with_printed_sizes(tmp_path: Path) -> None:
    coupon, file = layout("holes"), tmp_path / "holes.png"
    file.write_bytes(coupon_image(coupon))
    assert file.read_bytes() == coupon_image(coupon)
    measured = measure_coupon(read_image(file, options=InspectOptions(um_per_px=COUPON_UM_PER_PX)), coupon)
    assert measured.simulated
    holes = [feature for feature in measured.measured if feature.kind == "hole"]
    features = [MeasuredFeature("hole", feature.nominal_mm, None, None, resolved=True) for feature in holes]
    true = printed_mm(default_process().process, features)
    deviations = np.array([feature.measured_mm for feature in holes]) - true
    u = np.array([feature.u_measured_mm for feature in holes])
    assert len(holes) == 8
    assert np.sqrt(np.mean((deviations / u) ** 2)) < 2.0

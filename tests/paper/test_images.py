"""Simulated images show the sizes that the print model states: measured in them, these come back."""

from pathlib import Path

import numpy as np

from solen.fabricate.process import MeasuredFeature, printed_mm
from solen.fabricate.process.process_file import default_process
from solen.geometry.coupons import layout
from solen.metrology import InspectOptions, read_image
from solen.metrology.coupons import measure_coupon
from solen.paper.images import COUPON_UM_PER_PX, coupon_image


def test_holes_of_a_simulated_print_are_measured_as_they_were_printed(tmp_path: Path) -> None:
    coupon, file = layout("holes"), tmp_path / "holes.png"
    file.write_bytes(coupon_image(coupon))
    assert file.read_bytes() == coupon_image(coupon)
    found = measure_coupon(read_image(file, options=InspectOptions(um_per_px=COUPON_UM_PER_PX)), coupon)
    assert found.simulated
    holes = [one for one in found.measured if one.kind == "hole"]
    features = [MeasuredFeature("hole", one.nominal_mm, None, None, resolved=True) for one in holes]
    true = printed_mm(default_process().process, features)
    off = np.array([one.measured_mm for one in holes]) - true
    u = np.array([one.u_measured_mm for one in holes])
    assert len(holes) == 8
    assert np.sqrt(np.mean((off / u) ** 2)) < 2.0

"""Coupons: a simulated height map of group C, printed in layers of 50 µm, and the smallest step that it reproduces."""

import numpy as np

from solen.geometry.coupons import group_c
from solen.metrology import Scale
from solen.metrology.coupons import measure_coupon
from solen.metrology.height_map import HeightMap
from solen.recording import Provenance

UM_PER_PX, LAYER_MM, ROUGH_MM = 15.0, 0.05, 0.002


def height_map_mm() -> np.ndarray:
    """Return the heights above the build plate: whole layers, with a roughness of 2 µm from pixel to pixel."""
    coupon = group_c()
    width, depth, top = coupon.size_mm
    slab = top - max(one.height_mm for one in coupon.features)
    x, y = np.meshgrid(
        np.arange(-0.55 * width, 0.55 * width, 1e-3 * UM_PER_PX),
        np.arange(0.6 * depth, -0.6 * depth, -1e-3 * UM_PER_PX),
    )
    z = np.where((np.abs(x) < 0.5 * width) & (np.abs(y) < 0.5 * depth), slab, 0.0)
    for one in coupon.features:
        layers = round(one.height_mm / LAYER_MM + 1e-6)
        z[np.hypot(x - one.x_mm, y - one.y_mm) < 0.5 * one.diameter_mm] += layers * LAYER_MM
    return z + ROUGH_MM * np.random.default_rng(1).standard_normal(z.shape)


def main() -> dict[str, float | None]:
    """Return the smallest reproduced step, its measured size, and the next one, which is not reproduced."""
    source = Provenance(file="simulated height map", simulated=True)
    found = measure_coupon(HeightMap(height_map_mm(), Scale(UM_PER_PX), source), group_c())
    (step,) = [one for one in found.limits if one.kind == "z_step"]
    fine = [one for one in found.measured if one.kind == "step" and one.nominal_mm == step.next_mm]
    rises = sum(bool(one.resolved) for one in fine)
    print(f"steps of {step.nominal_mm} mm are reproduced, on average {step.measured_mm:.4f} mm")
    print(f"of {len(fine)} steps of {step.next_mm} mm {rises} are a rise")
    return {"step_mm": step.nominal_mm, "printed_mm": step.measured_mm, "not_mm": step.next_mm, "rises": rises}


if __name__ == "__main__":
    main()

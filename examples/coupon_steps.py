"""A simulated height map of the group C coupon, printed in layers of 50 µm, and the smallest step it reproduces."""

import numpy as np

from solen.geometry.coupons import group_c
from solen.metrology import Scale
from solen.metrology.coupons import measure_coupon
from solen.metrology.height_map import HeightMap
from solen.recording import Provenance

UM_PER_PX, LAYER_MM, ROUGHNESS_MM = 15.0, 0.05, 0.002


def height_map_mm() -> np.ndarray:
    """Return the heights above the build plate: multiples of a layer, with a roughness of 2 µm per pixel."""
    coupon = group_c()
    width, depth, top = coupon.size_mm
    slab = top - max(pillar.height_mm for pillar in coupon.features)
    x, y = np.meshgrid(
        np.arange(-0.55 * width, 0.55 * width, 1e-3 * UM_PER_PX),
        np.arange(0.6 * depth, -0.6 * depth, -1e-3 * UM_PER_PX),
    )
    z = np.where((np.abs(x) < 0.5 * width) & (np.abs(y) < 0.5 * depth), slab, 0.0)
    for pillar in coupon.features:
        layers = round(pillar.height_mm / LAYER_MM + 1e-6)
        z[np.hypot(x - pillar.x_mm, y - pillar.y_mm) < 0.5 * pillar.diameter_mm] += layers * LAYER_MM
    return z + ROUGHNESS_MM * np.random.default_rng(1).standard_normal(z.shape)


def main() -> dict[str, float | None]:
    """Return the smallest reproduced step, its measured height, the next smaller step, and how many of these rise."""
    source = Provenance(file="simulated height map", simulated=True)
    result = measure_coupon(HeightMap(height_map_mm(), Scale(UM_PER_PX), source), group_c())
    (step,) = [limit for limit in result.limits if limit.kind == "z_step"]
    smaller = [item for item in result.measured if item.kind == "step" and item.nominal_mm == step.next_mm]
    rises = sum(bool(item.resolved) for item in smaller)
    print(f"steps of {step.nominal_mm} mm are reproduced; their mean height is {step.measured_mm:.4f} mm")
    print(f"{rises} of {len(smaller)} steps of {step.next_mm} mm rise at all")
    return {"step_mm": step.nominal_mm, "printed_mm": step.measured_mm, "next_mm": step.next_mm, "rises": rises}


if __name__ == "__main__":
    main()

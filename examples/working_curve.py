"""Dose: a working curve of simulated discs, the dose of a layer in a print, and bounds from published statements.

The paper gives neither a penetration depth nor a critical dose, but states that 3 s at 13 mW/cm² cure more than 200 µm,
and that layers of 25 µm are printed with 2 s. The discs here are simulated, with values that satisfy these statements.
"""

import numpy as np

from solen.material.cure import largest_Ec, stack_dose, working_curve
from solen.recording import read
from solen.samples import FOLDER

IRRADIANCE_MW_PER_CM2, LAYER_UM, EXPOSURE_S = 13.0, 25.0, 2.0
DISCS = FOLDER / "discs-simulated.csv"


def main() -> dict[str, float]:
    """Return Dp, Ec and a depth from the curve, doses in a part of 100 layers, and the largest Ec the paper allows.

    Six of the layers are burn-in layers.
    """
    table = read(DISCS)
    dose = table.need("exposure").to("s") * IRRADIANCE_MW_PER_CM2
    curve = working_curve(dose, table.need("thickness").to("um"))
    low, high = curve.interval95_Dp_um
    print(f"Dp {curve.Dp_um:.1f} µm ({low:.1f} to {high:.1f}, 95 %)")
    low, high = curve.interval95_Ec_mJ_per_cm2 or (0.0, np.inf)
    print(f"Ec {curve.Ec_mJ_per_cm2:.2f} mJ/cm² ({low:.2f} to {high:.2f}, 95 %)")
    print("excluded:", ", ".join(f"row {exclusion.disc.row}, {exclusion.reason}" for exclusion in curve.left_out))

    at_3_s = float(curve.depth_um(3.0 * IRRADIANCE_MW_PER_CM2))
    print(f"3 s cures {at_3_s:.0f} ± {float(curve.half_width_um(39.0)):.0f} µm")

    seconds = np.where(np.arange(100) < 6, 3.0, EXPOSURE_S)
    stack = stack_dose(curve.Dp_um, LAYER_UM, seconds * IRRADIANCE_MW_PER_CM2)
    print(f"mean dose of a single layer: {stack.single_layer_mean_mJ_per_cm2:.1f} mJ/cm²")
    factor = f"{stack.interior_over_single_layer:.2f} times as much"
    print(f"mean dose of a layer within the part: {stack.layer_mean_mJ_per_cm2[50]:.1f} mJ/cm², {factor}")

    for depth_um in (50.0, 100.0, 200.0):
        print(
            f"for Dp = {depth_um:.0f} µm the statements of the paper allow Ec up to {largest_Ec(depth_um):.2f} mJ/cm²"
        )
    return {
        "Dp_um": curve.Dp_um,
        "Ec_mJ_per_cm2": curve.Ec_mJ_per_cm2,
        "at_3_s_um": at_3_s,
        "inside_mJ_per_cm2": float(stack.layer_mean_mJ_per_cm2[50]),
        "alone_mJ_per_cm2": stack.single_layer_mean_mJ_per_cm2,
        "largest_Ec_mJ_per_cm2": largest_Ec(curve.Dp_um),
    }


if __name__ == "__main__":
    main()

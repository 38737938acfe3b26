"""Write the simulated tables beside the examples: ``python tools/tables.py``."""

import math
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).parent.parent / "examples"
IRRADIANCE_MW_PER_CM2 = 13.0
DP_UM, EC_MJ_PER_CM2 = 110.0, 6.0
SECONDS = (0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
LOSSES_DB_PER_CM = {"flat": 1.3, "upright": 2.1}
LENGTHS_MM = (10, 20, 30, 40, 50)


def discs() -> str:
    """Cured discs, three of each exposure, that scatter by 5 %; one is torn, and one exposure was too short."""
    rng = np.random.default_rng(39)
    rows = [
        f"# simulated: Dp {DP_UM:g} µm, Ec {EC_MJ_PER_CM2:g} mJ/cm², 13 mW/cm²; discs scatter by 5 %, one is torn",
        "exposure_s,thickness_um,replicate",
        "0.4,0,1",
    ]
    for seconds in SECONDS:
        for replicate in (1, 2, 3):
            depth = DP_UM * math.log(IRRADIANCE_MW_PER_CM2 * seconds / EC_MJ_PER_CM2) * rng.normal(1.0, 0.05)
            torn = 0.55 if (seconds, replicate) == (4.0, 2) else 1.0
            rows.append(f"{seconds:g},{torn * depth:.1f},{replicate}")
    return "\n".join(rows) + "\n"


def guides() -> str:
    """Guides of five lengths, three of each in two orientations, read twice; one has a defect that costs 4 dB."""
    rng = np.random.default_rng(41)
    rows = [
        "# simulated: 1.3 dB/cm flat, 2.1 upright; coupling 5 dB; guides scatter by 0.3 dB; guide 8 is bad",
        "length_mm,power_uW,guide,orientation",
    ]
    number = 0
    for way, loss in LOSSES_DB_PER_CM.items():
        for mm in LENGTHS_MM:
            for _ in range(3):
                number += 1
                level = -5.0 - loss * mm / 10.0 + rng.normal(0.0, 0.3) - (4.0 if number == 8 else 0.0)
                for _ in range(2):
                    power = 800.0 * 10.0 ** ((level + rng.normal(0.0, 0.05)) / 10.0)
                    rows.append(f"{mm},{power:.4g},{number},{way}")
    return "\n".join(rows) + "\n"


TABLES = {"discs-simulated.csv": discs, "guides-simulated.csv": guides}


def main() -> None:
    """Write them all."""
    for name, table in TABLES.items():
        (EXAMPLES / name).write_bytes(table().encode("utf-8"))


if __name__ == "__main__":
    main()

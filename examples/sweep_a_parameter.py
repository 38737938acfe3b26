"""Effect of a decentred emitter on the null: the angle at which both receivers receive the same power.

The lens magnifies the decentre, so a few hundredths of a millimetre shift the null by a large part of a degree.
"""

import numpy as np

from solen.sensor import Sensor
from solen.spec import loads, template, with_values

OFFSETS_MM = (-0.01, 0.0, 0.01, 0.02)
ANGLES_DEG = tuple(float(angle) for angle in np.linspace(-0.8, 0.6, 29))
RAYS = 10_000


def main() -> dict[float, float]:
    """Return the nulls in degrees, keyed by offset in mm; `Sensor.count` traces the number of rays of the design."""
    design, nulls_deg = loads(template("paper-860")), {}
    for offset_mm in OFFSETS_MM:
        sensor = Sensor.of(with_values(design, {"emitter.offset_mm": offset_mm, "emitter.rays": RAYS}))
        null_deg = sensor.count(ANGLES_DEG).null_deg()
        if null_deg is None:
            raise ValueError(f"no null among these angles at {offset_mm} mm")
        nulls_deg[offset_mm] = null_deg
        print(f"offset {offset_mm:+.2f} mm: null at {null_deg:+.3f}°")
    return nulls_deg


if __name__ == "__main__":
    main()

"""Decentre of the emitter: how far it shifts the angle at which both receivers receive the same power.

The lens magnifies the decentre, so a few hundredths of a millimetre shift the balance point by a large part of a
degree.
"""

import numpy as np

from solen.sensor import Sensor
from solen.spec import loads, template, with_values

OFFSETS_MM = (-0.01, 0.0, 0.01, 0.02)
ANGLES_DEG = tuple(float(angle) for angle in np.linspace(-0.8, 0.6, 29))
RAYS = 10_000


def main() -> dict[float, float]:
    """Return the balance point in degrees by offset in mm; `Sensor.count` traces the design's number of rays."""
    design, balance = loads(template("paper-860")), {}
    for offset_mm in OFFSETS_MM:
        sensor = Sensor.of(with_values(design, {"emitter.offset_mm": offset_mm, "emitter.rays": RAYS}))
        null_deg = sensor.count(ANGLES_DEG).null_deg()
        if null_deg is None:
            raise ValueError(f"no balance point among these angles at {offset_mm} mm")
        balance[offset_mm] = null_deg
        print(f"offset {offset_mm:+.2f} mm: balance at {null_deg:+.3f}°")
    return balance


if __name__ == "__main__":
    main()

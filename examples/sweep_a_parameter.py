"""Emitter out of place: how far a decentre moves the angle at which both receivers see the same.

The lens magnifies the decentre, so a few hundredths of a millimetre move the balance point by a good part of a degree.
"""

import numpy as np

from solen.sensor import Sensor
from solen.spec import loads, template, with_values

OFFSETS_MM = (-0.01, 0.0, 0.01, 0.02)
ANGLES_DEG = tuple(float(angle) for angle in np.linspace(-0.8, 0.6, 29))
RAYS = 10_000


def main() -> dict[float, float]:
    """Balance point in degrees by offset in mm; a design's own number of rays is what `Sensor.count` traces."""
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

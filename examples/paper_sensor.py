"""The 860 nm sensor of the paper at -3, 0 and +3 degrees: the fraction of the emitted rays that reaches each receiver.

Rays are counted, as in the paper, but 200 000 instead of 100.
"""

from solen.sensor import Sensor
from solen.spec import loads, template

ANGLES_DEG = (-3.0, 0.0, 3.0)
RAYS = 200_000


def main() -> dict[float, tuple[float, float]]:
    """Return the fractions at the right and left receivers, keyed by angle."""
    sensor = Sensor.of(loads(template("paper-860")))
    fractions = {}
    print(f"{sensor.design.name}: the lens accepts ±{sensor.lens.acceptance_deg:.2f}° of the ±60° of the emitter")
    for angle_deg in ANGLES_DEG:
        detectors = sensor.trace(angle_deg, "count", RAYS).detectors
        right, left = detectors["right"].power, detectors["left"].power
        fractions[angle_deg] = (right, left)
        print(f"{angle_deg:+5.1f}°: right {right:.4f}, left {left:.4f}, total {right + left:.4f}")
    return fractions


if __name__ == "__main__":
    main()

"""The paper's 860 nm sensor at -3, 0 and +3 degrees: the fraction of the emitted rays that reaches each receiver.

Rays are counted, as in the paper, but many more than its 100.
"""

from solen.sensor import Sensor
from solen.spec import loads, template

ANGLES_DEG = (-3.0, 0.0, 3.0)
RAYS = 200_000


def main() -> dict[float, tuple[float, float]]:
    """Return the fractions at the right and the left receiver, by angle."""
    sensor = Sensor.of(loads(template("paper-860")))
    shares = {}
    print(f"{sensor.design.name}: the lens accepts ±{sensor.lens.acceptance_deg:.2f}° of the emitter's ±60°")
    for angle_deg in ANGLES_DEG:
        detectors = sensor.trace(angle_deg, "count", RAYS).detectors
        right, left = detectors["right"].power, detectors["left"].power
        shares[angle_deg] = (right, left)
        print(f"{angle_deg:+5.1f}°: right {right:.4f}, left {left:.4f}, together {right + left:.4f}")
    return shares


if __name__ == "__main__":
    main()

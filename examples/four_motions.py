"""The response depends on what moves: four motions of one sensor with an LED chip 0.2 mm wide.

Lens and emitter turn about the stem's base, or about the emitter; or only the emitter turns; or the stem bends. At the
same angle these give different calibrations: a bend gives about half the signal of the turn about the base.
"""

from typing import Any

from solen.sensor import Sensor
from solen.spec import loads, template, with_values

MOTIONS: dict[str, dict[str, Any]] = {
    "about the stem's base": {"motion.pivot": "stem-base"},
    "about the emitter": {"motion.pivot": "emitter"},
    "the emitter alone": {"motion.moves": ["emitter"]},
    "a bend": {"motion.kind": "bend"},
}
ANGLES_DEG = (-0.5, -1.0, -3.0)
RAYS = 50_000


def main() -> dict[str, tuple[float, ...]]:
    """Return the contrast in power by motion, at each of the angles."""
    chip = with_values(loads(template("paper-860")), {"emitter.width_mm": 0.2, "emitter.rays": RAYS})
    found: dict[str, tuple[float, ...]] = {}
    for name, values in MOTIONS.items():
        sensor = Sensor.of(with_values(chip, values))
        contrasts = []
        for angle_deg in ANGLES_DEG:
            detectors = sensor.trace(angle_deg, "power").detectors
            right, left = detectors["right"].power, detectors["left"].power
            contrasts.append((right - left) / (right + left))
        found[name] = tuple(contrasts)
        print(
            f"{name:22}",
            *(f"{contrast:.3f} at {angle}°" for angle, contrast in zip(ANGLES_DEG, contrasts, strict=True)),
        )
    return found


if __name__ == "__main__":
    main()

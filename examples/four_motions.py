"""The effect of the kind of motion on the response: four motions of a sensor with an LED chip 0.2 mm wide.

Lens and emitter turn about the base of the stem, or about the emitter; or only the emitter turns; or the stem bends.
Each needs its own calibration: a bend gives about half the contrast of a turn about the base by the same angle.
"""

from typing import Any

from solen.sensor import Sensor
from solen.spec import loads, template, with_values

MOTIONS: dict[str, dict[str, Any]] = {
    "about the stem base": {"motion.pivot": "stem-base"},
    "about the emitter": {"motion.pivot": "emitter"},
    "the emitter alone": {"motion.moves": ["emitter"]},
    "a bend": {"motion.kind": "bend"},
}
ANGLES_DEG = (-0.5, -1.0, -3.0)
RAYS = 50_000


def main() -> dict[str, tuple[float, ...]]:
    """Return the contrast in power at each angle, keyed by motion."""
    chip = with_values(loads(template("paper-860")), {"emitter.width_mm": 0.2, "emitter.rays": RAYS})
    results: dict[str, tuple[float, ...]] = {}
    for name, values in MOTIONS.items():
        sensor = Sensor.of(with_values(chip, values))
        contrasts = []
        for angle_deg in ANGLES_DEG:
            detectors = sensor.trace(angle_deg, "power").detectors
            right, left = detectors["right"].power, detectors["left"].power
            contrasts.append((right - left) / (right + left))
        results[name] = tuple(contrasts)
        print(
            f"{name:22}",
            *(f"{contrast:.3f} at {angle}°" for angle, contrast in zip(ANGLES_DEG, contrasts, strict=True)),
        )
    return results


if __name__ == "__main__":
    main()

"""A lens designed for an index of 1.44, printed in a material of 1.484: its focus and the response of the sensor.

Rays near the axis cross the axis far in front of the arms, so the light is spread widely when it reaches the arms and
the response is less steep near the null. At the ends of the motion all light still reaches one side.
"""

from typing import NamedTuple

from solen.lens import OvalLens
from solen.sensor import Sensor
from solen.spec import loads, template, with_values

DESIGN_INDEX, PRINTED_INDEX = 1.44, 1.484
ANGLES_DEG = (-0.25, -1.0, -3.0)
RAYS = 100_000


class Result(NamedTuple):
    """Foci of rays near the axis and at the edge, in mm behind the vertex, and the contrast at each angle."""

    paraxial_mm: float | None
    marginal_mm: float | None
    contrast: tuple[float, ...]


def contrast(sensor: Sensor, angle_deg: float) -> float:
    """Return (R - L) / (R + L) from counted rays."""
    detectors = sensor.trace(angle_deg, "count", RAYS).detectors
    right, left = detectors["right"].power, detectors["left"].power
    return (right - left) / (right + left)


def main() -> dict[float, Result]:
    """Return the foci and the contrast, keyed by the index of the material."""
    design, results = loads(template("paper-860")), {}
    for index in (DESIGN_INDEX, PRINTED_INDEX):
        sensor = Sensor.of(with_values(design, {"material.index": index, "lens.design_index": DESIGN_INDEX}))
        if not isinstance(sensor.lens, OvalLens):
            raise TypeError("the lens of this design is not an oval")
        paraxial, marginal = sensor.lens.paraxial_focus_mm(index), sensor.lens.marginal_focus_mm(index)
        results[index] = Result(paraxial, marginal, tuple(contrast(sensor, angle) for angle in ANGLES_DEG))
        print(f"index {index}: focus of rays near the axis {paraxial:.2f} mm, at the edge {marginal:.2f} mm")
        for angle, value in zip(ANGLES_DEG, results[index].contrast, strict=True):
            print(f"  contrast {value:+.3f} at {angle:+.2f}°")
    return results


if __name__ == "__main__":
    main()

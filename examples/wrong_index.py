"""A lens designed for 1.44 in a material of 1.484: where its focus moves, and how much of the response remains.

Rays near the axis now meet far too early, and the spot between the arms is wide. So the response is flat where it was
steep, near the balance point; at the ends of the motion all light still reaches one side.
"""

from typing import NamedTuple

from solen.lens import OvalLens
from solen.sensor import Sensor
from solen.spec import loads, template, with_values

CUT_FOR, PRINTED = 1.44, 1.484
ANGLES_DEG = (-0.25, -1.0, -3.0)
RAYS = 100_000


class Found(NamedTuple):
    """Focus in mm behind the vertex, near the axis and at the edge; contrast at each angle."""

    paraxial_mm: float | None
    marginal_mm: float | None
    contrast: tuple[float, ...]


def contrast(sensor: Sensor, angle_deg: float) -> float:
    """Return (R - L) / (R + L) from counted rays."""
    found = sensor.trace(angle_deg, "count", RAYS).detectors
    right, left = found["right"].power, found["left"].power
    return (right - left) / (right + left)


def main() -> dict[float, Found]:
    """Return focus and contrast of the lens in the design material and in the other one, by index."""
    design, found = loads(template("paper-860")), {}
    for index in (CUT_FOR, PRINTED):
        sensor = Sensor.of(with_values(design, {"material.index": index, "lens.design_index": CUT_FOR}))
        if not isinstance(sensor.lens, OvalLens):
            raise TypeError("this design has no lens")
        paraxial, marginal = sensor.lens.paraxial_focus_mm(index), sensor.lens.marginal_focus_mm(index)
        found[index] = Found(paraxial, marginal, tuple(contrast(sensor, angle) for angle in ANGLES_DEG))
        print(f"index {index}: focus at {paraxial:.2f} mm near the axis, {marginal:.2f} mm at the edge")
        for angle, value in zip(ANGLES_DEG, found[index].contrast, strict=True):
            print(f"  contrast {value:+.3f} at {angle:+.2f}°")
    return found


if __name__ == "__main__":
    main()

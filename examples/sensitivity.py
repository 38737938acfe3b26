"""Critical dimensions: the sensitivity of the contrast to four dimensions, and the angle error due to each of them.

A change of the contrast due to a wrong dimension is interpreted as a change of the angle. The derivatives include both
changes of the power along each path and light that moves from one receiver to the other.
"""

from solen.sensor import Sensor
from solen.spec import loads, template

KEYS = ("emitter.offset_mm", "body.arm_width_mm", "lens.half_width_mm", "lens.focus_mm")
ANGLE_DEG, ERROR_MM = 0.2, 0.01


def main() -> dict[str, float]:
    """Return the change of the contrast per mm of each dimension."""
    sensor = Sensor.of(loads(template("paper-860")))
    per_deg = sensor.slope_per_deg(ANGLE_DEG)
    if per_deg is None:
        raise ValueError(f"no light at {ANGLE_DEG}°")
    print(f"at {ANGLE_DEG}° the contrast changes by {per_deg.value:+.2f} per degree")
    rows = sensor.sensitivity(KEYS, ANGLE_DEG)
    for row in rows:
        apparent_deg = ERROR_MM * row.contrast.value / per_deg.value
        print(
            f"{row.key:19} {row.contrast.value:+8.3f} per mm: an error of {ERROR_MM} mm is read as {apparent_deg:+.4f}°"
        )
    return {row.key: row.contrast.value for row in rows}


if __name__ == "__main__":
    main()

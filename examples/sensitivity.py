"""Which dimensions matter: the sensitivity of the contrast to three of them, and the angle that an error simulates.

An error of a dimension that changes the contrast is read as an angle. The derivatives include light whose path changes
as well as light that only becomes brighter or darker along its path.
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
        looks_like_deg = ERROR_MM * row.contrast.value / per_deg.value
        print(f"{row.key:19} {row.contrast.value:+8.3f} per mm: {ERROR_MM} mm look like {looks_like_deg:+.4f}°")
    return {row.key: row.contrast.value for row in rows}


if __name__ == "__main__":
    main()

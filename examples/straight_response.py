"""A linear response: the lens of the paper, and a free-form lens found by `solen explore optimise`, in space.

The light source is an LED chip 0.03 mm off the axis. Linearity is the deviation from a straight line as a fraction of
the span.
"""

from solen.explore.merits import Merits, merits_of
from solen.sensor import Response, Sensor
from solen.spec import Design

OFFSET_MM = 0.03
CHIP = {"pattern": "lambertian", "cone_deg": 120.0, "width_mm": 0.2, "height_mm": 0.2}
COMMON = {"material": {"index": 1.44}, "motion": {"step_deg": 0.5}, "trace": {"dimension": "extruded"}}
PAPER = Design(name="lens of the paper", emitter=CHIP, **COMMON)
STRAIGHT = Design(
    name="free-form lens",
    emitter=CHIP | {"distance_mm": 1.506},
    lens={
        "shape": "spline",
        "focus_mm": 50.9,
        "half_width_mm": 2.296,
        "knots_um": [35.2, -13.9, -33.8, -38.9, -2.0, 39.9],
    },
    body={"stem_length_mm": 19.37, "arm_width_mm": 2.812},
    **COMMON,
)
RESPONSES: dict[str, Response] = {}


def main() -> dict[str, Merits]:
    """Return the figures of merit of each design with a decentred emitter."""
    results = {}
    for design in (PAPER, STRAIGHT):
        sensor = Sensor.of(design.set({"emitter.offset_mm": OFFSET_MM}))
        response = RESPONSES[design.name] = sensor.power(tolerance=1e-3)
        merits = results[design.name] = merits_of(response)
        print(
            f"{design.name}: {merits.linearity_percent:.1f} ± {merits.u_linearity_percent:.1f} % from a straight line, "
            f"span {merits.span:.2f}, light {merits.light:.2f}, null at {merits.null_deg:+.2f}°"
        )
    return results


if __name__ == "__main__":
    main()

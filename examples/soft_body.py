"""A soft body under load: the shipped press at 0.3 N, solved by finite elements, and its effect on the light.

The finger indents the stem and bends it. Emitter and lens are fixed, so only the body changes the path of the light.
"""

from solen.sensor import Sensor
from solen.sensor.loaded import Deformation, deform
from solen.spec import loads, template

FORCE_N = 0.3


def main() -> Deformation:
    """Return the deformed body, with the contact of the finger and the strain."""
    result = deform(Sensor.of(loads(template("press-860"))), FORCE_N)
    (finger,) = result.contacts
    print(f"{finger.force_N:.2f} N push the finger {finger.depth_mm:.3f} mm into the {finger.face}")
    print(f"contact at {finger.from_mm:.2f} to {finger.to_mm:.2f} mm, maximum pressure {finger.pressure_MPa:.3f} MPa")
    print(f"maximum strain {100 * result.strain_largest:.1f} %")
    return result


if __name__ == "__main__":
    main()

"""A soft body under load: the shipped press at 0.3 N, solved by finite elements, and the light that it redirects.

The finger dents the stem and bends it. Emitter and lens are held, so only the path of the light changes.
"""

from solen.sensor import Sensor
from solen.sensor.loaded import Deformation, deform
from solen.spec import loads, template

FORCE_N = 0.3


def main() -> Deformation:
    """Return the deformed body, with the contact of the finger and the strain."""
    found = deform(Sensor.of(loads(template("press-860"))), FORCE_N)
    (finger,) = found.contacts
    print(f"{finger.force_N:.2f} N push the finger {finger.depth_mm:.3f} mm into the {finger.face}")
    print(f"at {finger.from_mm:.2f} to {finger.to_mm:.2f} mm, with {finger.pressure_MPa:.3f} MPa at most")
    print(f"largest strain {100 * found.strain_largest:.1f} %")
    return found


if __name__ == "__main__":
    main()

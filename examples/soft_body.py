"""A soft body under load: the shipped press at 0.3 N, solved by finite elements, and the light that it moves.

The finger dents the stem and bends it. Emitter and lens are held, so that only the way of the light changes.
"""

from solen.sensor import Sensor
from solen.sensor.loaded import Deformation, deform
from solen.spec import loads, template

FORCE_N = 0.3


def main() -> Deformation:
    """The deformed body: where the finger touches it, and how far it is strained."""
    found = deform(Sensor.of(loads(template("press-860"))), FORCE_N)
    (finger,) = found.contacts
    print(f"{finger.force_N:.2f} N push the finger {finger.depth_mm:.3f} mm into the {finger.face}")
    print(f"at {finger.from_mm:.2f} to {finger.to_mm:.2f} mm, with {finger.pressure_MPa:.3f} MPa at most")
    print(f"largest strain {100 * found.strain_largest:.1f} %")
    return found


if __name__ == "__main__":
    main()

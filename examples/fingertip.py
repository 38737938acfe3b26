"""A fingertip sensor: from a force at its side to volts, and what a mount makes of it.

A soft Y is pressed by a damp finger at the side of its stem. Where the mount holds all of the arms, the stem dents and
the light stays where it was; where it holds their ends alone, the whole body bends and the light moves from one
receiver to the other. Prints the contrast at 0.3 N for both, and for the better one the volts against the force.
"""

from solen import Sensor
from solen.sensor.loaded import LoadedStudy, loaded_study
from solen.spec import loads, template

MOUNTS = {"all of the arms": "outer-*", "the ends of the arms": "receiver-*"}
FORCES_N = (0.0, 0.15, 0.3)


def studied(face: str) -> LoadedStudy:
    """Response of the shipped design against the force, its mount on some faces."""
    design = loads(template("press-860")).set({"hold[0].face": face, "motion.forces_N": FORCES_N})
    return loaded_study(Sensor.of(design))


def main() -> dict[str, LoadedStudy]:
    """Compare the mounts, and print the better one's volts."""
    found = {name: studied(face) for name, face in MOUNTS.items()}
    for name, study in found.items():
        print(f"held by {name}: contrast {study.contrast[-1]:+.3f} at 0.3 N, strain {study.strain_largest[-1]:.3f}")
    best = max(found, key=lambda name: abs(found[name].contrast[-1]))
    print(f"volts, held by {best}")
    for force, (right, left) in zip(FORCES_N, found[best].voltage_V, strict=True):
        print(f"  {force:.2f} N: right {right:.3f} V, left {left:.3f} V")
    return found


if __name__ == "__main__":
    main()

"""What is explored: a sensor, its design, or a design file.

The interface: `Subject` and `design_of` it.
"""

from pathlib import Path

from solen.errors import SpecError
from solen.sensor import Sensor
from solen.spec import Design, load

Subject = Sensor | Design | Path | str


def design_of(subject: Subject) -> Design:
    """Design of a subject.

    Raises
    ------
    SpecError
        Where the file is not a valid design, or a sensor is not as designed: explored are designs, and what else a
        sensor has would be lost.
    """
    if isinstance(subject, Design):
        return subject
    if not isinstance(subject, Sensor):
        return load(subject)
    if Sensor.of(subject.design) != subject:
        limit = "has another lens or material than its design, and designs are explored"
        raise SpecError("sensor", value=subject.design.name, limit=limit, remedy="set the values in its design")
    return subject.design

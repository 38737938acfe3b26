"""The subject of an exploration: a sensor, its design, or a design file.

Public names: `Subject` and `design_of`.
"""

from pathlib import Path

from solen.errors import SpecError
from solen.sensor import Sensor
from solen.spec import Design, load

Subject = Sensor | Design | Path | str


def design_of(subject: Subject) -> Design:
    """Return the design of a subject.

    Raises
    ------
    SpecError
        If the file is not a valid design, or a sensor differs from its design, since the difference would be lost.
    """
    if isinstance(subject, Design):
        return subject
    if not isinstance(subject, Sensor):
        return load(subject)
    if Sensor.of(subject.design) != subject:
        limit = "has a lens or a material that differs from its design, and only designs can be explored"
        raise SpecError("sensor", value=subject.design.name, limit=limit, remedy="set the values in its design")
    return subject.design

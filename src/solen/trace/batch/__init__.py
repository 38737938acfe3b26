"""Many designs at many angles and places of the emitter in one call of compiled code.

`solen.trace.batch.y` makes the tables of a Y from a design's numbers, `launch` its rays, and the kernel that traces any
scene traces them; `places` turns powers by place into those of any chip.
"""

from solen.trace.batch.launch import Light
from solen.trace.batch.lot import DOUBLE, Bins, Found, Lot, Sensors, empty_sums
from solen.trace.batch.y import AT_BASE, AT_EMITTER, AT_POINT, FLAT, PIECES, SOUND, UNSURE, WHOLE_OVAL, Y

__all__ = [
    "AT_BASE",
    "AT_EMITTER",
    "AT_POINT",
    "DOUBLE",
    "FLAT",
    "PIECES",
    "SOUND",
    "UNSURE",
    "WHOLE_OVAL",
    "Bins",
    "Found",
    "Light",
    "Lot",
    "Sensors",
    "Y",
    "empty_sums",
]

"""Many designs at many angles and places of the emitter in one call of compiled code.

The kernel makes the tables of a Y from a design's numbers (`solen.trace.kernel.y_tables`) and its rays
(`solen.trace.kernel.lattices`), and traces them as those of any scene. `Lot` is the room for a design at all its angles
and places; `places` turns powers by place into those of any chip.
"""

from solen.trace.batch.lot import DOUBLE, Found, Lot, empty_sums
from solen.trace.kernel.lattices import Light
from solen.trace.kernel.lots import Bins, Sensors
from solen.trace.kernel.y_tables import AT_BASE, AT_EMITTER, AT_POINT, FLAT, PIECES, SOUND, UNSURE, WHOLE_OVAL, Y

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

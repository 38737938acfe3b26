"""Many designs at many angles and emitter positions in one call of compiled code.

The kernel computes the tables of a Y from a design's numbers (`solen.trace.kernel.y_tables`) and its rays
(`solen.trace.kernel.lattices`), and traces them like those of any scene. `Lot` allocates the arrays for a design at all
its angles and positions; `places` converts powers by position into those of any chip.
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

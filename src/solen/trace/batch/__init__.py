"""Many designs at many angles and emitter positions in one call of compiled code.

The kernel computes the tables of a Y from a design's numbers (`solen.trace.kernel.y_tables`) and its rays
(`solen.trace.kernel.lattices`), and traces them like those of any scene. `DesignBatch` allocates the arrays for a
design at all its angles and positions; `places` converts powers by position into those of any chip.
"""

from solen.trace.batch.design_batch import DOUBLE, DesignBatch, Found
from solen.trace.kernel.designs import Bins, Sensors
from solen.trace.kernel.lattices import Light
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
    "DesignBatch",
    "Found",
    "Light",
    "Sensors",
    "Y",
]

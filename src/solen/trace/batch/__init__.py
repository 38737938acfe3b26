"""Many designs at many angles and emitter positions in one call of compiled code.

The kernel computes the tables of a Y from the design's parameters (`solen.trace.kernel.y_tables`) and launches the rays
(`solen.trace.kernel.lattices`), which are traced like those of any other scene. `DesignBatch` allocates the arrays for
one design at all angles and positions; `position_bins` converts powers by emitter position into powers for any chip.
"""

from solen.trace.batch.design_batch import DOUBLE, BatchPowers, DesignBatch
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
    "BatchPowers",
    "Bins",
    "DesignBatch",
    "Light",
    "Sensors",
    "Y",
]

"""From shares of light to the voltages of a recording: a straight line for each receiver, and its load line's bend.

Light I pulls a receiver's voltage down by gain times I, until the transistor has no voltage left. The bend is that of
`solen.readout.load_line`, and there only where the circuit is known. Voltages less those without the emitter begin at
0, others at the supply; an offset of each receiver takes up whichever it is.

The interface: `Bend`, and `volts` of shares.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.readout import Circuit
from solen.readout.transistor import load_line

_OHM = 1e3  # so that mA are V


@dataclass(frozen=True)
class Bend:
    """Load line of every receiver.

    Attributes
    ----------
    supply_V, saturation_V, knee_V
        As in `solen.readout.load_line`.
    room_V
        By how much the light of the room pulls each receiver down, (r,).
    """

    supply_V: float
    saturation_V: float
    knee_V: float
    room_V: tuple[float, ...]

    @classmethod
    def of(cls, circuit: Circuit, room_V: tuple[float, ...]) -> "Bend":
        """Bend of a circuit in the light of a room."""
        part = circuit.transistor
        return cls(circuit.supply_V, part.saturation_V, part.knee_V, room_V)

    def __call__(self, pulled_V: FloatArray) -> FloatArray:
        """How far the voltages (n, r) go down where a straight line would have them go down by ``pulled_V``."""
        room = np.maximum(np.array(self.room_V), 0.0)
        pulled = np.maximum(pulled_V + room, 0.0)
        line = (self.supply_V, self.saturation_V, self.knee_V)
        down = load_line(np.vstack([room, pulled]), _OHM, *line).volts
        return np.asarray(down[0] - down[1:] + np.minimum(pulled_V + room, 0.0))


def volts(shares: FloatArray, gain_V: FloatArray, offset_V: FloatArray, bend: Bend | None) -> FloatArray:
    """Voltages (n, r) of shares (n, r), by gains and offsets (r,)."""
    pulled = shares * gain_V
    return np.asarray(offset_V - (pulled if bend is None else bend(pulled)))

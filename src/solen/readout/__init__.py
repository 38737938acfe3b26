"""From received light to volts: each receiver is a phototransistor that pulls a load resistor down from the supply.

The idea: a trace gives fractions of the emitted power at the receivers' faces. The emitter's current makes them mW, the
face's area an irradiance, the part's sensitivity a current, the load a voltage, and the converter a number. **Brighter
is a lower voltage.** Each step is a formula with its source; noise is a formula first and drawn from it second.

The interface: `circuit_of` a design with the areas of its receivers' faces (`face_areas_mm2`); `volts` of power
fractions over time; `noise` by where it comes from; `advise` on the load; `readings_of` all of it
over a motion. `solen.readout.transistor` holds the load
line, `solen.readout.adc` the converter, `solen.readout.emitter` the power of the emitter.
"""

from solen.readout.adc import Adc
from solen.readout.advice import Setting, advise
from solen.readout.circuit import Circuit, circuit_of, face_areas_mm2, spread
from solen.readout.emitter import Drive
from solen.readout.noise import noise
from solen.readout.readings import Readings, readings_of
from solen.readout.samples import noisy, settled, volts
from solen.readout.transistor import Phototransistor

__all__ = [
    "Adc",
    "Circuit",
    "Drive",
    "Phototransistor",
    "Readings",
    "Setting",
    "advise",
    "circuit_of",
    "face_areas_mm2",
    "noise",
    "noisy",
    "readings_of",
    "settled",
    "spread",
    "volts",
]

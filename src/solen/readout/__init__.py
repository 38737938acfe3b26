"""From received light to voltage: each receiver is a phototransistor that pulls a load resistor down from the supply.

The idea: a trace gives fractions of the emitted power at the receivers' faces. The emitter's current turns them into
mW, the face's area into an irradiance, the part's sensitivity into a current, the load into a voltage, the converter
into a number. **Brighter is a lower voltage.** Each step is a formula with its source; noise is computed by formula,
then drawn from it.

The interface: `circuit_of` a design with the areas of its receivers' faces (`face_areas_mm2`); `volts` of power
fractions over time; `noise` by source; `advise` on the load; `readings_of` combines all of it
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

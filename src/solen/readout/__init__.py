"""Conversion of light to voltage: each receiver is a phototransistor that pulls a load resistor down from the supply.

A trace gives the fractions of the emitted power that reach the receivers' faces. The emitter current converts these
fractions to mW, the face area to irradiance, the part's sensitivity to current, the load to voltage, and the converter
to a number. **Brighter is a lower voltage.** Each step is a formula with its source. Noise is calculated by formula and
then drawn at random.

Public names: `circuit_of`, `face_areas_mm2`, `volts`, `noise`, `advise` and `readings_of`.
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

"""Conversion of light to voltage: each receiver is a phototransistor that pulls a load resistor down from the supply.

A trace gives the fractions of the emitted power that reach the receivers' faces. The emitter power converts them to mW,
the face area to irradiance, the receiver's sensitivity to current, the load to voltage, and the ADC to a code.
**Brighter is a lower voltage.** Noise is calculated by formula and then sampled at random.

Public names: `circuit_of`, `face_areas_mm2`, `volts`, `noise`, `advise` and `readings_of`.
"""

from solen.readout.adc import Adc
from solen.readout.advice import Setting, advise
from solen.readout.circuit import Circuit, cases_of, circuit_of, face_areas_mm2
from solen.readout.emitter import Drive
from solen.readout.noise import noise
from solen.readout.readings import Readings, readings_of
from solen.readout.samples import lagged, noisy_readings, volts
from solen.readout.transistor import Phototransistor

__all__ = [
    "Adc",
    "Circuit",
    "Drive",
    "Phototransistor",
    "Readings",
    "Setting",
    "advise",
    "cases_of",
    "circuit_of",
    "face_areas_mm2",
    "lagged",
    "noise",
    "noisy_readings",
    "readings_of",
    "volts",
]

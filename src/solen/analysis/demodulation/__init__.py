"""Subtraction of ambient light: emitters switch on and off, and the light measured while they are off is subtracted.

Samples are grouped into slots, i.e. runs with a constant emitter state (`slots_of`). Each "on" slot gives a reading:
its mean minus the ambient light at the same time, interpolated linearly between the "off" slots before and after it
(`subtract`). Without a state column, the slots are detected in the waveform itself (`find_clock`). The remaining
ambient light at any frequency is given by a formula (`solen.analysis.demodulation.rejection`). No filter is applied
unless requested: `averaged` computes means over whole mains periods.

`demodulated` applies all steps to a recording.
"""

from solen.analysis.demodulation.average import averaged, readings_per_mains
from solen.analysis.demodulation.clock import Clock, find_clock
from solen.analysis.demodulation.demodulate import Demodulation, demodulated, readings_csv
from solen.analysis.demodulation.rejection import Kernel, gain, rejection_dB
from solen.analysis.demodulation.samples import DEFAULT_SETTLE_US, DemodulationOptions
from solen.analysis.demodulation.slots import DROPPED, OFF, slots_of
from solen.analysis.demodulation.subtract import Demodulated, subtract

__all__ = [
    "DEFAULT_SETTLE_US",
    "DROPPED",
    "OFF",
    "Clock",
    "Demodulated",
    "Demodulation",
    "DemodulationOptions",
    "Kernel",
    "averaged",
    "demodulated",
    "find_clock",
    "gain",
    "readings_csv",
    "readings_per_mains",
    "rejection_dB",
    "slots_of",
    "subtract",
]

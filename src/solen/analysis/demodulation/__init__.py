"""Subtraction of ambient light: emitters switch on and off, and the light while they are off is subtracted.

The idea: samples are gathered into slots, runs of one state of the emitters (`slots_of`). Each on slot gives a reading:
its mean less the ambient light at its time, on the straight line between the off slots before and after it
(`subtract`). Without a column of states the slots are found in the waveform itself (`find_clock`). What the subtraction
lets through at a frequency is a formula (`solen.analysis.demodulation.rejection`). No filter runs unless asked for:
`averaged` takes the mean over whole periods of the mains.

`demodulated` does all of it to a recording.
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

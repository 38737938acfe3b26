"""Recordings of a sensor in motion: cycles, response and figures of merit.

`study` reads files into a `Study`. Its steps are `waveforms`, which returns the voltages of a recording; `find_motion`,
which finds ramps, holds and cycles of an angle; `sensor_response`, which analyses a sensor's `Signals`; and `group_of`,
which compares sensors. Voltages are analysed as recorded: no filter is applied unless requested. For switched emitters,
`solen.analysis.demodulation` first subtracts the ambient light.
"""

from solen.analysis.figures_of_merit import ReceiverResponse
from solen.analysis.motion import find_motion
from solen.analysis.run import Run
from solen.analysis.sensor_response import AnalysisOptions, SensorResponse, group_of, sensor_response
from solen.analysis.signals import SignalOptions, Signals, Waveforms
from solen.analysis.study import Study, study
from solen.analysis.timebase import time_base
from solen.analysis.waveforms import waveforms

__all__ = [
    "AnalysisOptions",
    "ReceiverResponse",
    "Run",
    "SensorResponse",
    "SignalOptions",
    "Signals",
    "Study",
    "Waveforms",
    "find_motion",
    "group_of",
    "sensor_response",
    "study",
    "time_base",
    "waveforms",
]

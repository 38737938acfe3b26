"""Recordings of a sensor under a motion: their cycles, the response and its figures of merit.

`study` reads files into a `Study`. Its steps are `waveforms` of a recording, `find_motion` (ramps, holds and cycles of
an angle), `sensor_response` of a sensor's `Signals`, and `group_of` sensors. Voltages are analysed as recorded: no
filter is applied unless requested. For switched emitters, `solen.analysis.demodulation` first subtracts the ambient
light.
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

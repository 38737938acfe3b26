"""What recordings of a sensor under a motion mean: cycles, the response and its numbers.

`time_base` orders samples, `find_motion` finds ramps, holds and cycles in an angle, `analysed` makes the response of a
sensor of its `Signals`, and `beside` puts sensors side by side. Voltages are analysed as they were recorded: no filter
runs unless it is asked for. Of emitters that switch, `solen.analysis.demodulation` takes the ambient light out first.
"""

from solen.analysis.motion import Cycle, Motion, Ramp, find_motion
from solen.analysis.response import Curve, Passes
from solen.analysis.signals import Signals, pair, side_of, smoothed
from solen.analysis.study import Analysed, Group, Run, Settings, analysed, beside
from solen.analysis.timebase import TimeBase, time_base

__all__ = [
    "Analysed",
    "Curve",
    "Cycle",
    "Group",
    "Motion",
    "Passes",
    "Ramp",
    "Run",
    "Settings",
    "Signals",
    "TimeBase",
    "analysed",
    "beside",
    "find_motion",
    "pair",
    "side_of",
    "smoothed",
    "time_base",
]

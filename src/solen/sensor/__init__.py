"""One design under its motion, as plain calls: lens, body, scene, trace, response.

A :class:`Sensor` is a design with what follows from it at once; a :class:`Response` is what its receivers see over the
angles of a sweep; a :class:`Study` is all of it, counted and in power, with the lens and without. A
:class:`Sensitivity` is how its receivers answer to one number of the design; a :class:`Practice` is how its response
compares with those of a real chip, in space, moved and in another index; a :class:`Printed` is what a lens as it was
printed does to it.
"""

from solen.sensor.budget import Budget
from solen.sensor.idle import idle_keys
from solen.sensor.off_index import OffIndex
from solen.sensor.practice import Extent, InSpace, NullShift, Practice, practice
from solen.sensor.printed import Comparison, Printed, printed
from solen.sensor.response import SATURATED, Response, Sensitivity, Shift
from solen.sensor.sensor import CHIP_TOLERANCE, OPTICAL_KEYS, SLOPE_DEG, TOLERANCE, Sensor, TraceOptions
from solen.sensor.study import Case, Study, study

__all__ = [
    "CHIP_TOLERANCE",
    "OPTICAL_KEYS",
    "SATURATED",
    "SLOPE_DEG",
    "TOLERANCE",
    "Budget",
    "Case",
    "Comparison",
    "Extent",
    "InSpace",
    "NullShift",
    "OffIndex",
    "Practice",
    "Printed",
    "Response",
    "Sensitivity",
    "Sensor",
    "Shift",
    "Study",
    "TraceOptions",
    "idle_keys",
    "practice",
    "printed",
    "study",
]

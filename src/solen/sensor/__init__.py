"""One design under its motion, as plain calls: lens, body, scene, trace, response, readings.

A :class:`Sensor` is a design with what follows from it at once; a :class:`Response` is what its receivers get over the
angles of a motion; `readings` are their volts; a :class:`DesignStudy` is all of it, counted and in power, with the lens
and without. A :class:`Sensitivity` is the derivative by one number of the design; a :class:`Practice` compares the
response with those of a real chip, in space, decentred and in another index; an :class:`AsPrinted` with that of the
lens as printed.
"""

from solen.sensor.as_printed import AsPrinted, Comparison, as_printed
from solen.sensor.budget import Budget, budget
from solen.sensor.check import BodySizes, Check, Focus, LensCheck, LensOptions, check, lens_check
from solen.sensor.index_offset import IndexOffset, index_offsets
from solen.sensor.practice import Extent, InSpace, NullShift, Practice, practice
from solen.sensor.readings import Acceptance, readings, received
from solen.sensor.response import SATURATED, Response, Sensitivity, Shift
from solen.sensor.sensor import OPTICAL_KEYS, SLOPE_DEG, Sensor, TraceKeywords
from solen.sensor.study import Case, DesignStudy, Summary, study
from solen.sensor.unused_keys import keys_without_effect

__all__ = [
    "OPTICAL_KEYS",
    "SATURATED",
    "SLOPE_DEG",
    "Acceptance",
    "AsPrinted",
    "BodySizes",
    "Budget",
    "Case",
    "Check",
    "Comparison",
    "DesignStudy",
    "Extent",
    "Focus",
    "InSpace",
    "IndexOffset",
    "LensCheck",
    "LensOptions",
    "NullShift",
    "Practice",
    "Response",
    "Sensitivity",
    "Sensor",
    "Shift",
    "Summary",
    "TraceKeywords",
    "as_printed",
    "budget",
    "check",
    "index_offsets",
    "keys_without_effect",
    "lens_check",
    "practice",
    "readings",
    "received",
    "study",
]

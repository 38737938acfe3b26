"""One design under its motion, as function calls: lens, body, scene, trace, response, readings.

A :class:`Sensor` is a design with its material and lens; a :class:`Response` is the power at its receivers over the
angles of a motion; `readings` returns the receivers' voltages; a :class:`DesignStudy` contains the response with and
without the lens. A :class:`Sensitivity` is the derivative with respect to a number of the design; an :class:`Effect` is
the change due to the tolerance of a number; a :class:`Practice` describes the sensor as built; an :class:`AsPrinted`
compares the printed with the designed lens.
"""

from solen.sensor.acceptance import Acceptance
from solen.sensor.as_printed import AsPrinted, Comparison, as_printed
from solen.sensor.batch_input import batch_input, why_not_batched
from solen.sensor.batched import Responses, respond
from solen.sensor.budget import Budget, budget
from solen.sensor.check import BodySizes, Check, Focus, LensCheck, LensOptions, check, lens_check
from solen.sensor.derivatives import SLOPE_DEG
from solen.sensor.effects import Effect
from solen.sensor.lens_choice import LensChoice, LensFigures
from solen.sensor.numbers import OPTICAL_KEYS, tolerance_of, why_inert
from solen.sensor.picture import Picture, dragged, in_plane, picture
from solen.sensor.practice import Built, Extent, Practice, as_built, practice
from solen.sensor.readings import readings, received
from solen.sensor.response import SATURATION_CONTRAST, Response, Sensitivity, Shift
from solen.sensor.sensor import Sensor, TraceKeywords
from solen.sensor.study import Case, DesignStudy, Summary, study
from solen.sensor.unused_keys import keys_without_effect

__all__ = [
    "OPTICAL_KEYS",
    "SATURATION_CONTRAST",
    "SLOPE_DEG",
    "Acceptance",
    "AsPrinted",
    "BodySizes",
    "Budget",
    "Built",
    "Case",
    "Check",
    "Comparison",
    "DesignStudy",
    "Effect",
    "Extent",
    "Focus",
    "LensCheck",
    "LensChoice",
    "LensFigures",
    "LensOptions",
    "Picture",
    "Practice",
    "Response",
    "Responses",
    "Sensitivity",
    "Sensor",
    "Shift",
    "Summary",
    "TraceKeywords",
    "as_built",
    "as_printed",
    "batch_input",
    "budget",
    "check",
    "dragged",
    "in_plane",
    "keys_without_effect",
    "lens_check",
    "picture",
    "practice",
    "readings",
    "received",
    "respond",
    "study",
    "tolerance_of",
    "why_inert",
    "why_not_batched",
]

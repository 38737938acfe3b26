"""Diagnosis: parameters of a sensor from its recording.

The idea: the traced response of a design, for an emitter of any decentre and any chip, is fitted to the mean curves of
a recording. Each number comes with its interval from the scatter of the cycles, from what is known beforehand and from
what the model misses, and what the recording does not determine is described in words in place of a number.

The interface: `diagnosed_sensors` of a `Study`; its steps `Response.of` a design's sensor and `diagnosed` of a
`SensorResponse`, which gives a `Diagnosis`; `words` states it in sentences.
"""

from solen.analysis.diagnosis.curve_model import Bend, Model
from solen.analysis.diagnosis.design_response import Change, Response
from solen.analysis.diagnosis.diagnose import Diagnosis, diagnosed
from solen.analysis.diagnosis.least_squares import Cycles, fit
from solen.analysis.diagnosis.response_table import Table
from solen.analysis.diagnosis.sensors import DiagnosisOptions, SensorDiagnoses, diagnosed_sensors
from solen.analysis.diagnosis.summary import advice, words

__all__ = [
    "Bend",
    "Change",
    "Cycles",
    "Diagnosis",
    "DiagnosisOptions",
    "Model",
    "Response",
    "SensorDiagnoses",
    "Table",
    "advice",
    "diagnosed",
    "diagnosed_sensors",
    "fit",
    "words",
]

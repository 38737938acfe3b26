"""Diagnosis: parameters of a sensor from its recording.

The idea: the traced response of a design, for an emitter of any decentre and any chip, is fitted to the mean curves of
a recording. Each number comes with its interval from the scatter of the cycles, from what is known beforehand and from
what the model misses, and what the recording does not determine is described in words in place of a number.

The interface: `diagnosed_sensors` of a `Study`; its steps `Response.of` a design's sensor and `diagnosed` of a
`SensorResponse`, which gives a `Diagnosis`; `words` states it in sentences.
"""

from solen.analysis.diagnosis.curve_model import Bend, Model, Parameter
from solen.analysis.diagnosis.design_response import Change, Response
from solen.analysis.diagnosis.diagnose import (
    BEYOND_DEG,
    INDEX_U,
    ZERO_U_DEG,
    Diagnosis,
    ParameterEstimate,
    diagnosed,
)
from solen.analysis.diagnosis.least_squares import Cycles, Fitted, Misfit, fit
from solen.analysis.diagnosis.response_table import Table
from solen.analysis.diagnosis.sensors import DiagnosisOptions, SensorDiagnoses, SensorDiagnosis, diagnosed_sensors
from solen.analysis.diagnosis.summary import advice, words

__all__ = [
    "BEYOND_DEG",
    "INDEX_U",
    "ZERO_U_DEG",
    "Bend",
    "Change",
    "Cycles",
    "Diagnosis",
    "DiagnosisOptions",
    "Fitted",
    "Misfit",
    "Model",
    "Parameter",
    "ParameterEstimate",
    "Response",
    "SensorDiagnoses",
    "SensorDiagnosis",
    "Table",
    "advice",
    "diagnosed",
    "diagnosed_sensors",
    "fit",
    "words",
]

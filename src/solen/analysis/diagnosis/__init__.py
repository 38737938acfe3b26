"""Diagnosis: design parameters of a sensor, determined from a recording.

The traced response of a design, for an emitter of any decentre and chip width, is fitted to the mean curves of a
recording. The interval of each parameter includes the scatter of the cycles, prior knowledge and the misfit of the
model. For a parameter that the recording does not determine, there is an explanation instead of a number.

Public name: `diagnosed_sensors`. Its steps are `Response.of`, which traces the response of a design, and `diagnosed`,
which fits it to a `SensorResponse` and returns a `Diagnosis`; `words` describes the diagnosis in sentences.
"""

from solen.analysis.diagnosis.curve_model import LoadLines, Model
from solen.analysis.diagnosis.design_response import Change, Response
from solen.analysis.diagnosis.diagnose import Diagnosis, diagnosed
from solen.analysis.diagnosis.least_squares import Cycles, fit
from solen.analysis.diagnosis.response_table import Table
from solen.analysis.diagnosis.sensors import DiagnosisOptions, SensorDiagnoses, diagnosed_sensors
from solen.analysis.diagnosis.summary import advice, words

__all__ = [
    "Change",
    "Cycles",
    "Diagnosis",
    "DiagnosisOptions",
    "LoadLines",
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

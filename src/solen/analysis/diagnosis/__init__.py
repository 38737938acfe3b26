"""Diagnosis: what a recording says of the sensor that made it.

The idea: the traced response of a design, for an emitter of any decentre and any chip, is fitted to the mean curves of
a recording. Each number comes with its interval from the scatter of the cycles, from what is known beforehand and from
what the model misses, and what the recording does not determine is said in words in place of a number.

The interface: `Response.of` a sensor, `diagnosed` of an analysed recording gives a `Diagnosis`; `words` says it.
"""

from solen.analysis.diagnosis.diagnose import BEYOND_DEG, INDEX_U, ZERO_U_DEG, Diagnosis, Estimate, diagnosed
from solen.analysis.diagnosis.fit import Cycles, Fitted, Misfit, fit
from solen.analysis.diagnosis.model import Model, Parameter
from solen.analysis.diagnosis.response import Change, Response
from solen.analysis.diagnosis.table import Table
from solen.analysis.diagnosis.voltage import Bend
from solen.analysis.diagnosis.words import advice, words

__all__ = [
    "BEYOND_DEG",
    "INDEX_U",
    "ZERO_U_DEG",
    "Bend",
    "Change",
    "Cycles",
    "Diagnosis",
    "Estimate",
    "Fitted",
    "Misfit",
    "Model",
    "Parameter",
    "Response",
    "Table",
    "advice",
    "diagnosed",
    "fit",
    "words",
]

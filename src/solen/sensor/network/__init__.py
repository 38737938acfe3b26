"""Networks of guides: check, powers by emitter and receiver, readings, slopes, and which motions can be distinguished.

The emitters are lit in turn. With one emitter lit and the motions at given angles, a network can be traced like a
sensor with a single emitter, so it is represented by one such sensor per emitter. Powers are fractions of the power of
the lit emitter.
"""

from solen.sensor.network.check import NetworkCheck, NetworkEmitter, NetworkLens, network_check
from solen.sensor.network.motions import Combination, Determination, determined
from solen.sensor.network.response import (
    DEFAULT_TOLERANCE,
    NetworkResponse,
    NetworkTrace,
    check_single_emitter_options,
    emitter_sensors,
    network_response,
    network_trace,
    reading_warnings,
)
from solen.sensor.network.signals import Signals, circuits_of, network_signals
from solen.sensor.network.slopes import NetworkSensitivities, network_sensitivities, worst_sd_deg
from solen.sensor.network.study import NetworkStudy, motion_states, network_study

__all__ = [
    "DEFAULT_TOLERANCE",
    "Combination",
    "Determination",
    "NetworkCheck",
    "NetworkEmitter",
    "NetworkLens",
    "NetworkResponse",
    "NetworkSensitivities",
    "NetworkStudy",
    "NetworkTrace",
    "Signals",
    "check_single_emitter_options",
    "circuits_of",
    "determined",
    "emitter_sensors",
    "motion_states",
    "network_check",
    "network_response",
    "network_sensitivities",
    "network_signals",
    "network_study",
    "network_trace",
    "reading_warnings",
    "worst_sd_deg",
]

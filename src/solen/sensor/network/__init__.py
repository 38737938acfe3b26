"""Networks of guides: check, powers by emitter and receiver, readings, slopes, and which motions can be distinguished.

With one emitter lit and the motions at given angles, a network is a sensor like any other: its response consists of one
sensor per emitter. Powers are fractions of the power emitted by the lit emitter.
"""

from solen.sensor.network.check import EmitterOfNetwork, LensOfNetwork, NetworkCheck, network_check
from solen.sensor.network.motions import Combination, Determination, determined
from solen.sensor.network.response import (
    USUAL_TOLERANCE,
    NetworkResponse,
    NetworkTrace,
    in_turn,
    network_response,
    network_trace,
    refuse_in_turn,
    unread_in,
)
from solen.sensor.network.signals import Signals, circuits_of, network_signals
from solen.sensor.network.slopes import NetworkSensitivities, network_sensitivities, worst_sd_deg
from solen.sensor.network.study import NetworkStudy, courses, network_study

__all__ = [
    "USUAL_TOLERANCE",
    "Combination",
    "Determination",
    "EmitterOfNetwork",
    "LensOfNetwork",
    "NetworkCheck",
    "NetworkResponse",
    "NetworkSensitivities",
    "NetworkStudy",
    "NetworkTrace",
    "Signals",
    "circuits_of",
    "courses",
    "determined",
    "in_turn",
    "network_check",
    "network_response",
    "network_sensitivities",
    "network_signals",
    "network_study",
    "network_trace",
    "refuse_in_turn",
    "unread_in",
    "worst_sd_deg",
]

"""Recorded networks: the powers of every emitter and receiver over several motions, and motions decoded from them.

The emitters of a network are switched on in sequence, so a reading is a matrix (emitters × receivers). It is averaged
over each stop of a recording (`states`). A forward map, i.e. the readings as smooth functions of the motions, is fitted
to the stops (`forward`). A reading is decoded by weighted least squares, with the covariance of its noise and of the
map error (`decoder`).

Public names: `network_readings`, `analysed_network`, `calibrated_network` and `NetworkDecoder`.
"""

from solen.analysis.network.calibrate import NetworkCalibrations, calibrated_network
from solen.analysis.network.decoder import NetworkDecoded, NetworkDecoder
from solen.analysis.network.file import NetworkCalibration, load_network
from solen.analysis.network.recorded import NetworkReadings, is_network, network_readings
from solen.analysis.network.states import NetworkStates, analysed_network
from solen.analysis.network.stream_decoder import NetworkDecoding

__all__ = [
    "NetworkCalibration",
    "NetworkCalibrations",
    "NetworkDecoded",
    "NetworkDecoder",
    "NetworkDecoding",
    "NetworkReadings",
    "NetworkStates",
    "analysed_network",
    "calibrated_network",
    "is_network",
    "load_network",
    "network_readings",
]

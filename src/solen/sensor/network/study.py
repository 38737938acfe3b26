"""Response of a network over the range of each of its motions."""

import math
from collections.abc import Sequence
from dataclasses import field, replace

import numpy as np

from solen.progress import Progress
from solen.results import HIDDEN, Result, reported
from solen.sensor.network.check import NetworkCheck, network_check
from solen.sensor.network.response import (
    DEFAULT_TOLERANCE,
    NetworkResponse,
    emitter_sensors,
    network_response,
    reading_warnings,
)
from solen.sensor.sensor import Sensor
from solen.spec import Design
from solen.spec.network import Network


class NetworkStudy(Result):
    """Response of a network over the range of each of its motions, with the others at rest.

    Attributes
    ----------
    design
        The design studied.
    check
        Its check.
    at_rest
        Response with all motions at rest.
    sweeps
        Response over the range of each motion, keyed by the motion's name.
    warnings
        Reasons for uncertainty.
    simulated
        Always true.
    """

    sensors: tuple[Sensor, ...] = field(metadata=HIDDEN)
    design: Design
    check: NetworkCheck
    at_rest: NetworkResponse
    sweeps: dict[str, NetworkResponse]
    warnings: tuple[str, ...]
    simulated: bool = True

    @reported
    def name(self) -> str:
        """Name of the design."""
        return self.design.name


def network_study(
    design: Design, progress: Progress | None = None, tolerance: float = DEFAULT_TOLERANCE
) -> NetworkStudy:
    """Return the response of a network at rest and over the range of each of its motions; see `network_response`."""
    check, sensors = network_check(design), emitter_sensors(design)
    states, indices = motion_states(design.network)
    response = network_response(design, states, tolerance, progress)
    sweeps = {name: _subset(response, part) for name, part in indices.items()}
    return NetworkStudy(
        sensors=sensors,
        design=design,
        check=check,
        at_rest=_subset(response, [0]),
        sweeps=sweeps,
        warnings=(*check.warnings, *_uncertainty_warnings(response, design), *reading_warnings(response)),
    )


def motion_states(network: Network) -> tuple[list[dict[str, float]], dict[str, list[int]]]:
    """Return the states of all motions over their ranges, rest first, and their indices, keyed by motion."""
    states: list[dict[str, float]] = [{}]
    indices: dict[str, list[int]] = {}
    for motion in network.motion:
        angles = motion.angles_deg()
        moving = [angle for angle in angles if angle != motion.at_deg]
        position = {angle: len(states) + index for index, angle in enumerate(moving)}
        states += [{motion.name: angle} for angle in moving]
        indices[motion.name] = [position.get(angle, 0) for angle in angles]
    return states, indices


def _subset(response: NetworkResponse, indices: Sequence[int]) -> NetworkResponse:
    """Return a response in a subset of its states."""
    arrays = ("angle_deg", "power", "u_power", "reading", "u_reading")
    return replace(
        response,
        ledgers=tuple(response.ledgers[index] for index in indices),
        **{name: getattr(response, name)[list(indices)] for name in arrays},
    )


def _uncertainty_warnings(response: NetworkResponse, design: Design) -> list[str]:
    """Return a warning if the uncertainty of a power exceeds the default tolerance."""
    worst = float(np.nanmax(response.u_power, initial=0.0))
    if math.isnan(worst) or worst <= DEFAULT_TOLERANCE:
        return []
    return [f"the powers of {design.name} have uncertainties of up to {worst:.1e} of the emitted power"]

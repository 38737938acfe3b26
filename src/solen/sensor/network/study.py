"""Response of a network over the range of each of its motions."""

import math
from collections.abc import Sequence
from dataclasses import field, replace

import numpy as np

from solen.progress import Progress
from solen.results import HIDDEN, Result, reported
from solen.sensor.network.check import NetworkCheck, network_check
from solen.sensor.network.response import USUAL_TOLERANCE, NetworkResponse, in_turn, network_response, unread_in
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
        Its response with all motions at rest.
    sweeps
        Its response over the range of each motion, by the motion's name.
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


def network_study(design: Design, progress: Progress | None = None, tolerance: float = USUAL_TOLERANCE) -> NetworkStudy:
    """Return the response of a network at rest and over the range of each of its motions; see `network_response`."""
    check, sensors = network_check(design), in_turn(design)
    every, places = courses(design.network)
    whole = network_response(design, every, tolerance, progress)
    sweeps = {name: _part(whole, part) for name, part in places.items()}
    return NetworkStudy(
        sensors=sensors,
        design=design,
        check=check,
        at_rest=_part(whole, [0]),
        sweeps=sweeps,
        warnings=(*check.warnings, *_rough(whole, design), *unread_in(whole)),
    )


def courses(network: Network) -> tuple[list[dict[str, float]], dict[str, list[int]]]:
    """Return the states of each motion over its range, rest first, and their indices by motion."""
    every: list[dict[str, float]] = [{}]
    places: dict[str, list[int]] = {}
    for motion in network.motion:
        angles = motion.angles_deg()
        moved = [angle for angle in angles if angle != motion.at_deg]
        own = {angle: len(every) + place for place, angle in enumerate(moved)}
        every += [{motion.name: angle} for angle in moved]
        places[motion.name] = [own.get(angle, 0) for angle in angles]
    return every, places


def _part(whole: NetworkResponse, places: Sequence[int]) -> NetworkResponse:
    """Return a response for a subset of its states."""
    own = ("angle_deg", "power", "u_power", "reading", "u_reading")
    return replace(
        whole,
        ledgers=tuple(whole.ledgers[place] for place in places),
        **{name: getattr(whole, name)[list(places)] for name in own},
    )


def _rough(response: NetworkResponse, design: Design) -> list[str]:
    """Return a warning if a power is less certain than expected from sampling."""
    worst = float(np.nanmax(response.u_power, initial=0.0))
    if math.isnan(worst) or worst <= USUAL_TOLERANCE:
        return []
    return [f"the powers of {design.name} have uncertainties of up to {worst:.1e} of the emitted power"]

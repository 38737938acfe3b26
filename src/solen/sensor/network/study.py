"""Response of a network over the range of each of its motions."""

import math
from dataclasses import field, replace
from itertools import pairwise

import numpy as np

from solen.arrays import Progress
from solen.results import HIDDEN, Result, reported
from solen.sensor.network.check import NetworkCheck, network_check
from solen.sensor.network.response import USUAL_TOLERANCE, NetworkResponse, in_turn, network_response, unread_in
from solen.sensor.sensor import Sensor
from solen.spec import Design


class NetworkStudy(Result):
    """Response of a network over the range of each of its motions, the others as they stand.

    Attributes
    ----------
    design
        The design studied.
    check
        Its check.
    at_rest
        Its response with the motions as they stand.
    sweeps
        Its response over the range of each motion, by the motion's name.
    warnings
        Reasons to doubt a value.
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
    """Response of a network as it stands, and over the range of each of its motions; see `network_response`."""
    check, sensors = network_check(design), in_turn(design)
    ranges = {motion.name: [{motion.name: angle} for angle in motion.angles_deg()] for motion in design.network.motion}
    every = [{}, *(state for row in ranges.values() for state in row)]
    whole = network_response(design, every, tolerance, progress)
    ends = np.cumsum([1, *(len(row) for row in ranges.values())]).tolist()
    parts = pairwise(ends)
    sweeps = {name: _part(whole, *part) for name, part in zip(ranges, parts, strict=True)}
    return NetworkStudy(
        sensors=sensors,
        design=design,
        check=check,
        at_rest=_part(whole, 0, 1),
        sweeps=sweeps,
        warnings=(*check.warnings, *_rough(whole, design), *unread_in(whole)),
    )


def _part(whole: NetworkResponse, low: int, high: int) -> NetworkResponse:
    """Some states of a response."""
    return replace(
        whole,
        angle_deg=whole.angle_deg[low:high],
        power=whole.power[low:high],
        u_power=whole.u_power[low:high],
        reading=whole.reading[low:high],
        u_reading=whole.u_reading[low:high],
        ledgers=whole.ledgers[low:high],
    )


def _rough(response: NetworkResponse, design: Design) -> list[str]:
    """Warning where a power is less certain than samples should make it."""
    worst = float(np.nanmax(response.u_power, initial=0.0))
    if math.isnan(worst) or worst <= USUAL_TOLERANCE:
        return []
    return [f"powers of {design.name} are uncertain by up to {worst:.1e} of the emitted power"]

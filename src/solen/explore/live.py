"""The response of a design while a user changes it, first roughly and then with increasing accuracy.

While a parameter is being changed, a few rays of the compiled batch give a response with a large uncertainty, which is
reported. Once it stops changing, the number of rays increases until the uncertainty of the contrast is below `GOAL`.
Sensors that the batch does not support are integrated.

Public names: `coarse`, `refined` and `planar_model_error`.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import reduce

import numpy as np

from solen.errors import DesignError
from solen.explore.merits import MIN_ANGLES, Merits, merits_of, worst_resolution_deg
from solen.results import Result
from solen.sensor import Response, Sensor, respond, why_not_batched
from solen.sensor.practice import MAX_ANGLES, MIN_CONTRAST_CHANGE, subsample
from solen.sensor.readings import readings_from
from solen.sensor.response import shift

COARSE_RAYS = 1280
REFINED_RAYS = tuple(2**n for n in (14, 17, 19))
"""Numbers of rays per angle, over all emitter positions together."""
GOAL = 2e-3
"""Uncertainty of the contrast at which refinement ends."""


class Stopped(Exception):  # noqa: N818  a request, not an error
    """Raised when the refinement is stopped."""


class Curve(Result):
    """Response of a design at the present state of refinement.

    Attributes
    ----------
    response
        Powers at both receivers.
    merits
        Merits of the response, or None with fewer than three angles.
    in_space
        Whether the rays were traced in space (3-D).
    rays
        Number of rays per angle, or None if the response was integrated.
    finished
        Whether the response is final.
    """

    response: Response
    merits: Merits | None
    in_space: bool
    rays: int | None
    finished: bool


def coarse(sensor: Sensor, rays: int = COARSE_RAYS) -> Curve | None:
    """Return the response from few rays; None if the batch does not support the sensor.

    Raises
    ------
    DesignError
        If the sensor has no response.
    """
    sensor.check_pair()
    if why_not_batched(sensor):
        return None
    response = batched_response(sensor, subsample(sensor.design.motion.angles_deg(), MAX_ANGLES), rays)
    return curve_of(sensor, response, rays, finished=False)


def refined(sensor: Sensor, stop: Callable[[], bool] = lambda: False) -> Iterator[Curve]:
    """Yield responses at all angles of the motion with increasing accuracy, until ``stop`` returns True.

    Raises
    ------
    SolenError
        If the sensor has no response: it does not have two receivers, or its body is impossible at some angle.
    """
    if why_not_batched(sensor):
        yield from _integrated(sensor, stop)
        return
    for rays in REFINED_RAYS:
        try:
            response = _in_parts(sensor, rays, stop)
        except Stopped:
            return
        finished = rays == REFINED_RAYS[-1] or largest_u(response) <= GOAL
        yield curve_of(sensor, response, rays, finished=finished)
        if finished:
            return


def largest_u(response: Response) -> float:
    """Return the largest uncertainty of the contrast over the angles at which any light arrives."""
    u = response.u_contrast
    return float(u[np.isfinite(u)].max(initial=0.0))


def planar_model_error(plane: Response, space: Response) -> str:
    """Return a sentence on the error of the planar model; empty if plane and space agree."""
    difference = shift(plane, space)
    if difference is None or difference.contrast - difference.u_contrast <= MIN_CONTRAST_CHANGE:
        return ""
    sentence = (
        f"The model in the plane is misleading for this design: its contrast differs by up to {difference.contrast:.2f}"
        f" ± {difference.u_contrast:.1g} from that in space, at {difference.angle_deg:+.3g}°. "
        "Use the values from the curve in space."
    )
    return sentence.replace("-", "−")


def _in_parts(sensor: Sensor, rays: int, stop: Callable[[], bool]) -> Response:
    """Return the response at all angles, traced in pairs of opposite angles to allow an early stop."""
    pairs: dict[float, list[float]] = {}
    for angle in sensor.design.motion.angles_deg():
        pairs.setdefault(abs(angle), []).append(angle)

    def traced(angles: list[float]) -> Response:
        if stop():
            raise Stopped
        return batched_response(sensor, angles, rays)

    return reduce(Response.merged, map(traced, pairs.values()))


def batched_response(sensor: Sensor, angles: Sequence[float], rays: int) -> Response:
    """Return the response from the compiled batch; raise `DesignError` if the sensor is impossible at an angle."""
    sensor.check_pair()
    traced = respond([sensor], angles, rays=rays)
    if traced.why[0]:
        sensor.check()  # raises an error with value, limit and remedy
        raise DesignError(traced.why[0])
    powers = (traced.right[0, 0], traced.left[0, 0], traced.u_power[0, 0])
    return Response("power", np.array(angles), *powers, ())


def _integrated(sensor: Sensor, stop: Callable[[], bool]) -> Iterator[Curve]:
    def progress(_: float) -> None:
        if stop():
            raise Stopped

    try:
        response = sensor.power(progress=progress)
    except Stopped:
        return
    yield curve_of(sensor, response, None, finished=True)


def curve_of(sensor: Sensor, response: Response, rays: int | None, *, finished: bool) -> Curve:
    """Return a response with its merits; the resolution is computed only for a ``finished`` response."""
    few = len(response.angle_deg) < MIN_ANGLES
    resolution = worst_resolution_deg(readings_from(sensor, response)) if not few and finished else (np.nan, np.nan)
    merits = None if few else merits_of(response, resolution)
    return Curve(response, merits, sensor.design.trace.dimension == "extruded", rays, finished)

"""Response of a sensor with a printed lens, as measured and as predicted for the next print.

Public name: `responses`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.explore.tuning_log import Responses, TunedResponse
from solen.lens import MeasuredLens
from solen.progress import Progress
from solen.sensor import Sensor
from solen.sensor.as_printed import DRAWN_RAYS
from solen.sensor.effects import response_at
from solen.sensor.practice import subsample
from solen.sensor.response import Response
from solen.trace.chunks import Sampling

MAX_ANGLES, NEAR_DEG, MAX_NULL_DEG = 5, 0.4, 1.0
"""Number of angles over the motion, distance from 0 for the slope, and largest distance of the null from 0."""


def responses(
    sensor: Sensor,
    before: Sequence[MeasuredLens],
    after: Sequence[MeasuredLens],
    progress: Progress | None = None,
) -> Responses:
    """Return responses with the lens as designed, as printed and as predicted, in the plane or in space.

    For the printed and the predicted lens, the first profile is the best estimate; further ones are random draws.

    Raises
    ------
    DesignError
        If the sensor has no pair of receivers, a body cannot be built, or no light arrives.
    """
    sensor.check_pair()
    motion = sensor.design.motion.angles_deg()
    angles = sorted({*subsample(motion, MAX_ANGLES), -NEAR_DEG, 0.0, NEAR_DEG})
    made = [_response(response_at(sensor, angles), [])]
    for number, (best, *others) in enumerate((before, after)):
        sensors = [replace(sensor, cut=lens) for lens in (best, *others)]
        whole = response_at(sensors[0], angles)
        near, *away = (_sampled(sensor, angles) for sensor in sensors)
        made.append(_response(whole, [one - near for one in away]))
        if progress is not None:
            progress(0.5 * (number + 1))
    return Responses(sensor.design.trace.dimension, sensor.light.width_mm, *made)


def _sampled(sensor: Sensor, angles: Sequence[float]) -> FloatArray:
    """Return contrasts (N,) traced with the same rays for each lens, so that only the lens differs."""
    scene = sensor.scene(angles[0])
    sampling: Sampling = "sobol" if scene.is_random or scene.extrusion is not None else "fan"
    return sensor.power_of_rays(angles, DRAWN_RAYS, sampling).contrast


def _response(best: Response, away: Sequence[FloatArray]) -> TunedResponse:
    """Return a response whose uncertainty includes the standard deviation over other lenses."""
    if not np.isfinite([best.contrast, *away]).all():
        raise DesignError("response", limit="at some angles no light arrives", remedy="narrow the motion")
    u_lens = np.sqrt(np.mean(np.square(away), axis=0)) if away else np.zeros_like(best.contrast)
    u = np.hypot(u_lens, best.u_contrast)
    low, here, high = (best.index_at(angle) for angle in (-NEAR_DEG, 0.0, NEAR_DEG))
    slope = float(best.contrast[high] - best.contrast[low]) / (2.0 * NEAR_DEG)
    bent = [float(one[high] - one[low]) / (2.0 * NEAR_DEG) for one in away] or [0.0]
    u_slope = float(np.hypot(np.sqrt(np.mean(np.square(bent))), best.u_contrast[here] / (np.sqrt(2.0) * NEAR_DEG)))
    null = -float(best.contrast[here]) / slope if slope else np.inf
    has_null = abs(null) <= MAX_NULL_DEG
    return TunedResponse(
        tuple(best.angle_deg.tolist()),
        tuple(np.round(best.contrast, 6).tolist()),
        tuple(np.round(u, 6).tolist()),
        null if has_null else None,
        float(u[here]) / abs(slope) if has_null else None,
        slope,
        u_slope,
    )

"""Responses of a sensor with the lens as designed, as printed, and as predicted for the next print.

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
    """Return the responses with the designed lens, and with the printed lens before and after the correction.

    The first lens of ``before`` and ``after`` is the best estimate; the others are random samples about it.

    Raises
    ------
    DesignError
        If the sensor has no pair of receivers, a body cannot be built, or no light arrives.
    """
    sensor.check_pair()
    motion = sensor.design.motion.angles_deg()
    angles = sorted({*subsample(motion, MAX_ANGLES), -NEAR_DEG, 0.0, NEAR_DEG})
    traced = [_response(response_at(sensor, angles), [])]
    for number, lenses in enumerate((before, after)):
        sensors = [replace(sensor, cut=lens) for lens in lenses]
        best, *others = (_sampled(sensor, angles) for sensor in sensors)
        traced.append(_response(response_at(sensors[0], angles), [other - best for other in others]))
        if progress is not None:
            progress(0.5 * (number + 1))
    return Responses(sensor.design.trace.dimension, sensor.light.width_mm, *traced)


def _sampled(sensor: Sensor, angles: Sequence[float]) -> FloatArray:
    """Return the contrast (N,) traced with the same few rays for each lens, so that only the lens differs."""
    scene = sensor.scene(angles[0])
    sampling: Sampling = "sobol" if scene.is_random or scene.extrusion is not None else "fan"
    return sensor.power_of_rays(angles, DRAWN_RAYS, sampling).contrast


def _response(best: Response, changes: Sequence[FloatArray]) -> TunedResponse:
    """Return a response whose uncertainty includes the RMS change of the contrast over other lenses."""
    if not np.isfinite([best.contrast, *changes]).all():
        limit, remedy = "no light arrives at some angles of the motion", "reduce motion.from_deg and motion.to_deg"
        raise DesignError("response", limit=limit, remedy=remedy)
    u_lens = np.sqrt(np.mean(np.square(changes), axis=0)) if changes else np.zeros_like(best.contrast)
    u = np.hypot(u_lens, best.u_contrast)
    low, zero, high = (best.index_at(angle) for angle in (-NEAR_DEG, 0.0, NEAR_DEG))
    slope = float(best.contrast[high] - best.contrast[low]) / (2.0 * NEAR_DEG)
    slope_changes = [float(change[high] - change[low]) / (2.0 * NEAR_DEG) for change in changes] or [0.0]
    u_trace = best.u_contrast[zero] / (np.sqrt(2.0) * NEAR_DEG)
    u_slope = float(np.hypot(np.sqrt(np.mean(np.square(slope_changes))), u_trace))
    null = -float(best.contrast[zero]) / slope if slope else np.inf
    has_null = abs(null) <= MAX_NULL_DEG
    return TunedResponse(
        tuple(best.angle_deg.tolist()),
        tuple(np.round(best.contrast, 6).tolist()),
        tuple(np.round(u, 6).tolist()),
        null if has_null else None,
        float(u[zero]) / abs(slope) if has_null else None,
        slope,
        u_slope,
    )

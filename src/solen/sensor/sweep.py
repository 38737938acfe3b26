"""Sweeps over the angles of a motion: responses, mirrored readings of symmetric sensors, refinement of curves."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from solen.arrays import Progress
from solen.geometry.mirror import OTHER
from solen.sensor.response import Response, powers
from solen.trace import Mode, Trace
from solen.trace.result import Detected

FEW_ANGLES, MOST_ANGLES = 5, 129
"""Least (given two ends) and most angles of a drawn curve."""
BEND = 0.02
"""Angles are added where a contrast deviates by more than this from the line between its neighbours."""

FAILURES = 2
"""If integration fails at this many first angles of a sweep, it is not tried at the others."""

Reading = tuple[Trace, dict[str, float], float]
"""A trace, the power at each receiver, and its uncertainty."""


def readings_at(
    at: Callable[[float, bool], Reading], angles_deg: Sequence[float], progress: Progress | None
) -> dict[float, Reading]:
    """Readings at angles, on several threads; ``at`` takes the angle and whether to integrate.

    The first few are computed one by one; if integration fails at all of them, the others are
    sampled one by one, each on several threads.
    """
    readings: dict[float, Reading] = {}

    def keep(angles: Sequence[float], read: Iterable[Reading]) -> None:
        for angle, reading in zip(angles, read, strict=True):
            readings[angle] = reading
            if progress is not None:
                progress(len(readings) / len(angles_deg))

    first, rest = angles_deg[:FAILURES], angles_deg[FAILURES:]
    keep(first, (at(angle, True) for angle in first))
    if all(trace.method != "adaptive" for trace, _, _ in readings.values()):
        keep(rest, (at(angle, False) for angle in rest))
        return readings
    pool = ThreadPoolExecutor(os.cpu_count() or 1)
    try:
        keep(rest, pool.map(lambda angle: at(angle, True), rest))
    finally:
        pool.shutdown(cancel_futures=True)
    return readings


def sweep(
    mode: Mode, at: Callable[[float], Reading], angles_deg: Sequence[float], progress: Progress | None
) -> Response:
    """Response from the readings at each angle."""
    readings = []
    for done, angle in enumerate(angles_deg, start=1):
        readings.append(at(angle))
        if progress is not None:
            progress(done / len(angles_deg))
    return Response(
        mode=mode,
        angle_deg=np.array(angles_deg),
        right=np.array([powers["right"] for _, powers, _ in readings]),
        left=np.array([powers["left"] for _, powers, _ in readings]),
        u_power=np.array([u for _, _, u in readings]),
        traces=tuple(trace for trace, _, _ in readings),
    )


def mirrored(reading: Reading) -> Reading:
    """Readings of a symmetric sensor at the opposite angle."""
    detectors = reading[0].detectors
    return _with(reading, {name: detectors[OTHER[name]] for name in detectors})


def balanced(reading: Reading) -> Reading:
    """Readings of a symmetric sensor at rest: equal at both receivers."""
    detectors = reading[0].detectors
    return _with(reading, dict.fromkeys(detectors, _mean(detectors)))


def _with(reading: Reading, detectors: dict[str, Detected]) -> Reading:
    """A reading with other powers at the receivers."""
    trace = replace(reading[0], detectors=detectors)
    return trace, powers(trace), reading[2]


def _mean(detectors: Mapping[str, Detected]) -> Detected:
    """Mean of two receivers."""
    right, left = (detectors[name] for name in OTHER)
    sources = zip(right.power_by_source, left.power_by_source, strict=True)
    return replace(right, power=(right.power + left.power) / 2, power_by_source=tuple((a + b) / 2 for a, b in sources))


def between(response: Response) -> list[float]:
    """Midpoints between angles of a response where its contrast is curved."""
    angle, contrast = response.angle_deg, response.contrast
    middles = (angle[1:] + angle[:-1]) / 2
    if len(angle) < FEW_ANGLES:
        return [float(middle) for middle in middles]
    share = (angle[1:-1] - angle[:-2]) / (angle[2:] - angle[:-2])
    bends = np.abs(contrast[1:-1] - (1.0 - share) * contrast[:-2] - share * contrast[2:]) > BEND
    wide = np.diff(angle) > (angle[-1] - angle[0]) / MOST_ANGLES
    return [float(middle) for middle in middles[(np.append(bends, False) | np.append(False, bends)) & wide]]

"""Sweeps over the angles of a motion: readings, their mirror images for symmetric sensors, refinement of curves."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from solen.geometry.mirror import OTHER
from solen.progress import Progress, on_threads, part_of, tracked
from solen.sensor.response import Reading, Response
from solen.trace.result import Detected

FEW_ANGLES, MAX_ANGLES = 5, 129
"""Smallest (with both ends) and largest number of angles of a drawn curve."""
BEND = 0.02
"""Contrast deviation from the line between its neighbours above which angles are added."""

FAILURES = 2
"""Number of failures: if integration fails at this many initial angles of a sweep, it is not tried at the others."""


def readings_at(
    at: Callable[[float, bool], Reading], angles_deg: Sequence[float], progress: Progress | None
) -> dict[float, Reading]:
    """Return readings at angles, computed on several threads; ``at`` accepts the angle and whether to integrate.

    The first few are computed one by one; if integration fails at all of them, the others are sampled one by one, each
    on several threads.
    """
    count, first, rest = len(angles_deg), angles_deg[:FAILURES], angles_deg[FAILURES:]
    readings = [at(angle, True) for angle in tracked(first, part_of(progress, 0, count, len(first)))]
    later = part_of(progress, len(first), count, len(rest))
    if all(trace.method != "adaptive" for trace, _ in readings):
        readings += [at(angle, False) for angle in tracked(rest, later)]
    else:
        readings += on_threads(lambda angle: at(angle, True), rest, later)
    return dict(zip(angles_deg, readings, strict=True))


def mirrored(reading: Reading) -> Reading:
    """Return the readings of a symmetric sensor at the opposite angle."""
    detectors = reading[0].detectors
    return _with(reading, {name: detectors[OTHER[name]] for name in detectors})


def balanced(reading: Reading) -> Reading:
    """Return the readings of a symmetric sensor at rest, equal at both receivers."""
    detectors = reading[0].detectors
    return _with(reading, dict.fromkeys(detectors, _mean(detectors)))


def _with(reading: Reading, detectors: dict[str, Detected]) -> Reading:
    """Return a reading with other powers at the receivers."""
    trace, u = reading
    return replace(trace, detectors=detectors), u


def _mean(detectors: Mapping[str, Detected]) -> Detected:
    """Return the mean of two receivers."""
    right, left = (detectors[name] for name in OTHER)
    sources = zip(right.power_by_source, left.power_by_source, strict=True)
    return replace(right, power=(right.power + left.power) / 2, power_by_source=tuple((a + b) / 2 for a, b in sources))


def between(response: Response) -> list[float]:
    """Return the midpoints between angles of a response in the region where its contrast is curved."""
    angle, contrast = response.angle_deg, response.contrast
    middles = (angle[1:] + angle[:-1]) / 2
    if len(angle) < FEW_ANGLES:
        return [float(middle) for middle in middles]
    share = (angle[1:-1] - angle[:-2]) / (angle[2:] - angle[:-2])
    bends = np.abs(contrast[1:-1] - (1.0 - share) * contrast[:-2] - share * contrast[2:]) > BEND
    wide = np.diff(angle) > (angle[-1] - angle[0]) / MAX_ANGLES
    return [float(middle) for middle in middles[(np.append(bends, False) | np.append(False, bends)) & wide]]

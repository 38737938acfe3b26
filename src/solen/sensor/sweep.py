"""Sweeps over the angles of a motion: readings, mirror images for symmetric sensors, and refinement of curves."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from solen.geometry.mirror import OPPOSITE_SIDE
from solen.progress import Progress, on_threads, part_of, tracked
from solen.sensor.response import Reading, Response
from solen.trace.result import Detected

MIN_ANGLES, MAX_ANGLES = 5, 129
"""Smallest (with both ends) and largest number of angles of a plotted curve."""
MAX_DEVIATION = 0.02
"""Deviation of the contrast from the line between the neighbouring points above which angles are added."""

INITIAL_ANGLES = 2
"""Number of angles that are computed first; if integration fails at all of them, it is not tried at the others."""


def readings_at(
    at: Callable[[float, bool], Reading], angles_deg: Sequence[float], progress: Progress | None
) -> dict[float, Reading]:
    """Return the readings keyed by angle, computed on several threads; ``at`` takes an angle and whether to integrate.

    The first few are computed one by one; if integration fails at all of them, the others are sampled one by one, each
    on several threads.
    """
    count, first, rest = len(angles_deg), angles_deg[:INITIAL_ANGLES], angles_deg[INITIAL_ANGLES:]
    readings = [at(angle, True) for angle in tracked(first, part_of(progress, 0, count, len(first)))]
    rest_progress = part_of(progress, len(first), count, len(rest))
    if all(trace.method != "adaptive" for trace, _ in readings):
        readings += [at(angle, False) for angle in tracked(rest, rest_progress)]
    else:
        readings += on_threads(lambda angle: at(angle, True), rest, rest_progress)
    return dict(zip(angles_deg, readings, strict=True))


def mirrored(reading: Reading) -> Reading:
    """Return the reading of a symmetric sensor at the opposite angle."""
    detectors = reading[0].detectors
    return _with_detectors(reading, {name: detectors[OPPOSITE_SIDE[name]] for name in detectors})


def balanced(reading: Reading) -> Reading:
    """Return the reading of a symmetric sensor at rest, with the power at each receiver replaced by their mean."""
    detectors = reading[0].detectors
    return _with_detectors(reading, dict.fromkeys(detectors, _mean(detectors)))


def _with_detectors(reading: Reading, detectors: dict[str, Detected]) -> Reading:
    """Return a copy of a reading with the powers at its receivers replaced by ``detectors``."""
    trace, u = reading
    return replace(trace, detectors=detectors), u


def _mean(detectors: Mapping[str, Detected]) -> Detected:
    """Return the mean of the powers at the right and the left receiver."""
    right, left = (detectors[name] for name in OPPOSITE_SIDE)
    sources = zip(right.power_by_source, left.power_by_source, strict=True)
    return replace(right, power=(right.power + left.power) / 2, power_by_source=tuple((a + b) / 2 for a, b in sources))


def midpoints(response: Response) -> list[float]:
    """Return the midpoints between angles of a response where its contrast is curved."""
    angle, contrast = response.angle_deg, response.contrast
    middles = (angle[1:] + angle[:-1]) / 2
    if len(angle) < MIN_ANGLES:
        return [float(middle) for middle in middles]
    fraction = (angle[1:-1] - angle[:-2]) / (angle[2:] - angle[:-2])
    is_curved = np.abs(contrast[1:-1] - (1.0 - fraction) * contrast[:-2] - fraction * contrast[2:]) > MAX_DEVIATION
    is_wide = np.diff(angle) > (angle[-1] - angle[0]) / MAX_ANGLES
    return [float(middle) for middle in middles[(np.append(is_curved, False) | np.append(False, is_curved)) & is_wide]]

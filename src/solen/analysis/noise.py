"""Noise of a reading, computed in the same way for a response, a group of its cycles, and a rig at rest.

The noise is the standard deviation of the readings in holds about a straight line over time, which follows a slow drift
of the light. Variations that are not random, such as residual flicker, thus contribute their true variance. Differences
between successive readings would overestimate a variation that alternates from reading to reading: first differences
give 2 times its variance, second differences 8/3 times. Second differences, which cancel smooth motion, are therefore
used only if there is no usable hold.

Public names: `noise_of`, `Scatter` and `pooled_noise`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray

SETTLE = 0.2
"""Fraction of a hold, at its beginning, that is not used for the noise."""
MIN_READINGS = 8


@dataclass(frozen=True, eq=False)
class Scatter:
    """Sums of squares (m,) and their degrees of freedom (m,): about lines in the holds, and of second differences."""

    rest: tuple[FloatArray, FloatArray]
    moving: tuple[FloatArray, FloatArray]


def noise_of(time_s: FloatArray, values: FloatArray, holds: Iterable[tuple[int, int]]) -> Scatter:
    """Return the scatter of readings (n, m) at ascending times (n,); NaN marks a clipped or missing reading.

    ``holds`` contains the slice bounds of intervals at rest. If a hold contains a NaN for a receiver, it is not used
    for this receiver.
    """
    squares, freedom = np.zeros(values.shape[1]), np.zeros(values.shape[1])
    for start, stop in holds:
        begin = start + math.ceil(SETTLE * (stop - start))
        if stop - begin < MIN_READINGS:
            continue
        part = values[begin:stop]
        complete = np.isfinite(part).all(axis=0)
        squares += np.where(complete, _about_line(time_s[begin:stop], part), 0.0)
        freedom += np.where(complete, len(part) - 2, 0)
    second = np.diff(values, 2, axis=0)
    return Scatter((squares, freedom), (np.nansum(second**2, axis=0) / 6.0, np.isfinite(second).sum(axis=0)))


def pooled_noise(scatters: Sequence[Scatter]) -> FloatArray:
    """Return the standard deviation of a reading (m,).

    It is that of the readings in holds, otherwise it follows from second differences; NaN if there is neither.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        rest, moving = (
            np.sqrt(np.sum([part[0] for part in parts], axis=0) / np.sum([part[1] for part in parts], axis=0))
            for parts in ([scatter.rest for scatter in scatters], [scatter.moving for scatter in scatters])
        )
    return np.asarray(np.where(np.isfinite(rest), rest, moving))


def _about_line(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the sum of squares of each column about its least-squares line over time."""
    time = (time_s - time_s.mean())[:, None]
    centred = values - values.mean(axis=0)
    total = float((time**2).sum())
    slope = (time * centred).sum(axis=0) / total if total > 0.0 else 0.0
    return np.asarray(((centred - slope * time) ** 2).sum(axis=0))

"""Noise of a reading, defined identically for a response, a group of its cycles, and a rig at rest.

At rest, readings follow a straight line over time, because the light drifts; the noise is their standard deviation
about this line. Variations that are not random, such as residual flicker, are counted with their true variance, whereas
differences between neighbours would overweight an alternation (8/3 of the variance with second differences, 2 with
first). Second differences are used only if nothing rests, because they cancel a smooth motion.

Public names: `noise_of`, `Scatter` and `pooled_noise`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray

SETTLE = 0.2
"""Fraction of an interval at rest, at its beginning, that is not used for the noise."""
MIN_READINGS = 8
Stretch = tuple[int, int]
"""Indices of the first and the last reading, minus one."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Sums of squares (m,) and their degrees of freedom (m,): about lines at rest, and from second differences."""

    rest: tuple[FloatArray, FloatArray]
    moving: tuple[FloatArray, FloatArray]


def noise_of(time_s: FloatArray, values: FloatArray, stretches: Iterable[Stretch]) -> Scatter:
    """Scatter of readings (n, m) at ascending times (n,); NaN marks a clipped or missing reading.

    An interval with such a reading is not used for the receiver concerned.
    """
    squares, freedom = np.zeros(values.shape[1]), np.zeros(values.shape[1])
    for start, stop in stretches:
        begin = start + math.ceil(SETTLE * (stop - start))
        if stop - begin < MIN_READINGS:
            continue
        part = values[begin:stop]
        good = np.isfinite(part).all(axis=0)
        squares += np.where(good, _about_line(time_s[begin:stop], part), 0.0)
        freedom += np.where(good, len(part) - 2, 0)
    second = np.diff(values, 2, axis=0)
    return Scatter((squares, freedom), (np.nansum(second**2, axis=0) / 6.0, np.isfinite(second).sum(axis=0)))


def pooled_noise(scatters: Sequence[Scatter]) -> FloatArray:
    """Standard deviation of a reading (m,): at rest, or from second differences if nothing rests; otherwise NaN."""
    with np.errstate(invalid="ignore", divide="ignore"):
        rest, moving = (
            np.sqrt(np.sum([part[0] for part in parts], axis=0) / np.sum([part[1] for part in parts], axis=0))
            for parts in ([scatter.rest for scatter in scatters], [scatter.moving for scatter in scatters])
        )
    return np.asarray(np.where(np.isfinite(rest), rest, moving))


def _about_line(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Sum of squares of each column about its least-squares line over time."""
    away = (time_s - time_s.mean())[:, None]
    rest = values - values.mean(axis=0)
    total = float((away**2).sum())
    slope = (away * rest).sum(axis=0) / total if total > 0.0 else 0.0
    return np.asarray(((rest - slope * away) ** 2).sum(axis=0))

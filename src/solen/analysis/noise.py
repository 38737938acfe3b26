"""Noise of a reading, with one definition for a response, a group of its cycles, and a rig at rest.

The idea: at rest, readings follow a straight line over time, as light drifts; noise is their standard deviation
about it. Variations that are not random, such as residual flicker, count
once; differences of neighbours would overweight alternation (8/3 of the variance by second differences,
2 by first). They are used only without rest, as second differences cancel a smooth motion.

The interface: `noise_of` readings and intervals at rest returns a `Scatter`; `pooled_noise` combines several.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray

SETTLE = 0.2
"""Share of a stretch at its beginning that noise is not taken from."""
LEAST_READINGS = 8
Stretch = tuple[int, int]
"""First and last reading, less one."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Sums of squares (m,) and their degrees of freedom (m,): about lines at rest, and by second differences."""

    rest: tuple[FloatArray, FloatArray]
    moving: tuple[FloatArray, FloatArray]


def noise_of(time_s: FloatArray, values: FloatArray, stretches: Iterable[Stretch]) -> Scatter:
    """Scatter of readings (n, m) at ascending times (n,); NaN where a reading is clipped or missing.

    A stretch with such a reading gives nothing for its receiver.
    """
    squares, freedom = np.zeros(values.shape[1]), np.zeros(values.shape[1])
    for start, stop in stretches:
        begin = start + math.ceil(SETTLE * (stop - start))
        if stop - begin < LEAST_READINGS:
            continue
        part = values[begin:stop]
        good = np.isfinite(part).all(axis=0)
        squares += np.where(good, _about_line(time_s[begin:stop], part), 0.0)
        freedom += np.where(good, len(part) - 2, 0)
    second = np.diff(values, 2, axis=0)
    return Scatter((squares, freedom), (np.nansum(second**2, axis=0) / 6.0, np.isfinite(second).sum(axis=0)))


def pooled_noise(scatters: Sequence[Scatter]) -> FloatArray:
    """Standard deviation of a reading (m,): at rest, or by second differences where nothing rests; NaN without any."""
    with np.errstate(invalid="ignore", divide="ignore"):
        rest, moving = (
            np.sqrt(np.sum([one[0] for one in parts], axis=0) / np.sum([one[1] for one in parts], axis=0))
            for parts in ([one.rest for one in scatters], [one.moving for one in scatters])
        )
    return np.asarray(np.where(np.isfinite(rest), rest, moving))


def _about_line(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Sum of squares of each column about its straight line over time."""
    away = (time_s - time_s.mean())[:, None]
    rest = values - values.mean(axis=0)
    total = float((away**2).sum())
    slope = (away * rest).sum(axis=0) / total if total > 0.0 else 0.0
    return np.asarray(((rest - slope * away) ** 2).sum(axis=0))

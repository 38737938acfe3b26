"""Sampling of the light that an exact integration does not follow to its end: the *tail*.

Integration follows branches down to a minimum weight and up to a maximum number of interfaces. Beyond these limits,
light is trapped or was split many times, and is not a smooth function of its starting point. It carries little power,
however, and can be sampled from scrambled Sobol' points: each sample follows the branches that the integration stopped,
and continues with one randomly chosen part at every interface. The mean over independent scramblings is unbiased, and
their differences give its uncertainty. The total power of the tail is known from the integration, so only its
distribution over the receivers is sampled, as a ratio of two means.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.scene.sources import Source
from solen.scene.sources.points import sample
from solen.trace.cone import DOUBLE, Integral
from solen.trace.kernel import paths
from solen.trace.kernel.family import FamilyInSpace
from solen.trace.kernel.nearest import Walls

SCRAMBLINGS, SEED = 16, 20260
FIRST_SAMPLES, MAX_SAMPLES = 32, 1 << 22
"""Initial and maximum number of samples per scrambling."""
STUDENT_FACTOR = 1.07
"""Factor on standard errors from 16 scramblings: the standard deviation of Student's t with 15 degrees of freedom."""


class Tail(NamedTuple):
    """The tail of a source; ``family_of`` returns the family of rays at the spectral line with a given index."""

    walls: Walls
    source: Source
    in_space: bool
    columns: int
    family_of: Callable[[int], FamilyInSpace]

    def completed(self, integral: Integral, tolerance: float, max_hits: int, max_segments: int) -> Integral:
        """Return an integral with its tail, sampled until the tolerance or the number of segments is reached.

        If ``max_segments`` segments are unlikely to suffice for the tolerance, sampling stops at a tenth of them.
        """
        buffers = paths.path_buffers(self.columns)
        dimensions = self.source.dimensions(self.in_space)
        nets = [sample(dimensions, (SEED, copy)) for copy in range(SCRAMBLINGS)]
        totals, first, count, segments = np.zeros((SCRAMBLINGS, self.columns)), 0, FIRST_SAMPLES, 0
        while True:
            for copy, points_of in enumerate(nets):
                segments += self._sum(
                    points_of(first, count), copy * MAX_SAMPLES + first, max_hits, buffers, totals[copy]
                )
            powers, u = distributed(totals / count, integral.unfinished)
            insufficient = segments * (u / tolerance) ** 2 > 4.0 * max_segments
            if (
                u <= tolerance
                or 2 * count > MAX_SAMPLES
                or 2 * segments > (0.1 if insufficient else 1.0) * max_segments
            ):
                break
            first, count = count, 2 * count
        rays = np.array([SCRAMBLINGS * count, segments, 0, 0])
        return integral._replace(
            powers=integral.powers + powers[: len(integral.powers)],
            error=math.hypot(integral.error, u),
            counts=integral.counts + rays,
            missed=integral.missed + float(powers[-2]),
            leaked=integral.leaked + float(powers[-1]),
        )

    def _sum(self, u: FloatArray, first: int, max_hits: int, buffers: paths.PathBuffers, total: FloatArray) -> int:
        """Add the tails of samples at points ``u`` (N, dimensions) in the unit cube; return the number of segments."""
        launch = self.source.launch_at(u, len(u), self.in_space)
        dy = np.zeros(len(launch)) if launch.dy is None else launch.dy
        starts = np.column_stack([launch.x_mm, launch.z_mm, launch.dx, dy, launch.dz])
        segments = 0
        for line in np.unique(launch.line).tolist():
            line_starts = np.ascontiguousarray(starts[launch.line == line])
            segments += paths.sample_tails(
                DOUBLE, self.walls, self.family_of(line), line_starts, first, max_hits, buffers, total
            )
        return segments


def distributed(means: FloatArray, unfinished: float) -> tuple[FloatArray, float]:
    """Distribute the unfinished power in proportion to the means (R, columns) of R scramblings.

    The last column is the total.

    Return the powers (columns − 1,) and their uncertainty, which is that of a ratio of means (Cochran, Sampling
    Techniques, 3rd ed., 1977, section 6.4). If a scrambling contains no power, the uncertainty is the entire unfinished
    power.
    """
    parts, total = means[:, :-1], means[:, -1]
    if np.count_nonzero(total) < len(means):
        return np.zeros(parts.shape[1]), unfinished
    ratio = parts.mean(axis=0) / total.mean()
    deviations = (parts - ratio * total[:, None]) / total.mean()
    u = np.sqrt(np.sum(deviations**2, axis=0) / (len(means) * (len(means) - 1)))
    return unfinished * ratio, float(STUDENT_FACTOR * unfinished * u.max())

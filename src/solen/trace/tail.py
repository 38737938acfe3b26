"""The remainder of an exact integration, sampled.

Integration follows branches down to a minimum weight and up to a maximum number of interfaces. Beyond these limits,
light that is trapped or split many times is not a smooth function of its starting point. It carries little power,
however, and can be sampled from scrambled Sobol' points: each sample follows the branches that were left, and at every
interface continues one randomly drawn part. The mean over independent scramblings is unbiased, and their differences
give its uncertainty. The total remainder is known from the integration, so only its distribution over the receivers is
sampled, as a ratio of two means.
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
WIDENED = 1.07
"""Standard deviation of Student's t distribution with 15 degrees of freedom."""


class Tail(NamedTuple):
    """Light from a source whose tail can be sampled; ``family_of`` returns the rays for one spectral line."""

    walls: Walls
    source: Source
    in_space: bool
    columns: int
    family_of: Callable[[int], FamilyInSpace]

    def added(self, found: Integral, tolerance: float, most_hits: int, most_legs: int) -> Integral:
        """Complete an integral with its sampled tail, until the uncertainty or the number of segments is reached.

        If ``most_legs`` segments cannot suffice, only a tenth of them is used.
        """
        buffers = paths.path_buffers(self.columns)
        dimensions = self.source.dimensions(self.in_space)
        points = [sample(dimensions, (SEED, copy)) for copy in range(SCRAMBLINGS)]
        totals, done, many, legs = np.zeros((SCRAMBLINGS, self.columns)), 0, FIRST_SAMPLES, 0
        while True:
            for copy, at in enumerate(points):
                legs += self._sum(at(done, many), copy * MAX_SAMPLES + done, most_hits, buffers, totals[copy])
            share, u = divided(totals / many, found.unfinished)
            hopeless = legs * (u / tolerance) ** 2 > 4.0 * most_legs
            if u <= tolerance or 2 * many > MAX_SAMPLES or 2 * legs > (0.1 if hopeless else 1.0) * most_legs:
                break
            done, many = many, 2 * many
        rays = np.array([SCRAMBLINGS * many, legs, 0, 0])
        return found._replace(
            share=found.share + share[: len(found.share)],
            error=math.hypot(found.error, u),
            counts=found.counts + rays,
            missed=found.missed + float(share[-2]),
            leaked=found.leaked + float(share[-1]),
        )

    def _sum(self, u: FloatArray, first: int, most_hits: int, buffers: paths.PathBuffers, total: FloatArray) -> int:
        """Add the tails of samples at points ``u`` (N, dimensions) of the unit cube; return the number of segments."""
        launch = self.source.launch_at(u, len(u), self.in_space)
        rise = np.zeros(len(launch)) if launch.dy is None else launch.dy
        starts = np.column_stack([launch.x_mm, launch.z_mm, launch.dx, rise, launch.dz])
        legs = 0
        for line in np.unique(launch.line).tolist():
            chosen = np.ascontiguousarray(starts[launch.line == line])
            legs += paths.sample_tails(
                DOUBLE, self.walls, self.family_of(line), chosen, first, most_hits, buffers, total
            )
        return legs


def divided(means: FloatArray, unfinished: float) -> tuple[FloatArray, float]:
    """Divide the unfinished power in proportion to the means (R, columns) of R scramblings; the last is the total.

    Returns the fractions (columns − 1,) and their uncertainty, which is that of a ratio of means (Cochran, Sampling
    Techniques, 3rd ed., 1977, section 6.4). If too few samples contain any power, the uncertainty is the entire
    unfinished power.
    """
    parts, all_of_it = means[:, :-1], means[:, -1]
    if np.count_nonzero(all_of_it) < len(means):
        return np.zeros(parts.shape[1]), unfinished
    ratio = parts.mean(axis=0) / all_of_it.mean()
    apart = (parts - ratio * all_of_it[:, None]) / all_of_it.mean()
    u = np.sqrt(np.sum(apart**2, axis=0) / (len(means) * (len(means) - 1)))
    return unfinished * ratio, float(WIDENED * unfinished * u.max())

"""Points of a scrambled Sobol' sequence, which are evenly distributed in a unit cube."""

import numpy as np
from scipy.stats import qmc

from solen.arrays import FloatArray


def sobol(dimensions: int, count: int, rng: np.random.Generator, first: int = 0) -> FloatArray:
    """Return points (count, dimensions) of a Sobol' sequence, scrambled with ``rng``, from the point ``first`` on."""
    sequence = qmc.Sobol(dimensions, rng=rng)
    if first:
        return np.asarray(sequence.fast_forward(first).random(count))
    return np.asarray(sequence.random_base2((count - 1).bit_length())[:count])

"""Points of a scrambled Sobol' sequence, which fill a box evenly."""

import numpy as np
from scipy.stats import qmc

from solen.arrays import FloatArray


def sobol(dimensions: int, number: int, rng: np.random.Generator, first: int = 0) -> FloatArray:
    """Return points (number, dimensions) between 0 and 1 of a Sobol' sequence, scrambled with a generator."""
    sequence = qmc.Sobol(dimensions, rng=rng)
    if first:
        return np.asarray(sequence.fast_forward(first).random(number))
    return np.asarray(sequence.random_base2((number - 1).bit_length())[:number])

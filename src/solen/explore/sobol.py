"""Points of a scrambled Sobol' sequence, which fill a box evenly."""

import numpy as np
from scipy.stats import qmc

from solen.arrays import FloatArray


def sobol(dimensions: int, number: int, rng: np.random.Generator) -> FloatArray:
    """First points (number, dimensions) of a sequence, from 0 to 1, scrambled by a generator."""
    sequence = qmc.Sobol(dimensions, rng=rng)
    return np.asarray(sequence.random_base2((number - 1).bit_length())[:number])

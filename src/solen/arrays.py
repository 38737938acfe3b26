"""Names of array types, and of the callback that long work reports to."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

Progress = Callable[[float], None]
"""Called with the share of the work that is done, from 0 to 1."""


def part_of(progress: Progress | None, first: float, parts: float = 1.0, length: float = 1.0) -> Progress | None:
    """Progress of a part of some work: where it begins and its length, of a whole of ``parts``."""
    return None if progress is None else lambda done: progress((first + length * done) / parts)

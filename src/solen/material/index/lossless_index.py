"""Index of a layer in air from T alone, assuming k = 0."""

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.material.index.masks import Reason, first_code
from solen.material.index.reading import Reading, combined
from solen.material.index.spectrum import Estimate, estimate


def lossless_index(transmittance: ArrayLike) -> FloatArray:
    """Return the index of a lossless layer in air with a transmittance, (1 + √(1 − T²))/T; NaN outside 0 < T < 1."""
    t = np.asarray(transmittance, dtype=float)
    with np.errstate(all="ignore"):
        n = (1.0 + np.sqrt((1.0 - t) * (1.0 + t))) / t
    return np.asarray(np.where((t > 0.0) & (t < 1.0), n, np.nan))


def lossless_in_air(transmittance: Reading) -> Estimate:
    """Return the index of a lossless layer in air, with its uncertainty and masks."""
    t = transmittance.value
    tests = {Reason.MISSING: ~np.isfinite(t), Reason.TRANSMITTANCE: ~(t > 0.0), Reason.NO_REFLECTION: ~(t < 1.0)}
    u = combined(transmittance.contributions(lossless_slope(t)), t.size)
    return estimate(lossless_index(t), u, first_code(tests))


def lossless_slope(t: FloatArray | float) -> FloatArray:
    """Return the derivative of the lossless index with respect to T."""
    with np.errstate(all="ignore"):
        return np.asarray(-(1.0 + 1.0 / np.sqrt((1.0 - t) * (1.0 + t))) / t**2)

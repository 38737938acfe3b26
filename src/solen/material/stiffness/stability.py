"""Range in which a hyperelastic model is stable in Drucker's sense.

A material must not release energy when it is loaded further: for every small change of the strains, Σ dτᵢ dεᵢ > 0 with
Kirchhoff stresses and logarithmic strains. At constant volume, this requires a positive definite matrix of second
derivatives of W with respect to ln λ₁ and ln λ₂. A fit that follows its data exactly may still violate this near the
data, or in a deformation that was not measured; a finite-element program then stops there.

`stable_range` evaluates a model in a mode.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.material.stiffness.models import Model
from solen.material.stiffness.modes import Mode

SCANNED = (0.1, 10.0)
"""Stretches between which stability is checked; the range is extended if the data exceed it."""
_STEPS = 800


@dataclass(frozen=True)
class StableRange:
    """Stretches around 1 over which a model is stable in one mode; None for a limit beyond the checked range."""

    low: float | None
    high: float | None

    def covers(self, low: float, high: float) -> bool:
        """Whether checked stretches from ``low`` to ``high`` are within the range."""
        return (self.low is None or self.low <= low) and (self.high is None or high <= self.high)


def margin(model: Model, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:
    """Return the lowest eigenvalue, in MPa, of the second derivatives of W by ln λ₁, ln λ₂; stable above 0."""
    first, second, _ = mode.principal(np.asarray(stretch, dtype=float))
    return np.asarray(np.linalg.eigvalsh(model.hessian(parameters, first, second))[..., 0])


def stable_range(
    model: Model, parameters: ArrayLike, mode: Mode, reached: tuple[float, float] = (1.0, 1.0)
) -> StableRange:
    """Return the lowest and highest stable stretch of a model in a mode; (1, 1) if it is unstable even undeformed.

    Stability is checked between the ends of `SCANNED`, or of ``reached`` if that is wider.
    """
    low, high = min(SCANNED[0], reached[0]), max(SCANNED[1], reached[1])
    below = _end(model, parameters, mode, np.geomspace(1.0, low, _STEPS))
    above = _end(model, parameters, mode, np.geomspace(1.0, high, _STEPS))
    return StableRange(below, above)


def _end(model: Model, parameters: ArrayLike, mode: Mode, stretches: FloatArray) -> float | None:
    """Return the last stable stretch of a sequence that starts at 1; None if all of it is stable."""
    from scipy.optimize import brentq

    unstable = np.flatnonzero(margin(model, parameters, mode, stretches) <= 0)
    if len(unstable) == 0:
        return None
    at = int(unstable[0])
    if at == 0:
        return 1.0
    return float(
        brentq(lambda s: margin(model, parameters, mode, np.array([s]))[0], stretches[at - 1], stretches[at], xtol=1e-9)
    )

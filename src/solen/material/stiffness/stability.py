"""Range in which a hyperelastic model is stable in Drucker's sense.

A material must not release energy when it is loaded further: for every small change of the strains, Σ dτᵢ dεᵢ > 0 with
Kirchhoff stresses and logarithmic strains. For an incompressible material, the matrix of second derivatives of W with
respect to ln λ₁ and ln λ₂ must therefore be positive definite. A fit that follows its data exactly may violate this
near the data, or in a mode that was not measured; a finite-element program then fails to converge.

`stable_range` evaluates a model in a mode.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.material.stiffness.models import Model
from solen.material.stiffness.modes import Mode

MIN_CHECKED_RANGE = (0.1, 10.0)
"""Range of stretches in which stability is checked; it is extended if the data exceed it."""
_STEPS = 800


@dataclass(frozen=True)
class StableRange:
    """Range of stretches around 1 in which a model is stable in one mode; None for limits outside the checked range."""

    low: float | None
    high: float | None

    def covers(self, low: float, high: float) -> bool:
        """Whether the model is stable from ``low`` to ``high``, within the checked range."""
        return (self.low is None or self.low <= low) and (self.high is None or high <= self.high)


def margin(model: Model, parameters: ArrayLike, mode: Mode, stretch: FloatArray) -> FloatArray:
    """Return the lowest eigenvalue, in MPa, of the second derivatives of W by ln λ₁, ln λ₂; stable if above 0."""
    first, second, _ = mode.principal(np.asarray(stretch, dtype=float))
    return np.asarray(np.linalg.eigvalsh(model.hessian(parameters, first, second))[..., 0])


def stable_range(
    model: Model, parameters: ArrayLike, mode: Mode, data_range: tuple[float, float] = (1.0, 1.0)
) -> StableRange:
    """Return the lowest and highest stable stretch of a model in a mode; (1, 1) if it is unstable without deformation.

    Stability is checked in `MIN_CHECKED_RANGE`, extended to the range of the data.
    """
    low, high = min(MIN_CHECKED_RANGE[0], data_range[0]), max(MIN_CHECKED_RANGE[1], data_range[1])
    lower = _limit(model, parameters, mode, np.geomspace(1.0, low, _STEPS))
    upper = _limit(model, parameters, mode, np.geomspace(1.0, high, _STEPS))
    return StableRange(lower, upper)


def _limit(model: Model, parameters: ArrayLike, mode: Mode, stretches: FloatArray) -> float | None:
    """Return the last stable stretch of a sequence that starts at 1; None if all of them are stable."""
    from scipy.optimize import brentq

    unstable = np.flatnonzero(margin(model, parameters, mode, stretches) <= 0)
    if len(unstable) == 0:
        return None
    i = int(unstable[0])
    if i == 0:
        return 1.0
    return float(
        brentq(lambda s: margin(model, parameters, mode, np.array([s]))[0], stretches[i - 1], stretches[i], xtol=1e-9)
    )

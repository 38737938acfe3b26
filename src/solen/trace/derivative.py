"""Derivatives of received power with respect to whatever a scene is made from.

Received power is an integral over the launch angle whose integrand jumps where neighbouring rays part. When the scene
changes, the integrand changes and the jumps move; both count. The power of a wall's tilt, for one, is nearly all in the
second: to differentiate along each ray's path alone would miss it. So the scene is integrated once by
`solen.trace.integrate`, which finds the pieces between the jumps. In a scene that is changed a little every piece is
found again, its edges bisected to the last digit, and integrated at nodes that keep their share of it: Leibniz' rule,
in which what the quadrature leaves out cancels. Two steps, one half the other, are extrapolated (Richardson), and how
far they are apart bounds the error.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solen.curve import check_numbers
from solen.errors import DesignError
from solen.scene import Scene
from solen.trace.adaptive import LEAST_SHARE, Cone, Integral
from solen.trace.result import Limits, Mode

TOLERANCE = 1e-9
RELATIVE_STEP = 2e-4
MOST_HALVINGS = 6
MOST_LEGS = 400_000


@dataclass(frozen=True)
class Slope:
    """Change of a power per unit of the parameter, and an estimate of its error."""

    value: float
    u: float


@dataclass(frozen=True)
class Derivative:
    """Derivatives of every receiver's power, as fractions of the emitted power per unit of the parameter.

    ``step`` is the larger of the steps taken. ``reached`` is False where the pieces could not be followed: at that very
    value of the parameter the light changes its ways; ``why`` says so.
    """

    detectors: dict[str, Slope]
    step: float
    reached: bool
    why: str = ""


def derivative(
    scene_at: Callable[[float], Scene],
    value: float,
    step: float | None = None,
    mode: Mode = "power",
    tolerance: float = TOLERANCE,
    limits: Limits | None = None,
) -> Derivative:
    """Derivative of the power at every receiver with respect to one parameter.

    Parameters
    ----------
    scene_at
        The scene (with one `Fan`) for a value of the parameter.
    value
        Where the derivative is taken.
    step
        Largest change of the parameter; by default 2e-4 of ``value`` or, near 0, 2e-4. It is halved, up to six times,
        where the light's ways change within it.
    mode, tolerance, limits
        As in `solen.trace.integrate`, for the integral at ``value``.

    Returns
    -------
    Derivative
        One `Slope` per receiver; NaN where it could not be found.

    Raises
    ------
    DesignError
        As `solen.trace.integrate`, a step that is not above 0, or an integral that does not reach its tolerance.
    """
    check_numbers("parameter", value)
    step = RELATIVE_STEP * (abs(value) or 1.0) if step is None else step
    check_numbers("step", step)
    if not step > 0.0:
        raise DesignError("step", value=step, limit="must be above 0")
    limits = limits or Limits(min_weight=LEAST_SHARE * tolerance)
    cone = Cone.of(scene_at(value), mode, limits)
    found = cone.integral(tolerance, MOST_LEGS)
    if not found.trace.reached:
        raise DesignError("derivative", value=found.trace.why, limit=f"the integral must reach {tolerance:g}")
    for _ in range(MOST_HALVINGS + 1):
        wide = _difference(scene_at, value, step, mode, limits, found)
        close = _difference(scene_at, value, 0.5 * step, mode, limits, found) if wide is not None else None
        if wide is not None and close is not None:
            best, apart = (4.0 * close - wide) / 3.0, np.abs(close - wide) / 3.0
            names = cone.scene.receivers
            noise = NOISE / step
            slopes = {name: Slope(float(best[i]), float(apart[i] + noise)) for i, name in enumerate(names)}
            return Derivative(slopes, step, reached=True)
        step *= 0.5
    nothing = {name: Slope(math.nan, math.nan) for name in cone.scene.receivers}
    why = f"the ways of light change within {step:.1e} of {value:g}"
    return Derivative(nothing, step, reached=False, why=why)


NOISE = 1e-13
"""What rounding leaves of an integral over the same pieces."""


def _difference(
    scene_at: Callable[[float], Scene], value: float, step: float, mode: Mode, limits: Limits, found: Integral
) -> NDArray[np.float64] | None:
    """Central difference of the powers, None where a piece is not found again."""
    ends = []
    for sign in (1.0, -1.0):
        powers = Cone.of(scene_at(value + sign * step), mode, limits).again(found)
        if powers is None:
            return None
        ends.append(powers)
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))

"""Derivatives of light in space, by central differences of integrals.

The interface: `difference`, called as `solen.trace.derivative` is.
"""

from collections.abc import Callable

import numpy as np

from solen.errors import DesignError
from solen.scene import Scene
from solen.trace import Derivative, Mode, Slope, integrate
from solen.trace.adaptive import usual_tolerance


def difference(scene_at: Callable[[float], Scene], value: float, step: float, mode: Mode = "power") -> Derivative:
    """Derivative of the power at every receiver with respect to one parameter, in space.

    From differences over ``step`` and over half of it to both sides. The uncertainty is that of the integrals over the
    shorter span, and a third of what the two differ by: what is left of the bend within it.

    Raises
    ------
    DesignError
        Where an integral does not reach its tolerance.
    """
    spans = []
    for half in (step, 0.5 * step):
        ends = []
        for end in (value - half, value + half):
            scene = scene_at(end)
            found = integrate(scene, mode, usual_tolerance(scene))
            if not found.reached:
                limit = f"the integral must reach {usual_tolerance(scene):g}"
                raise DesignError("derivative", value=found.why, limit=limit, remedy="try another angle")
            ends.append(found)
        low, high = ends
        powers = [np.array([reading.power for reading in end.detectors.values()]) for end in ends]
        spans.append(((powers[1] - powers[0]) / (2.0 * half), (low.u_power + high.u_power) / (2.0 * half)))
    (wide, _), (close, noise) = spans
    u = np.abs(wide - close) / 3.0 + noise
    slopes = {name: Slope(float(close[i]), float(u[i])) for i, name in enumerate(low.detectors)}
    return Derivative(slopes, step, reached=True)

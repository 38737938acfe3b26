"""Derivatives of integrals in space with respect to a parameter.

A power is a smooth function of the parameter, but its integrand is not, because the edges of the light move.
Neighbouring scenes are therefore integrated over the same cells. The cells are halved according to the error of the
difference between the two nearest scenes, in which common errors cancel. Further scenes are integrated over these
cells; a polynomial through all results gives the derivative, and one of lower degree gives an error estimate.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.trace.cells import Bounds, Cell, divided, refined
from solen.trace.kernel import paths
from solen.trace.kernel.step import Rules
from solen.trace.space import CHIP_TOLERANCE, LightInSpace

OFFSETS = (1 / 3, -1 / 3, 2 / 3, -2 / 3, 1.0, -1.0)
"""Parameter offsets in units of the step, beginning with the pair closest to zero."""
_BEST, _PLAIN = np.array([3 / 2, -3 / 5, 1 / 10]), np.array([4 / 3, -1 / 3, 0.0])
"""Weights of the central differences for polynomials of degree six and four."""
CLOSENESS, FLOOR = 0.03, 1e-7
"""Factor on the path error, and accepted error of the change in a power over one step."""
SHARE, CAUTION = 3e-4, 1.5
POINT_SHARE, POINT_CAUTION = 1e-4, 2.5
"""For point emitters, in place of ``SHARE`` and ``CAUTION`` for chips: accepted error as a fraction of the largest
slope, and safety factor on the error estimated from halving. The estimate for a point is based on fewer cells,
and points are faster.
"""


class Slopes(NamedTuple):
    """Changes of powers (D,) per unit of a parameter, their differences from a lower-degree fit, and the rule error."""

    value: FloatArray
    bent: FloatArray
    u: float


def slopes(lights: Sequence[LightInSpace], step: float, receivers: int, rules: Rules, most_legs: int) -> Slopes:
    """Return the slopes of the power at each receiver, from ``lights`` with the parameter offset by `OFFSETS`."""
    each = [_of_colour(lights, colour, step, receivers, rules, most_legs) for colour in range(len(lights[0].weights))]
    shares = np.array(lights[0].weights)
    value, bent = shares @ [one.value for one in each], shares @ [one.bent for one in each]
    return Slopes(value, bent, float(np.linalg.norm(shares * [one.u for one in each])))


def _of_colour(
    lights: Sequence[LightInSpace], colour: int, step: float, receivers: int, rules: Rules, most_legs: int
) -> Slopes:
    """Return the slopes at one wavelength, from the cells of an integral: only the edges of light may change."""
    buffers = paths.path_buffers(lights[0].columns)
    families = [light.families[colour]._replace(rules=rules) for light in lights]
    overs = [
        light.over(family, CHIP_TOLERANCE, buffers, CLOSENESS) for light, family in zip(lights, families, strict=True)
    ]

    def change(bounds: Sequence[Bounds]) -> list[Cell]:
        pairs = zip(overs[0](bounds), overs[1](bounds), strict=True)
        return [high.minus(low, 1.5 / step) for high, low in pairs]

    buffers.counts[:] = 0
    plain = lights[0].over(families[0], CHIP_TOLERANCE, buffers)
    begun, _ = divided(plain, lights[0].first_cells, CHIP_TOLERANCE, most_legs, buffers.counts)
    share, caution = (SHARE, CAUTION) if lights[0].source.width_mm > 0.0 else (POINT_SHARE, POINT_CAUTION)
    first = change([cell.bounds for cell in begun] if begun else lights[0].first_cells)
    for cells, u in refined(change, first, caution):
        largest = float(np.max(np.abs(cells.value[:receivers])))
        if u <= max(share * largest, FLOOR / step) or buffers.counts[1] >= most_legs:
            break
    bounds = [cell.bounds for cell in cells]
    powers = np.array([np.sum([cell.value for cell in over(bounds)], axis=0) for over in overs])[:, :receivers]
    differences = (powers[::2] - powers[1::2]) / (2.0 * step * np.array(OFFSETS[::2]))[:, None]
    return Slopes(_BEST @ differences, (_BEST - _PLAIN) @ differences, u)

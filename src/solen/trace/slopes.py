"""Derivatives of integrals in space with respect to a parameter.

A power is a smooth function of the parameter, but its integrand is not, because the edges of the light move.
Neighbouring scenes are therefore integrated over the same cells. The cells are halved according to the error of the
difference between the two nearest scenes, in which common errors cancel. Further scenes are integrated over the same
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
_DEGREE_6, _DEGREE_4 = np.array([3 / 2, -3 / 5, 1 / 10]), np.array([4 / 3, -1 / 3, 0.0])
"""Weights of the central differences for polynomials of degree six and four."""
PATH_FACTOR, MIN_ERROR = 0.03, 1e-7
"""Factor on the accepted path error, and accepted error of the change of a power over one step."""
CHIP_ERROR, CHIP_SAFETY = 3e-4, 1.5
POINT_ERROR, POINT_SAFETY = 1e-4, 2.5
"""For chips and for point emitters: accepted error as a fraction of the largest slope, and safety factor on the error
estimated from halving. The estimate for a point is based on fewer cells, and points are faster.
"""


class Slopes(NamedTuple):
    """Derivatives of the receiver powers with respect to a parameter.

    ``value`` (D,) are the derivatives, ``fit_difference`` (D,) their differences from a fit of lower degree, and ``u``
    is the error of the integration rules.
    """

    value: FloatArray
    fit_difference: FloatArray
    u: float


def slopes(lights: Sequence[LightInSpace], step: float, receivers: int, rules: Rules, max_segments: int) -> Slopes:
    """Return the slopes of the power at each receiver, from ``lights`` with the parameter offset by `OFFSETS`."""
    colours = range(len(lights[0].weights))
    results = [_of_colour(lights, colour, step, receivers, rules, max_segments) for colour in colours]
    value, difference, u = (np.array(column) for column in zip(*results, strict=True))
    weights = np.array(lights[0].weights)
    return Slopes(weights @ value, weights @ difference, float(np.linalg.norm(weights * u)))


def _of_colour(
    lights: Sequence[LightInSpace], colour: int, step: float, receivers: int, rules: Rules, max_segments: int
) -> Slopes:
    """Return the slopes at one wavelength, from the cells of an integral."""
    buffers, chip = paths.path_buffers(lights[0].columns), lights[0].source.width_mm > 0.0
    relative_error, safety = (CHIP_ERROR, CHIP_SAFETY) if chip else (POINT_ERROR, POINT_SAFETY)
    families = [light.families[colour]._replace(rules=rules) for light in lights]
    integrators = [
        light.integrator(family, CHIP_TOLERANCE, buffers, PATH_FACTOR)
        for light, family in zip(lights, families, strict=True)
    ]

    def change(bounds: Sequence[Bounds]) -> list[Cell]:
        pairs = zip(integrators[0](bounds), integrators[1](bounds), strict=True)
        return [high.minus(low, 1.5 / step) for high, low in pairs]

    buffers.counts[:] = 0
    integral = lights[0].integrator(families[0], CHIP_TOLERANCE, buffers)
    divided_cells, _ = divided(integral, lights[0].first_cells, CHIP_TOLERANCE, max_segments, buffers.counts)
    initial = change([cell.bounds for cell in divided_cells] if divided_cells else lights[0].first_cells)
    for cells, u in refined(change, initial, safety):
        largest = float(np.max(np.abs(cells.value[:receivers])))
        if u <= max(relative_error * largest, MIN_ERROR / step) or buffers.counts[1] >= max_segments:
            break
    bounds = [cell.bounds for cell in cells]
    sums = [np.sum([cell.value for cell in integrate(bounds)], axis=0) for integrate in integrators]
    powers = np.array(sums)[:, :receivers]
    differences = (powers[::2] - powers[1::2]) / (2.0 * step * np.array(OFFSETS[::2]))[:, None]
    return Slopes(_DEGREE_6 @ differences, (_DEGREE_6 - _DEGREE_4) @ differences, u)

"""Doses in a print in layers, for Jacobs' law: cure depth, print-through, and the dose at any height.

A layer is exposed from its window side, and the light that it does not absorb enters the layers printed before it. With
dose E per exposure, layer thickness h and penetration depth Dp, a point at a distance s from the window side of a layer
receives E e^(-s/Dp) from the exposure of that layer. The contribution of each later exposure is smaller than that of
the one before it by a factor q = e^(-h/Dp). Deep inside a part, the total is E e^(-s/Dp) / (1 - q), of which the later
exposures contribute E / (e^(h/Dp) - 1) at the window side. The mean over the layer is E Dp/h, but only (E Dp/h) (1 - q)
in a single layer, on which the index is measured. The last layers of a part receive less than the interior, and the
dose has a gradient within each layer.

Doses are added regardless of irradiance and of the number of exposures. Cured resin is assumed to absorb like the
liquid, all exposures are assumed to illuminate the same area, and reflection by the platform and the window is
neglected.

`cure_depth_um`, `dose_below` and `stack_print_through_um` are formulas; `stack_dose` returns the dose inside a part.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.results import reported

_SETTLED = 0.99


def cure_depth_um(dose: ArrayLike, Dp_um: float, Ec_mJ_per_cm2: float) -> FloatArray:
    """Return the depth to which a dose in mJ/cm² cures resin, Dp ln(E/Ec); negative if nothing cures."""
    return np.asarray(Dp_um * np.log(np.asarray(dose, float) / Ec_mJ_per_cm2))


def dose_below(dose: ArrayLike, depth_um: ArrayLike, Dp_um: float) -> FloatArray:
    """Return the dose at a depth, E e^(-d/Dp)."""
    return np.asarray(np.asarray(dose, float) * np.exp(-np.asarray(depth_um, float) / Dp_um))


def stack_print_through_um(dose: float, layer_um: float, Dp_um: float, Ec_mJ_per_cm2: float) -> float:
    """Return how far resin cures into a gap beyond the first of many layers; negative if it does not.

    The doses of all layers add up in the gap: the result is Dp ln(E / (Ec (1 - q))) - h, which is Dp ln(1/(1 - q)) more
    than for a single exposure.
    """
    return float(cure_depth_um(dose / -math.expm1(-layer_um / Dp_um), Dp_um, Ec_mJ_per_cm2)) - layer_um


@dataclass(frozen=True, eq=False)
class StackDose:
    """Dose inside a stack of layers, as `stack_dose` computes it.

    Attributes
    ----------
    layer_um, Dp_um
        Thickness of a layer, and penetration depth.
    exposures_mJ_per_cm2
        Dose at the window for each layer, in the order of printing, shape (n,).
    window_side_mJ_per_cm2
        Dose on the window side of each layer after the last exposure, the highest in the layer, shape (n,).
    """

    layer_um: float
    Dp_um: float
    exposures_mJ_per_cm2: FloatArray
    window_side_mJ_per_cm2: FloatArray

    @property
    def q(self) -> float:
        """Transmittance of a layer."""
        return math.exp(-self.layer_um / self.Dp_um)

    @reported
    def layer_mean_mJ_per_cm2(self) -> FloatArray:
        """Mean dose of each layer, shape (n,)."""
        return self.window_side_mJ_per_cm2 * self._mean_of_window_side

    @reported
    def interior_mean_mJ_per_cm2(self) -> float:
        """Mean dose of a layer far inside, E Dp/h, if every layer has the exposure E of the last layer."""
        return float(self.exposures_mJ_per_cm2[-1]) * self.Dp_um / self.layer_um

    @reported
    def interior_range_mJ_per_cm2(self) -> tuple[float, float]:
        """Lowest and highest doses far inside, at the two sides of a layer."""
        highest = float(self.exposures_mJ_per_cm2[-1]) / -math.expm1(-self.layer_um / self.Dp_um)
        return highest * self.q, highest

    @reported
    def single_layer_mean_mJ_per_cm2(self) -> float:
        """Mean dose of a single layer with the exposure of the last layer, as for a measurement of its index."""
        return float(self.exposures_mJ_per_cm2[-1]) * self._mean_of_window_side

    @reported
    def interior_over_single_layer(self) -> float:
        """Ratio of the dose far inside to the dose of a single layer, 1/(1 - q)."""
        return self.interior_mean_mJ_per_cm2 / self.single_layer_mean_mJ_per_cm2

    @reported
    def layers_to_99_percent(self) -> int:
        """Number of later layers after which a layer has received 99 % of the dose deep inside."""
        return math.ceil(round(-math.log(1.0 - _SETTLED) * self.Dp_um / self.layer_um, 9)) - 1

    @property
    def _mean_of_window_side(self) -> float:
        return -math.expm1(-self.layer_um / self.Dp_um) * self.Dp_um / self.layer_um

    def at(self, height_um: ArrayLike) -> FloatArray:
        """Return the dose at heights above the far side of the first layer, from 0 to n layer thicknesses.

        At the interface between two layers, the result is the dose on the far side of the later layer.
        """
        height = np.asarray(height_um, float)
        number = np.clip((height / self.layer_um).astype(int), 0, len(self.exposures_mJ_per_cm2) - 1)
        from_window = (number + 1) * self.layer_um - height
        return np.asarray(self.window_side_mJ_per_cm2[number] * np.exp(-from_window / self.Dp_um))


def stack_dose(Dp_um: float, layer_um: float, exposures: ArrayLike) -> StackDose:
    """Return the dose inside a part, layer by layer.

    Parameters
    ----------
    Dp_um, layer_um
        Penetration depth, and thickness of a layer.
    exposures
        Dose in mJ/cm² at the window for each layer, in the order of printing, shape (n,).

    Raises
    ------
    DataError
        If a length or a dose is not above 0, or there is no layer.
    """
    doses = np.atleast_1d(np.asarray(exposures, float))
    for name, values in (("penetration depth", [Dp_um]), ("layer thickness", [layer_um]), ("exposure", doses)):
        if not (np.size(values) and np.all(np.isfinite(values)) and np.all(np.asarray(values) > 0.0)):
            raise DataError(f"stack of layers: {name}", value=str(values), limit="must be above 0")
    q, window_side = math.exp(-layer_um / Dp_um), np.empty(len(doses))
    dose = 0.0
    for number in range(len(doses) - 1, -1, -1):
        dose = doses[number] + q * dose
        window_side[number] = dose
    return StackDose(layer_um, Dp_um, doses, window_side)

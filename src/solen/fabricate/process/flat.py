"""A lens printed flat: its profile is in the plane of the pixels, and varies with the height in the part.

All layers of a flat sensor have the same image. The dose at a height depends on the number of later layers. Deep inside
the part, all heights are equivalent except for the position within their layer; the last layers receive less light and
recede, and the burn-in layers receive more and protrude. The dose therefore tapers the walls, with a ripple whose
period is one layer. Light passes through the lens at half its thickness, where the emitter is: by default, the profile
is computed there and averaged over its layer.

Shrinkage, washing and additional taper are applied to the outline of the cured resin: everything shrinks about the
centre of the lens, and washing and taper move a wall along its normal.

`FlatPrint` returns offsets, profile and ripple of the lens at a height; `walls_um` returns the growth of walls against
height.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.field import FlatImage, dose_map
from solen.fabricate.process.growth import straight_edge_um
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Target, exits_um

STEP_UM = 2.0
MIN_PIXELS = 20
"""Minimum number of pixels across the lens."""
_QUADRATURE = ((0.5 - math.sqrt(0.15), 5 / 18), (0.5, 4 / 9), (0.5 + math.sqrt(0.15), 5 / 18))
"""Positions within a layer, from its window side, and weights of a Gauss–Legendre quadrature."""
_HEIGHTS = 16  # at which a profile is averaged over the thickness


@dataclass(frozen=True, eq=False)
class FlatPrint:
    """The region of the lens of a part with the same image in all layers."""

    settings: Settings
    image: FlatImage
    target: Target

    @classmethod
    def of(
        cls,
        rings: Sequence[FloatArray],
        target: Target,
        settings: Settings,
        thickness_mm: float,
        phase: tuple[float, float] = (0.0, 0.0),
    ) -> "FlatPrint":
        """Return the print of closed polylines (N, 2) in mm.

        Parameters
        ----------
        rings
            Drawn outlines: outer ones counter-clockwise, holes clockwise.
        target
            The designed lens.
        settings
            The process.
        thickness_mm
            Thickness of the part, which is printed as an integer number of layers.
        phase
            Position of the origin of the drawing in its pixel, 0 to 1 along x and z; (0, 0) is a corner.

        Raises
        ------
        DataError
            If the pixels are too coarse for the lens, or the part is thinner than a layer.
        """
        layers = round(thickness_mm * 1e3 / settings.layer_um)
        if layers < 1:
            limit = f"is less than half a layer of {settings.layer_um:g} µm"
            raise DataError("body.thickness_mm", value=thickness_mm, limit=limit, remedy="increase it")
        width_mm = float(np.ptp(target.points_mm[:, 0]))
        if width_mm < MIN_PIXELS * 1e-3 * settings.pixel_um:
            max_um = f"{1e3 * width_mm / MIN_PIXELS:.3g} µm"
            limit = (
                f"must be at most {max_um}: the lens, {width_mm:.3g} mm wide, must be at least {MIN_PIXELS} pixels wide"
            )
            remedy = "use a printer with smaller pixels"
            raise DataError("process.pixel_um", value=settings.pixel_um, limit=limit, remedy=remedy)
        image = FlatImage.of(rings, target.points_mm, settings, layers, phase)
        return cls(settings, image, target)

    @property
    def layers(self) -> int:
        """Number of layers."""
        return self.image.layers

    @property
    def thickness_um(self) -> float:
        """Total height of the layers."""
        return self.layers * self.settings.layer_um

    def offsets_um(self, height_um: float) -> FloatArray:
        """Return the deviation (N,) of the printed lens at a height, along the normals of the designed lens."""
        dose = dose_map(self.image, self.settings, height_um)
        centre = np.asarray(self.target.centre)
        enlargement = 1.0 / (1.0 - 0.01 * self.settings.shrinkage_percent)

        def excess(points_mm: FloatArray) -> FloatArray:
            return dose.log_excess(1e3 * (centre + enlargement * (points_mm - centre)))

        displacement = wash_and_taper_um(self.settings, height_um, self.thickness_um)
        return exits_um(excess, self.target, STEP_UM) + float(displacement)

    def profile_um(self, height_um: float | None = None) -> FloatArray:
        """Return offsets (N,) averaged over the layer at a height or, without a height, over the thickness."""
        if height_um is not None:
            return self._mean_of_layer(self.layer_at(height_um))
        heights = (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS * self.thickness_um
        return np.asarray(np.mean([self.offsets_um(float(height)) for height in heights], axis=0))

    def layer_at(self, height_um: float) -> int:
        """Return the index of the layer at a height; raise `DataError` outside the part."""
        if not 0.0 <= height_um <= self.thickness_um:
            limit = f"must be 0 to {1e-3 * self.thickness_um:g} mm"
            raise DataError("--at", value=1e-3 * height_um, limit=limit)
        return min(int(height_um / self.settings.layer_um), self.layers - 1)

    def _mean_of_layer(self, number: int) -> FloatArray:
        top = (number + 1) * self.settings.layer_um
        parts = [weight * self.offsets_um(top - position * self.settings.layer_um) for position, weight in _QUADRATURE]
        return np.asarray(np.sum(parts, axis=0))

    def ripple_um(self, height_um: float) -> float:
        """Return how far a straight wall recedes in the layer at a height, from its window side to its far side."""
        number, h = self.layer_at(height_um), self.settings.layer_um
        near, far = (number + 1) * h - 1e-9 * h, number * h + 1e-9 * h
        return straight_edge_um(self.settings, self.layers, near) - straight_edge_um(self.settings, self.layers, far)


def wash_and_taper_um(settings: Settings, height_um: ArrayLike, thickness_um: float) -> FloatArray:
    """Return the displacement of walls at heights of a part due to washing and additional taper."""
    slope = math.tan(math.radians(settings.taper_deg))
    return np.asarray(settings.wash_um + slope * (np.asarray(height_um) - 0.5 * thickness_um))


def walls_um(settings: Settings, layers: int) -> tuple[FloatArray, FloatArray]:
    """Return the mid-heights of layers, and the growth of a straight wall at each of them, without shrinkage."""
    heights = np.asarray((np.arange(layers) + 0.5) * settings.layer_um, float)
    edges = np.array([straight_edge_um(settings, layers, height) for height in heights.tolist()])
    return heights, edges + wash_and_taper_um(settings, heights, layers * settings.layer_um)

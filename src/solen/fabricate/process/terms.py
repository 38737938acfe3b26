"""Light at a height of a part: sharp and scattered light of all layers from that height on.

Resin at a height receives the exposures of its own layer and of all later layers, each attenuated by e^(-depth/Dp)
below the window (Jacobs, Rapid Prototyping & Manufacturing, 1992), or for each line separately if the lamp has several
lines. A dose is therefore a sum of blurred images. A fraction of the light is scattered into a halo, whose width
increases with depth. The halo is a Gaussian around the light of a pixel; if its standard deviation is h at the window,
it is sqrt(h² + (g d)²) at the depth d.

`terms_at` returns the `Terms` at a height.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.settings import Settings

MIN_FRACTION = 1e-9
"""Fraction of the maximum dose of a layer below which layers are neglected."""


@dataclass(frozen=True, eq=False)
class Terms:
    """Blurred images whose sum is a dose: index of the layer, dose in mJ/cm² and blur in µm, (T,) each."""

    layer: np.ndarray[tuple[int], np.dtype[np.int64]]
    dose: FloatArray
    sigma_um: FloatArray

    @property
    def total(self) -> float:
        """Total dose if every pixel of every layer is lit."""
        return float(self.dose.sum())


def terms_at(settings: Settings, layers: int, height_um: float) -> Terms:
    """Return the terms of the dose at a height above the build plate, in a part of ``layers`` layers.

    A height between two layers is treated as the far side of the later one. Below 0 is liquid resin under the first
    layer, as under an overhang: it receives the light transmitted through every layer.

    Raises
    ------
    DataError
        If the height is above the part.
    """
    h = settings.layer_um
    if not height_um <= layers * h:
        limit = f"must be at most {layers * h:g} µm, the height of the part"
        raise DataError("height", value=height_um, limit=limit)
    first = min(max(math.floor(height_um / h), 0), layers - 1)
    layer = np.arange(first, layers)
    depth = (layer + 1) * h - height_um
    dose = settings.exposures(layers)[first:] * settings.transmitted(depth)
    relevant = dose > MIN_FRACTION * dose.max()
    layer, depth, dose = layer[relevant], depth[relevant], dose[relevant]
    halo = np.hypot(settings.halo_um, settings.halo_per_depth * depth)
    scattered = settings.halo_fraction
    return Terms(
        np.concatenate([layer, layer]),
        np.concatenate([(1.0 - scattered) * dose, scattered * dose]),
        np.concatenate([np.full(len(layer), settings.blur_um), halo]),
    )

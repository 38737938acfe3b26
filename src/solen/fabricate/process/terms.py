"""Light at a height of a part: sharp and scattered light from each later layer through the layers in between.

Resin at a height receives the exposure of its own layer and of all later layers, each attenuated by e^(-depth/Dp) from
the window (Jacobs, Rapid Prototyping & Manufacturing, 1992), or for each line separately if the lamp has a spectrum. A
dose is therefore a sum of blurred images. A fraction of the light is scattered into a halo, whose width grows with
depth. The halo is a Gaussian about the light of a pixel; if its standard deviation is h at the window, it is sqrt(h² +
(g d)²) at the depth d.

`terms_at` returns the `Terms` at a height.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.settings import Settings

FAINT = 1e-9
"""Fraction of the dose below which later layers are neglected."""


@dataclass(frozen=True, eq=False)
class Terms:
    """Blurred images whose sum is a dose: layer number, dose in mJ/cm² and blur in µm, (T,) each."""

    layer: np.ndarray[tuple[int], np.dtype[np.int64]]
    dose: FloatArray
    sigma_um: FloatArray

    @property
    def total(self) -> float:
        """Total dose if every pixel of every layer is lit."""
        return float(self.dose.sum())


def terms_at(settings: Settings, layers: int, height_um: float) -> Terms:
    """Return the terms of the dose at a height above the platform, for a given number of layers.

    A height between two layers counts as the far side of the later one. Below 0 there is liquid under the first layer,
    as under an overhang: it receives the light transmitted through every layer.

    Raises
    ------
    DataError
        If the height is above the part.
    """
    h = settings.layer_um
    if not height_um <= layers * h:
        limit = f"the part ends at {layers * h:g} µm"
        raise DataError("height", value=f"{height_um:g} µm", limit=limit, remedy="choose a height within the part")
    first = min(max(math.floor(height_um / h), 0), layers - 1)
    number = np.arange(first, layers)
    depth = (number + 1) * h - height_um
    seen = settings.exposures(layers)[first:] * settings.left(depth)
    bright = seen > FAINT * seen.max()
    number, depth, seen = number[bright], depth[bright], seen[bright]
    halo = np.hypot(settings.halo_um, settings.halo_per_depth * depth)
    share = settings.halo_fraction
    return Terms(
        np.concatenate([number, number]),
        np.concatenate([(1.0 - share) * seen, share * seen]),
        np.concatenate([np.full(len(number), settings.blur_um), halo]),
    )

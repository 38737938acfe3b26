"""Light at a height of a part: narrow and wide light from each later layer through the layers in between.

The idea: resin at a height receives its own layer's exposure and those of all later layers, each attenuated by
e^(-depth/Dp) from the window (Jacobs, Rapid Prototyping & Manufacturing, 1992), or line by line for a
lamp with a spectrum, so a dose is a sum of
blurred images. A share of the light is scattered: it makes a halo, whose width grows with depth. The halo is a Gaussian
about the light of a pixel; one of standard deviation h at the window is sqrt(h² + (g d)²) wide at the depth d.

The interface: `terms_at` gives the `Terms` of a height.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.settings import Settings

FAINT = 1e-9
"""Share of the dose below which later layers are left out."""


@dataclass(frozen=True, eq=False)
class Terms:
    """Blurred images that a dose is the sum of: number of the layer, dose in mJ/cm² and blur in µm, (T,) each."""

    layer: np.ndarray[tuple[int], np.dtype[np.int64]]
    dose: FloatArray
    sigma_um: FloatArray

    @property
    def total(self) -> float:
        """Dose with every pixel of every layer lit."""
        return float(self.dose.sum())


def terms_at(settings: Settings, layers: int, height_um: float) -> Terms:
    """Terms of the dose at a height above the platform, in a part of some layers.

    A height between two layers is the later one's far side. Below 0 there is liquid under the first layer, as under an
    overhang: it receives what every layer lets through.

    Raises
    ------
    DataError
        For a height above the part.
    """
    h = settings.layer_um
    if not height_um <= layers * h:
        limit = f"the part ends at {layers * h:g} µm"
        raise DataError("height", value=f"{height_um:g} µm", limit=limit, remedy="name one within it")
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

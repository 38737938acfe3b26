"""Lens region of a part printed flat whose layers show different images.

Resin at a height receives the exposure of its own layer and of all later layers, each blurred and attenuated by the
layers in between (`solen.fabricate.process.terms`). With different images per layer, a dose is a sum over them: light
from a protruding layer sets resin below it, and a layer below receding layers receives less. The sums are computed as
spectra, as in `solen.fabricate.process.field`: the sharp light of all layers has the same blur, so its images are
summed first; scattered light, whose width grows with depth, is summed in `GROUPS` groups of similar width.

`Stack.offsets_um` returns the deviation of the face of one layer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from solen.arrays import FloatArray, IntArray
from solen.fabricate.process.field import DoseMap, FlatImage, Spectrum, fine_dose
from solen.fabricate.process.flat import STEP_UM, beyond_dose_um
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Target, exits_um
from solen.fabricate.process.terms import Terms, terms_at
from solen.plane import Point

Rings = Sequence[FloatArray]
GROUPS = 8
"""Number of groups of scattered light with similar widths."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Images of a part's layers near its lens, and the process that prints them.

    Attributes
    ----------
    spectra
        Spectra of the distinct images, (I, rows, columns).
    image
        Image index of each layer, (L,), from the build plate.
    grid
        One of the images, which defines the pixels.
    """

    settings: Settings
    spectra: Spectrum
    image: IntArray
    grid: FlatImage

    @classmethod
    def of(
        cls, layers: Sequence[Rings], extent: FloatArray, settings: Settings, phase: tuple[float, float] = (0.0, 0.0)
    ) -> "Stack":
        """Return a stack of closed polylines (N, 2) in mm by layer, over the extent of points (M, 2) with a margin.

        Layers drawn by the same object share one image. Raises the errors of `FlatImage.of`.
        """
        kinds = list({id(rings): rings for rings in layers}.values())
        number = {id(rings): i for i, rings in enumerate(kinds)}
        images = [FlatImage.of(rings, extent, settings, len(layers), phase) for rings in kinds]
        spectra = np.array([fft.fft2(image.shares) for image in images])
        return cls(settings, spectra, np.array([number[id(rings)] for rings in layers]), images[0])

    @property
    def layers(self) -> int:
        """Number of layers."""
        return len(self.image)

    def height_um(self, layer: int) -> float:
        """Return the mid-height of a layer above the platform."""
        return (layer + 0.5) * self.settings.layer_um

    def dose(self, layer: int) -> DoseMap:
        """Return the dose at mid-height of a layer."""
        terms = terms_at(self.settings, self.layers, self.height_um(layer))
        summed = [(self._summed(terms, some), np.ones(1), np.array([width])) for some, width in _groups(terms)]
        return fine_dose(self.grid, self.settings, summed)

    def offsets_um(self, layer: int, target: Target, centre: Point) -> FloatArray:
        """Deviation of the printed face from the intended face at mid-height of a layer, (N,) along its normals."""
        dose, middle = self.dose(layer), np.asarray(centre)
        grown = 1.0 / (1.0 - 0.01 * self.settings.shrinkage_percent)

        def excess(places_mm: FloatArray) -> FloatArray:
            return dose.log_excess(1e3 * (middle + grown * (places_mm - middle)))

        thickness_um = self.layers * self.settings.layer_um
        return exits_um(excess, target, STEP_UM) + float(
            beyond_dose_um(self.settings, self.height_um(layer), thickness_um)
        )

    def _summed(self, terms: Terms, chosen: IntArray) -> Spectrum:
        """Return the summed spectrum of the images of the given terms, each weighted by its dose."""
        weights = np.bincount(self.image[terms.layer[chosen]], terms.dose[chosen], len(self.spectra))
        used = np.flatnonzero(weights)
        return np.tensordot(weights[used], self.spectra[used], axes=1)


def _groups(terms: Terms) -> list[tuple[IntArray, float]]:
    """Indices of terms with similar widths, and the width of each group: sharp, then scattered light by depth."""
    half = len(terms.dose) // 2
    groups = [np.arange(half)]
    if terms.dose[half:].any():
        shares = np.cumsum(terms.dose[half:]) / terms.dose[half:].sum()
        groups += [
            half + np.flatnonzero((shares > i / GROUPS) & (shares <= (i + 1) / GROUPS + 1e-12)) for i in range(GROUPS)
        ]
    return [
        (some, float(np.sqrt(np.average(terms.sigma_um[some] ** 2, weights=terms.dose[some]))))
        for some in groups
        if len(some)
    ]

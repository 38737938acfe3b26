"""Lens region of a part printed flat whose layers have different images.

Resin at a height receives the exposures of its own layer and of all later layers, each blurred and attenuated by the
layers in between (`solen.fabricate.process.terms`). If the images of layers differ, a dose is a sum over images: light
of a protruding layer cures resin below it, and a layer below receding layers receives less. The sums are computed as
spectra, as in `solen.fabricate.process.field`: the sharp light of all layers has the same blur, so its images are
summed first; scattered light, whose width increases with depth, is summed in `GROUPS` groups of similar width.

`Stack.offsets_um` returns the deviation of the face of one layer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from solen.arrays import FloatArray, IntArray
from solen.fabricate.process.field import DoseMap, FlatImage, Spectrum, fine_dose
from solen.fabricate.process.flat import STEP_UM, wash_and_taper_um
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.target import Target, exits_um
from solen.fabricate.process.terms import Terms, terms_at
from solen.plane import Point

Rings = Sequence[FloatArray]
GROUPS = 8
"""Number of groups of scattered light with similar widths."""


@dataclass(frozen=True, eq=False)
class Stack:
    """Images of the layers of a part near its lens, and the process that prints them.

    Attributes
    ----------
    spectra
        Spectra of the distinct images, (I, rows, columns).
    image
        Index of the image of each layer, (L,), from the build plate.
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
        """Return the stack of layers over the extent of points (M, 2) with a margin.

        A layer is given as closed polylines (N, 2) in mm; layers given by the same object share one image.
        The errors are those of `FlatImage.of`.
        """
        distinct = list({id(rings): rings for rings in layers}.values())
        index = {id(rings): i for i, rings in enumerate(distinct)}
        images = [FlatImage.of(rings, extent, settings, len(layers), phase) for rings in distinct]
        spectra = np.array([fft.fft2(image.light) for image in images])
        return cls(settings, spectra, np.array([index[id(rings)] for rings in layers]), images[0])

    @property
    def layers(self) -> int:
        """Number of layers."""
        return len(self.image)

    def height_um(self, layer: int) -> float:
        """Return the mid-height of a layer above the plate."""
        return (layer + 0.5) * self.settings.layer_um

    def dose(self, layer: int) -> DoseMap:
        """Return the dose at mid-height of a layer."""
        terms = terms_at(self.settings, self.layers, self.height_um(layer))
        summed = [(self._summed(terms, group), np.ones(1), np.array([width])) for group, width in _groups(terms)]
        return fine_dose(self.grid, self.settings, summed)

    def offsets_um(self, layer: int, target: Target, centre: Point) -> FloatArray:
        """Return the deviation (N,) of the printed face at mid-height of a layer, along the normals of the target."""
        dose, origin = self.dose(layer), np.asarray(centre)
        enlargement = 1.0 / (1.0 - 0.01 * self.settings.shrinkage_percent)

        def excess(points_mm: FloatArray) -> FloatArray:
            return dose.log_excess(1e3 * (origin + enlargement * (points_mm - origin)))

        thickness_um = self.layers * self.settings.layer_um
        displacement = wash_and_taper_um(self.settings, self.height_um(layer), thickness_um)
        return exits_um(excess, target, STEP_UM) + float(displacement)

    def _summed(self, terms: Terms, chosen: IntArray) -> Spectrum:
        """Return the spectrum of the sum of the images of the ``chosen`` terms, weighted by their doses."""
        weights = np.bincount(self.image[terms.layer[chosen]], terms.dose[chosen], len(self.spectra))
        used = np.flatnonzero(weights)
        return np.tensordot(weights[used], self.spectra[used], axes=1)


def _groups(terms: Terms) -> list[tuple[IntArray, float]]:
    """Return groups of terms with similar widths, sharp light first: the indices of the terms, and their RMS width."""
    half = len(terms.dose) // 2
    groups = [np.arange(half)]
    if terms.dose[half:].any():
        fraction = np.cumsum(terms.dose[half:]) / terms.dose[half:].sum()
        groups += [
            half + np.flatnonzero((fraction > i / GROUPS) & (fraction <= (i + 1) / GROUPS + 1e-12))
            for i in range(GROUPS)
        ]
    return [
        (group, float(np.sqrt(np.average(terms.sigma_um[group] ** 2, weights=terms.dose[group]))))
        for group in groups
        if len(group)
    ]

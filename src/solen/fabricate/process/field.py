"""The same dose fast: images by Fourier transform, on a grid finer than the pixels, and between its points by splines.

The idea: every term of a dose is an image convolved with a pixel's square and a Gaussian, so its spectrum is a product:
the image's, sinc·sinc, exp(-σ²k²/2). Terms of one image add up before anything is transformed back, which makes a part
of any number of like layers one transform there and one back. The Gaussian ends the spectrum, so a fine grid holds the
dose to rounding (the grid is chosen so that the narrowest blur is down to `FAINTEST` at its end), and a cubic spline of
the logarithm, which is nearly a parabola at an edge, gives it in between.

A transform is periodic: images must be dark, or alike, within a few widths of the halo from their sides.

The interface: `Images` of a part, `dose_map` at a height, `DoseMap.log_excess` at places.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, ndimage

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.terms import terms_at

FAINTEST = 1e-6
"""Relative size of the narrowest blur's spectrum at the end of the fine grid's."""
LEAST_FINE, MOST_FINE = 3, 16
DARK = 1e-12
"""Share of the dose inside below which its logarithm is not followed."""


@dataclass(frozen=True, eq=False)
class Images:
    """Images of a part: the distinct ones, and which of them each layer shows.

    Attributes
    ----------
    images
        Shares of light (rows, columns) each, all of one shape.
    of_layer
        Number of the image for each layer, the first printed first.
    corner_um
        Lower left corner of the first pixel: along columns, along rows.
    """

    images: tuple[FloatArray, ...]
    of_layer: NDArray[np.int64]
    corner_um: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def prism(cls, image: FloatArray, layers: int, corner_um: tuple[float, float] = (0.0, 0.0)) -> "Images":
        """Part whose layers all show one image."""
        return cls((image,), np.zeros(layers, np.int64), corner_um)

    @classmethod
    def stack(cls, images: Sequence[FloatArray], corner_um: tuple[float, float] = (0.0, 0.0)) -> "Images":
        """Part with an image for each layer."""
        return cls(tuple(images), np.arange(len(images)), corner_um)

    @property
    def layers(self) -> int:
        """Number of layers."""
        return len(self.of_layer)

    @cached_property
    def spectra(self) -> tuple[NDArray[np.complex128], ...]:
        """Fourier transforms of the images, pixels taken as points."""
        return tuple(fft.fft2(image) for image in self.images)


@dataclass(frozen=True, eq=False)
class DoseMap:
    """Dose at one height on a fine grid.

    Attributes
    ----------
    dose
        In mJ/cm², (rows, columns).
    first_um
        Place of its first point: along columns, along rows.
    step_um
        Distance of its points.
    Ec_mJ_per_cm2
        Critical dose.
    """

    dose: FloatArray
    first_um: tuple[float, float]
    step_um: float
    Ec_mJ_per_cm2: float

    @cached_property
    def _spline(self) -> FloatArray:
        floor = max(float(self.dose.max()) * DARK, 1e-300)
        excess = np.log(np.maximum(self.dose, floor) / self.Ec_mJ_per_cm2)
        return np.asarray(ndimage.spline_filter(excess, order=3, mode="nearest"))

    def log_excess(self, places_um: ArrayLike) -> FloatArray:
        """Logarithm of dose over critical dose at places (..., 2) in µm; above 0 the resin is set."""
        places = np.asarray(places_um, float)
        at = [(places[..., axis] - self.first_um[axis]) / self.step_um for axis in (1, 0)]
        return np.asarray(ndimage.map_coordinates(self._spline, at, order=3, mode="nearest", prefilter=False))


def dose_map(images: Images, settings: Settings, height_um: float) -> DoseMap:
    """Dose of a part at a height above the platform, on a grid some times finer than the pixels."""
    pitch, fine = settings.pixel_um, fineness(settings)
    rows, columns = images.images[0].shape
    terms = terms_at(settings, images.layers, height_um)
    across = _frequencies(columns, fine, pitch)[: columns * fine // 2 + 1]
    along = _frequencies(rows, fine, pitch)
    whole = np.zeros((len(along), len(across)), complex)
    which = images.of_layer[terms.layer]
    for number in np.unique(which):
        chosen = which == number
        blur = _blur(along, across, *_merged(terms.dose[chosen], terms.sigma_um[chosen]))
        spectrum = np.tile(images.spectra[number], (fine, fine))[:, : len(across)]
        whole += spectrum * blur
    whole *= np.outer(np.sinc(along * pitch / math.tau), np.sinc(across * pitch / math.tau))
    dose = fft.irfft2(whole, s=(rows * fine, columns * fine)) * fine**2
    first = (images.corner_um[0] + pitch / 2, images.corner_um[1] + pitch / 2)
    return DoseMap(dose, first, pitch / fine, settings.Ec_mJ_per_cm2)


def fineness(settings: Settings) -> int:
    """Points of the fine grid for each pixel.

    Raises
    ------
    DataError
        Where the blur is so much smaller than a pixel that the grid would be too fine.
    """
    width = math.sqrt(-2.0 * math.log(FAINTEST))
    needed = math.ceil(width * settings.pixel_um / (math.pi * settings.sigma_um))
    if needed > MOST_FINE:
        least = width * settings.pixel_um / (math.pi * MOST_FINE)
        limit = f"must be at least {least:.2g} µm for pixels of {settings.pixel_um:g} µm"
        raise DataError("process.sigma_um", value=settings.sigma_um, limit=limit, remedy="no projector is sharper")
    return max(needed, LEAST_FINE)


def _frequencies(count: int, fine: int, pitch: float) -> FloatArray:
    """Angular frequencies per µm of a fine grid along one side."""
    return np.asarray(math.tau * fft.fftfreq(count * fine, pitch / fine))


def _merged(dose: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Terms of the same blur added up."""
    kinds, which = np.unique(sigma, return_inverse=True)
    return np.asarray(np.bincount(which, dose), float), kinds


def _blur(along: FloatArray, across: FloatArray, dose: FloatArray, sigma: FloatArray) -> FloatArray:
    """Spectrum of a sum of Gaussians: each is a product of one along and one across."""
    first = np.exp(-0.5 * np.outer(sigma, along) ** 2) * dose[:, None]
    second = np.exp(-0.5 * np.outer(sigma, across) ** 2)
    return np.asarray(first.T @ second)

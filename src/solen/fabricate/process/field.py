"""Dose in a part printed flat, computed by Fourier transform on a fine grid and interpolated by splines.

The grid is finer than the pixels. Every term of a dose is an image convolved with the light of one pixel and a
Gaussian. Its spectrum is therefore the product of the spectrum of the image, that of the pixel
(`solen.fabricate.process.response`) and exp(-σ²k²/2). Terms with the same image are added before the inverse transform;
a part whose layers all show one image needs only one transform in each direction. The pixel blur limits the spectrum,
so a fine grid represents the dose to within rounding error. Between grid points, the dose is interpolated by a cubic
spline of its logarithm, which is nearly a parabola at an edge.

A transform is periodic: within a few halo widths of its borders, an image must be dark or uniform.
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
from solen.fabricate.grey import FULL
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.terms import terms_at
from solen.fabricate.raster import coverage

Spectrum = NDArray[np.complex128]
DARK = 1e-12
"""Fraction of the maximum dose below which its logarithm is cut off."""
MAX_POINTS = 20_000_000
MAX_LAYERS = 10_000
_FAR = 6.0  # widths of the halo that are kept free around the lens
_DEEP = 3.0  # depth, in penetration depths, at which the halo's width is evaluated for this
_REACH_UM = 300.0


@dataclass(frozen=True, eq=False)
class FlatImage:
    """The image shown by all layers of a part printed flat.

    Attributes
    ----------
    shares
        Fractions of the full light (rows, columns), 0 to 1.
    layers
        Number of layers.
    corner_um
        Lower left corner of the first pixel: along columns, along rows.
    """

    shares: FloatArray
    layers: int
    corner_um: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(
        cls,
        rings: Sequence[FloatArray],
        extent: FloatArray,
        settings: Settings,
        layers: int,
        phase: tuple[float, float] = (0.0, 0.0),
    ) -> "FlatImage":
        """Return an image of closed polylines (N, 2) in mm, over the extent of points (M, 2) with a margin.

        The drawing origin is at ``phase`` in its pixel, as drawn by `solen.fabricate.layers`; (0, 0) is a corner.

        Raises
        ------
        DataError
            If a print would exceed the memory of a laptop, or take minutes for each height.
        """
        pitch = 1e-3 * np.array(settings.pixels_um)
        halo = math.hypot(settings.halo_um, settings.halo_per_depth * _DEEP * settings.Dp_um)
        margin = 1e-3 * (max(_FAR * halo, settings.pixel_light.reach_um) + _REACH_UM)
        grid = -pitch * np.asarray(phase)
        first = np.floor((extent.min(axis=0) - margin - grid) / pitch)
        last = np.ceil((extent.max(axis=0) + margin - grid) / pitch)
        columns, rows = (fft.next_fast_len(int(count), real=True) for count in (last - first))
        x, z = (grid + first * pitch).tolist()
        _check_size(rows * columns, layers, settings)
        shares = coverage(rings, (float(pitch[0]), float(pitch[1])), (x, z), (rows, columns))
        return cls(settings.greys.light[np.rint(FULL * shares).astype(np.uint8)], layers, (1e3 * x, 1e3 * z))

    @cached_property
    def spectrum(self) -> NDArray[np.complex128]:
        """Fourier transform of the image, with pixels as points."""
        return np.asarray(fft.fft2(self.shares))


@dataclass(frozen=True, eq=False)
class DoseMap:
    """Dose at one height on a fine grid.

    Attributes
    ----------
    dose
        Dose in mJ/cm², (rows, columns).
    first_um
        Position of the first grid point: along columns, along rows.
    step_um
        Grid spacing: along columns, along rows.
    Ec_mJ_per_cm2
        Critical dose.
    """

    dose: FloatArray
    first_um: tuple[float, float]
    step_um: tuple[float, float]
    Ec_mJ_per_cm2: float

    @cached_property
    def _spline(self) -> FloatArray:
        floor = max(float(self.dose.max()) * DARK, 1e-300)
        excess = np.log(np.maximum(self.dose, floor) / self.Ec_mJ_per_cm2)
        return np.asarray(ndimage.spline_filter(excess, order=3, mode="nearest"))

    def log_excess(self, places_um: ArrayLike) -> FloatArray:
        """Return the logarithm of dose over critical dose at points (..., 2) in µm; above 0 the resin is set."""
        places = np.asarray(places_um, float)
        at = [(places[..., axis] - self.first_um[axis]) / self.step_um[axis] for axis in (1, 0)]
        return np.asarray(ndimage.map_coordinates(self._spline, at, order=3, mode="nearest", prefilter=False))


def dose_map(image: FlatImage, settings: Settings, height_um: float) -> DoseMap:
    """Dose of a part at a height above the platform, on a grid finer than the pixels by an integer factor."""
    terms = terms_at(settings, image.layers, height_um)
    return fine_dose(image, settings, [(image.spectrum, *_merged(terms.dose, terms.sigma_um))])


def fine_dose(
    image: FlatImage, settings: Settings, terms: Sequence[tuple[Spectrum, FloatArray, FloatArray]]
) -> DoseMap:
    """Return the dose on the pixels of an image, from terms (spectrum, doses in mJ/cm² (T,), blurs in µm (T,))."""
    (x, y), pixel = settings.pixels_um, settings.pixel_light
    fine = pixel.fine
    rows, columns = (fine * count for count in image.shares.shape)
    across, along = math.tau * fft.rfftfreq(columns, x / fine), math.tau * fft.fftfreq(rows, y / fine)
    whole = np.zeros((len(along), len(across)), np.complex128)
    for spectrum, doses, blurs in terms:
        beyond = np.sqrt(np.maximum(blurs**2 - pixel.blur_um**2, 0.0))
        whole += np.tile(spectrum, (fine, fine))[:, : len(across)] * _blur(along, across, doses, beyond)
    whole *= pixel.plane((rows, columns), (x / fine, y / fine))
    dose = fft.irfft2(whole, s=(rows, columns)) * fine**2
    first = (image.corner_um[0] + x / 2, image.corner_um[1] + y / 2)
    return DoseMap(dose, first, (x / fine, y / fine), settings.Ec_mJ_per_cm2)


def _check_size(pixels: int, layers: int, settings: Settings) -> None:
    points = pixels * settings.pixel_light.fine**2
    if points > MAX_POINTS:
        limit = f"the part with {_FAR:g} halo widths requires {points:.2g} grid points; the limit is {MAX_POINTS:.1g}"
        remedy = "use larger pixels, a narrower halo or a smaller part"
        raise DataError("process.halo_um", value=settings.halo_um, limit=limit, remedy=remedy)
    if layers > MAX_LAYERS:
        limit = f"the part would have {layers:,} layers; the limit is {MAX_LAYERS:,}"
        raise DataError("process.layer_um", value=settings.layer_um, limit=limit, remedy="use thicker layers")


def _merged(dose: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Add the terms with the same blur."""
    kinds, which = np.unique(sigma, return_inverse=True)
    return np.asarray(np.bincount(which, dose), float), kinds


def _blur(along: FloatArray, across: FloatArray, dose: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the spectrum of a sum of Gaussians, each the product of a Gaussian along and a Gaussian across."""
    first = np.exp(-0.5 * np.outer(sigma, along) ** 2) * dose[:, None]
    second = np.exp(-0.5 * np.outer(sigma, across) ** 2)
    return np.asarray(first.T @ second)

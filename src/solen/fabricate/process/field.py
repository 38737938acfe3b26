"""Dose in a part printed flat, computed by Fourier transform on a fine grid and interpolated by splines.

The grid is finer than the pixels. Every term of a dose is an image convolved with the light of one pixel and a
Gaussian. Its spectrum is therefore the product of the spectrum of the image, that of the pixel
(`solen.fabricate.process.response`) and exp(-σ²k²/2). Terms with the same image are added before the inverse transform;
a part with the same image in all layers requires only one transform in each direction. The blur of the pixels limits
the spectrum, so that a fine grid represents the dose to within rounding errors. Between grid points, the dose is
interpolated by a cubic spline of its logarithm, which is nearly a parabola at an edge.

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
MIN_DOSE = 1e-12
"""Minimum dose, as a fraction of the maximum, to which smaller doses are set before the logarithm is taken."""
MAX_POINTS = 20_000_000
MAX_LAYERS = 10_000
_MARGIN_WIDTHS = 6.0  # margin around the lens, in widths of the halo
_HALO_DEPTH = 3.0  # depth at which this width is evaluated, in penetration depths
_MIN_MARGIN_UM = 300.0


@dataclass(frozen=True, eq=False)
class FlatImage:
    """The image of all layers of a part printed flat.

    Attributes
    ----------
    light
        Fractions of the full light (rows, columns), 0 to 1.
    layers
        Number of layers.
    corner_um
        X and Y of the lower left corner of the first pixel.
    """

    light: FloatArray
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
        """Return the image of closed polylines (N, 2) in mm, over the extent of points (M, 2) with a margin.

        ``phase`` is the position of the origin of the drawing in its pixel, 0 to 1 along x and z; (0, 0) is a corner.

        Raises
        ------
        DataError
            If the image has too many pixels, or the part has too many layers.
        """
        pitch = 1e-3 * np.array(settings.pixels_um)
        halo = math.hypot(settings.halo_um, settings.halo_per_depth * _HALO_DEPTH * settings.Dp_um)
        margin = 1e-3 * (max(_MARGIN_WIDTHS * halo, settings.pixel_light.reach_um) + _MIN_MARGIN_UM)
        grid = -pitch * np.asarray(phase)
        first = np.floor((extent.min(axis=0) - margin - grid) / pitch)
        last = np.ceil((extent.max(axis=0) + margin - grid) / pitch)
        columns, rows = (fft.next_fast_len(int(count), real=True) for count in (last - first))
        x, z = (grid + first * pitch).tolist()
        _check_size(rows * columns, layers, settings)
        covered = coverage(rings, (float(pitch[0]), float(pitch[1])), (x, z), (rows, columns))
        return cls(settings.greys.light[np.rint(FULL * covered).astype(np.uint8)], layers, (1e3 * x, 1e3 * z))

    @cached_property
    def spectrum(self) -> NDArray[np.complex128]:
        """Fourier transform of the image, whose pixels are treated as points."""
        return np.asarray(fft.fft2(self.light))


@dataclass(frozen=True, eq=False)
class DoseMap:
    """Dose at one height on a fine grid.

    Attributes
    ----------
    dose
        Dose in mJ/cm², (rows, columns).
    first_um
        X and Y of the first grid point.
    step_um
        Grid spacing along X and Y.
    Ec_mJ_per_cm2
        Critical dose.
    """

    dose: FloatArray
    first_um: tuple[float, float]
    step_um: tuple[float, float]
    Ec_mJ_per_cm2: float

    @cached_property
    def _spline(self) -> FloatArray:
        floor = max(float(self.dose.max()) * MIN_DOSE, 1e-300)
        excess = np.log(np.maximum(self.dose, floor) / self.Ec_mJ_per_cm2)
        return np.asarray(ndimage.spline_filter(excess, order=3, mode="nearest"))

    def log_excess(self, points_um: ArrayLike) -> FloatArray:
        """Return the logarithm of dose over critical dose at points (..., 2) in µm; above 0, the resin is cured."""
        points = np.asarray(points_um, float)
        indices = [(points[..., axis] - self.first_um[axis]) / self.step_um[axis] for axis in (1, 0)]
        return np.asarray(ndimage.map_coordinates(self._spline, indices, order=3, mode="nearest", prefilter=False))


def dose_map(image: FlatImage, settings: Settings, height_um: float) -> DoseMap:
    """Return the dose of a part at a height above the plate, on a grid finer than the pixels by an integer factor."""
    terms = terms_at(settings, image.layers, height_um)
    return fine_dose(image, settings, [(image.spectrum, *_merged(terms.dose, terms.sigma_um))])


def fine_dose(
    image: FlatImage, settings: Settings, terms: Sequence[tuple[Spectrum, FloatArray, FloatArray]]
) -> DoseMap:
    """Return the dose on the grid of an image, from terms (spectrum, doses in mJ/cm² (T,), blurs in µm (T,))."""
    (x, y), pixel = settings.pixels_um, settings.pixel_light
    fine = pixel.fine
    rows, columns = (fine * count for count in image.light.shape)
    kx, ky = math.tau * fft.rfftfreq(columns, x / fine), math.tau * fft.fftfreq(rows, y / fine)
    total = np.zeros((len(ky), len(kx)), np.complex128)
    for spectrum, doses, blurs in terms:
        additional = np.sqrt(np.maximum(blurs**2 - pixel.blur_um**2, 0.0))
        total += np.tile(spectrum, (fine, fine))[:, : len(kx)] * _blur_spectrum(kx, ky, doses, additional)
    total *= pixel.plane((rows, columns), (x / fine, y / fine))
    dose = fft.irfft2(total, s=(rows, columns)) * fine**2
    first = (image.corner_um[0] + x / 2, image.corner_um[1] + y / 2)
    return DoseMap(dose, first, (x / fine, y / fine), settings.Ec_mJ_per_cm2)


def _check_size(pixels: int, layers: int, settings: Settings) -> None:
    points = pixels * settings.pixel_light.fine**2
    if points > MAX_POINTS:
        size = f"the part and {_MARGIN_WIDTHS:g} halo widths around it require {points:.2g} grid points"
        limit = f"is too large: {size}, more than {MAX_POINTS:.1g}"
        remedy = "use larger pixels, a narrower halo or a smaller part"
        raise DataError("process.halo_um", value=settings.halo_um, limit=limit, remedy=remedy)
    if layers > MAX_LAYERS:
        limit = f"is too small: the part would have {layers:,} layers, more than {MAX_LAYERS:,}"
        raise DataError("process.layer_um", value=settings.layer_um, limit=limit, remedy="use thicker layers")


def _merged(dose: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return doses and blurs, with the doses of equal blurs added."""
    widths, index = np.unique(sigma, return_inverse=True)
    return np.asarray(np.bincount(index, dose), float), widths


def _blur_spectrum(kx: FloatArray, ky: FloatArray, dose: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the spectrum of a sum of Gaussians, each of which is the product of Gaussians along X and Y."""
    along_y = np.exp(-0.5 * np.outer(sigma, ky) ** 2) * dose[:, None]
    along_x = np.exp(-0.5 * np.outer(sigma, kx) ** 2)
    return np.asarray(along_y.T @ along_x)

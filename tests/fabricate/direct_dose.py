"""Dose in a part by direct sums over all pixels of all layers: slow, readable, and the reference of other computations.

A pixel is a uniformly lit rectangle blurred by a Gaussian, and the integral of a Gaussian over an interval is a
difference of two error functions. Nothing is sampled and nothing is periodic, so the sums are exact at any point. If
the light of a pixel is a measured table, its samples are added pixel by pixel: as a cubic spline for the direct light,
and each as a Gaussian for the scattered light.

`dose_at` returns the dose at points of one height, `cured_um` the cure depth of a lit area.
"""

import math

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq
from scipy.special import ndtr

from solen.arrays import FloatArray
from solen.fabricate.process.settings import Settings


def dose_at(images: FloatArray, settings: Settings, points_um: FloatArray, height_um: float) -> FloatArray:
    """Return the dose in mJ/cm² at points of one height, after the last layer.

    Parameters
    ----------
    images
        Light of the pixels (layers, rows, columns) as fractions of full light, first layer first; the pixel in row i
        and column j has its lower left corner at (j, i) pixels.
    settings
        The process.
    points_um
        Points (N, 2), x along a row and y along a column, from the corner of the first pixel.
    height_um
        Height above the plate; below 0 is liquid under the first layer.

    Returns
    -------
    dose
        Shape (N,).
    """
    h, pitch = settings.layer_um, settings.pixels_um
    first = min(max(math.floor(height_um / h), 0), len(images) - 1)
    dose = np.zeros(len(points_um))
    for index in range(first, len(images)):
        depth_um = (index + 1) * h - height_um
        attenuated = settings.exposures(len(images))[index] * math.exp(-depth_um / settings.Dp_um)
        halo_um = math.hypot(settings.halo_um, settings.halo_per_depth * depth_um)
        if settings.response is None:
            direct = _blurred(images[index], pitch, settings.sigma_um or 0.0, points_um)
            scattered = _blurred(images[index], pitch, halo_um, points_um)
        else:
            direct, scattered = _responses(images[index], settings, halo_um, points_um)
        dose += attenuated * ((1.0 - settings.halo_fraction) * direct + settings.halo_fraction * scattered)
    return dose


def _blurred(image: FloatArray, pitch: tuple[float, float], sigma: float, points: FloatArray) -> FloatArray:
    """Return the image at points after a Gaussian blur: each pixel contributes a product of two integrals."""
    rows, columns = image.shape
    x, y = (
        _fractions(pitch[axis] * np.arange(count, dtype=float), pitch[axis], sigma, points[:, axis])
        for axis, count in ((0, columns), (1, rows))
    )
    return np.asarray(np.einsum("nj,ni,ij->n", x, y, image))


def _fractions(start: FloatArray, pitch: float, sigma: float, positions: FloatArray) -> FloatArray:
    """Return the fractions (N, M) of Gaussians about positions (N,) that fall into intervals (M,)."""
    offset = positions[:, None] - start
    return np.asarray(ndtr(offset / sigma) - ndtr((offset - pitch) / sigma))


def _responses(
    image: FloatArray, settings: Settings, halo_um: float, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the direct and the scattered light of an image at points, for a measured response."""
    assert settings.response is not None
    light, step = np.array(settings.response.light), settings.response_scale * settings.response.pitch_um
    x, y = (step * np.arange(count, dtype=float) for count in light.shape[::-1])
    weights = light / light.sum()
    centroid = np.array([weights.sum(axis=0) @ x, weights.sum(axis=1) @ y])
    variance = 0.5 * (weights.sum(axis=0) @ (x - centroid[0]) ** 2 + weights.sum(axis=1) @ (y - centroid[1]) ** 2)
    pixel_variance = np.square(settings.pixels_um).sum() / 24.0
    sigma = math.sqrt(halo_um**2 - max(variance - pixel_variance, 0.0))
    centre = centroid
    if settings.response.centre_um is not None:
        centre = settings.response_scale * np.array(settings.response.centre_um)
    margin = 12
    rows, columns = (step * np.arange(-margin, count + margin, dtype=float) for count in light.shape)
    spline = RectBivariateSpline(rows, columns, np.pad(weights, margin) / step**2)
    direct, scattered = np.zeros(len(points)), np.zeros(len(points))
    (width, height), area = settings.pixels_um, math.prod(settings.pixels_um)
    for i, j in zip(*np.nonzero(image), strict=True):
        offset = points - np.array([(j + 0.5) * width, (i + 0.5) * height]) + centre
        direct += image[i, j] * area * spline.ev(offset[:, 1], offset[:, 0])
        gaussian = np.exp(
            -0.5 * ((offset[:, 0, None, None] - x) ** 2 + (offset[:, 1, None, None] - y[:, None]) ** 2) / sigma**2
        )
        scattered += image[i, j] * area * np.einsum("nyx,yx->n", gaussian, weights) / (math.tau * sigma**2)
    return direct, scattered


def cured_um(settings: Settings, layers: int = 1) -> float:
    """Return the cure depth of a wide lit area over liquid, from the window side of the first of some layers.

    For one layer, that is Dp ln(E/Ec) according to Jacobs.
    """
    lit = np.ones((layers, 1, 1))
    wide = settings.model_copy(update={"pixel_um": 1e6})
    centre = np.array([[0.5e6, 0.5e6]])

    def excess(height_um: float) -> float:
        return float(np.log(dose_at(lit, wide, centre, height_um)[0] / settings.Ec_mJ_per_cm2))

    top = settings.layer_um
    return top - float(brentq(excess, top - 60.0 * settings.Dp_um, top, xtol=1e-12, rtol=1e-15))

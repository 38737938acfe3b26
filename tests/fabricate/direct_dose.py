"""Dose in a part by direct sums over every pixel of every layer: slow, readable, and the truth that others must meet.

The idea: a pixel is a square of even light, blurred by a Gaussian, and the integral of a Gaussian over an interval is a
difference of two error functions. Nothing is sampled and nothing wraps round, so these sums are exact at any place for
the images that they are given. Where the light of a pixel is a measured table, its samples are put down pixel by pixel:
as a cubic spline for what arrives straight, each as a Gaussian for what is scattered.

The interface: `dose_at` places at one height, and `cured_um` for how deep a lit area sets.
"""

import math

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq
from scipy.special import ndtr

from solen.arrays import FloatArray
from solen.fabricate.process.settings import Settings


def dose_at(images: FloatArray, settings: Settings, places_um: FloatArray, height_um: float) -> FloatArray:
    """Dose in mJ/cm² at places of one height, after the last layer.

    Parameters
    ----------
    images
        Shares of light (layers, rows, columns), 0 to 1, the first printed first; row i, column j is the pixel whose
        lower left corner is at (j, i) pixels.
    settings
        The process.
    places_um
        Places (N, 2): along columns, along rows, from the corner of the first pixel.
    height_um
        Height above the platform; below 0 is liquid under the first layer.

    Returns
    -------
    dose
        Shape (N,).
    """
    h, pitch = settings.layer_um, settings.pixels_um
    own = min(max(math.floor(height_um / h), 0), len(images) - 1)
    dose = np.zeros(len(places_um))
    for number in range(own, len(images)):
        depth_um = (number + 1) * h - height_um
        arriving = settings.exposures(len(images))[number] * math.exp(-depth_um / settings.Dp_um)
        halo_um = math.hypot(settings.halo_um, settings.halo_per_depth * depth_um)
        if settings.response is None:
            narrow = _blurred(images[number], pitch, settings.sigma_um or 0.0, places_um)
            wide = _blurred(images[number], pitch, halo_um, places_um)
        else:
            narrow, wide = _responses(images[number], settings, halo_um, places_um)
        dose += arriving * ((1.0 - settings.halo_fraction) * narrow + settings.halo_fraction * wide)
    return dose


def _blurred(image: FloatArray, pitch: tuple[float, float], sigma: float, places: FloatArray) -> FloatArray:
    """Image at places after a Gaussian blur: every pixel's rectangle adds a product of two differences."""
    rows, columns = image.shape
    across, along = (
        _share(pitch[axis] * np.arange(count, dtype=float), pitch[axis], sigma, places[:, axis])
        for axis, count in ((0, columns), (1, rows))
    )
    return np.asarray(np.einsum("nj,ni,ij->n", across, along, image))


def _share(start: FloatArray, pitch: float, sigma: float, at: FloatArray) -> FloatArray:
    """Share of a Gaussian about each place (N,) that falls into intervals (M,), shape (N, M)."""
    offset = at[:, None] - start
    return np.asarray(ndtr(offset / sigma) - ndtr((offset - pitch) / sigma))


def _responses(
    image: FloatArray, settings: Settings, halo_um: float, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Image at places by a measured response: straight light, and the same after scattering."""
    assert settings.response is not None
    light, step = np.array(settings.response.light), settings.response_scale * settings.response.pitch_um
    x, y = (step * np.arange(count, dtype=float) for count in light.shape[::-1])
    shares = light / light.sum()
    middle = np.array([shares.sum(axis=0) @ x, shares.sum(axis=1) @ y])
    variance = 0.5 * (shares.sum(axis=0) @ (x - middle[0]) ** 2 + shares.sum(axis=1) @ (y - middle[1]) ** 2)
    own = np.square(settings.pixels_um).sum() / 24.0
    beyond = math.sqrt(halo_um**2 - max(variance - own, 0.0))
    centre = middle
    if settings.response.centre_um is not None:
        centre = settings.response_scale * np.array(settings.response.centre_um)
    dark = 12
    down, right = (step * np.arange(-dark, count + dark, dtype=float) for count in light.shape)
    spline = RectBivariateSpline(down, right, np.pad(shares, dark) / step**2)
    narrow, wide = np.zeros(len(places)), np.zeros(len(places))
    (across, along), area = settings.pixels_um, math.prod(settings.pixels_um)
    for i, j in zip(*np.nonzero(image), strict=True):
        at = places - np.array([(j + 0.5) * across, (i + 0.5) * along]) + centre
        narrow += image[i, j] * area * spline.ev(at[:, 1], at[:, 0])
        gaussian = np.exp(
            -0.5 * ((at[:, 0, None, None] - x) ** 2 + (at[:, 1, None, None] - y[:, None]) ** 2) / beyond**2
        )
        wide += image[i, j] * area * np.einsum("nyx,yx->n", gaussian, shares) / (math.tau * beyond**2)
    return narrow, wide


def cured_um(settings: Settings, layers: int = 1) -> float:
    """How far below the window side of the first of some layers a wide lit area sets, over liquid, by this sum.

    For one layer that is Jacobs' Dp ln(E/Ec).
    """
    lit = np.ones((layers, 1, 1))
    wide = settings.model_copy(update={"pixel_um": 1e6})
    middle = np.array([[0.5e6, 0.5e6]])

    def excess(height_um: float) -> float:
        return float(np.log(dose_at(lit, wide, middle, height_um)[0] / settings.Ec_mJ_per_cm2))

    top = settings.layer_um
    return top - float(brentq(excess, top - 60.0 * settings.Dp_um, top, xtol=1e-12, rtol=1e-15))

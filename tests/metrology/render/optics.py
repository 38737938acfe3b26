"""Point spread functions of a microscope: kernels that sum to 1, optionally on a finer grid than that of the camera.

They are a Gaussian, the Airy disc of a circular aperture (diffraction), the uniform disc of an image out of focus
(geometrical optics), and the motion blur of a moving stage. An edge fit may assume only the first.
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import convolve1d
from scipy.signal import oaconvolve
from scipy.special import j1

from solen.arrays import FloatArray
from tests.metrology.render.coverage import coverage

Optics = Callable[[FloatArray, int], FloatArray]
"""Function of an image and the number of sub-pixels per pixel that returns the blurred image."""


def sharp() -> Optics:
    """Return optics without blur."""
    return lambda image, _fine: image


def gaussian(sigma_px: float) -> Optics:
    """Return a Gaussian blur, truncated at six standard deviations."""

    def blurred(image: FloatArray, fine: int) -> FloatArray:
        reach = int(np.ceil(6 * sigma_px * fine))
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (sigma_px * fine)) ** 2)
        weights /= weights.sum()
        rows = convolve1d(image, weights, axis=0, mode="nearest")
        return np.asarray(convolve1d(rows, weights, axis=1, mode="nearest"))

    return blurred


def airy(first_dark_px: float) -> Optics:
    """Return an Airy blur with the given radius of the first dark ring, truncated at six times this radius."""
    return _by_kernel(lambda fine: airy_kernel(first_dark_px * fine))


def defocus(radius_px: float) -> Optics:
    """Return the blur by a uniform disc: a point out of focus, in geometrical optics."""
    return _by_kernel(lambda fine: disc_kernel(radius_px * fine))


def smear(length_px: float, angle_deg: float) -> Optics:
    """Return the blur by a uniform line: the stage moves during the exposure."""
    return _by_kernel(lambda fine: line_kernel(length_px * fine, angle_deg))


def airy_kernel(first_dark: float) -> FloatArray:
    """Return (2 J1(v)/v)², v = 3.8317 r / first_dark: M. Born and E. Wolf, Principles of Optics, section 8.5.2."""
    reach = int(np.ceil(6 * first_dark))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    v = np.maximum(3.8317059702 * np.hypot(x, y) / first_dark, 1e-9)
    kernel = (2 * j1(v) / v) ** 2
    return np.asarray(kernel / kernel.sum())


def disc_kernel(radius: float) -> FloatArray:
    """Return the normalised areas of a disc in the pixels."""
    reach = int(np.ceil(radius)) + 1
    return _outline_kernel([(radius * np.cos(a), radius * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 721)], reach)


def line_kernel(length: float, angle_deg: float) -> FloatArray:
    """Return the normalised areas, in the pixels, of a line that is half a pixel wide."""
    reach = int(np.ceil(length / 2)) + 2
    direction = np.exp(1j * np.radians(angle_deg))
    corners = [complex(a, b) * direction for a, b in _box(length / 2, 0.25)]
    return _outline_kernel([(corner.real, corner.imag) for corner in corners], reach)


def _box(a: float, b: float) -> list[tuple[float, float]]:
    return [(-a, -b), (a, -b), (a, b), (-a, b)]


def _outline_kernel(points: list[tuple[float, float]], reach: int) -> FloatArray:
    kernel = coverage([np.asarray(points) + reach + 0.5], (2 * reach + 1, 2 * reach + 1))
    return np.asarray(kernel / kernel.sum())


def _by_kernel(kernel_of: Callable[[int], FloatArray]) -> Optics:
    def blurred(image: FloatArray, fine: int) -> FloatArray:
        kernel = kernel_of(fine)
        reach = kernel.shape[0] // 2
        return np.asarray(oaconvolve(np.pad(image, reach, mode="edge"), kernel, mode="valid"))

    return blurred

"""Simulated prints of a drawing from another model than solen's.

The light of each pixel is a smooth-edged disc with wide tails, the lamp is brighter on one side, resin cures above a
threshold (which makes walls grow), the part shrinks, and each print has an individual form. Nothing of solen's print
model is used: the renderer of the micrographs computes the pixel coverage of the drawing, which is blurred with a
non-Gaussian kernel and cut at the threshold.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import fftconvolve
from skimage.measure import find_contours

from solen.arrays import FloatArray
from tests.metrology.render.coverage import coverage

CELL_MM = 0.003
LOW, HIGH = (-2.7, -0.405), (2.7, 4.185)
"""Lower left and upper right corner (x, z) of the simulated window, in mm."""


@dataclass(frozen=True)
class Printer:
    """Properties of a printer.

    ``level`` is the fraction of full light at which resin cures, ``tilt`` the relative increase of the light from the
    centre to the right edge of the window, ``scatter_um`` the RMS of the individual form of a print, and ``curl_um``
    the amplitude of the form common to all prints.
    """

    pixel_mm: float = 0.027
    disc_mm: float = 0.022
    tail_mm: float = 0.06
    tails: float = 0.12
    level: float = 0.22
    tilt: float = 0.06
    shrinkage: float = 0.006
    scatter_um: float = 0.3
    curl_um: float = 5.0

    def printed(self, ring: FloatArray, seed: int) -> FloatArray:
        """Return the outline (N, 2) in mm, counter-clockwise, of a print of a polygon (M, 2), cut off by the window."""
        light = self._light(ring)
        x = LOW[0] + CELL_MM * (np.arange(light.shape[1]) + 0.5)
        light = light * (1.0 + self.tilt * x / HIGH[0])
        contour = max(find_contours(np.pad(light, 1), self.level), key=len)[:-1] - 1.0
        points = np.array(LOW) + CELL_MM * (contour[:, ::-1] + 0.5)
        points = points if _area(points) > 0.0 else points[::-1]
        return self._deformed((1.0 - self.shrinkage) * points, seed)

    def _light(self, ring: FloatArray) -> FloatArray:
        """Return the light on fine cells: pixel coverage in 255 grey levels, blurred with the kernel."""
        fine = round(self.pixel_mm / CELL_MM)
        rows, columns = (round((HIGH[axis] - LOW[axis]) / self.pixel_mm) for axis in (1, 0))
        covered = coverage([(ring - np.array(LOW)) / self.pixel_mm], (rows, columns))
        cells = np.kron(np.round(255.0 * covered) / 255.0, np.ones((fine, fine)))
        half = round(5.0 * self.tail_mm / CELL_MM)
        y, x = np.mgrid[-half : half + 1, -half : half + 1] * CELL_MM
        r = np.hypot(x, y)
        disc, tail = 1.0 / (1.0 + np.exp((r - self.disc_mm) / 0.004)), np.exp(-r / (self.tail_mm / 2.0))
        kernel = (1.0 - self.tails) * disc / disc.sum() + self.tails * tail / tail.sum()
        return fftconvolve(cells, kernel, mode="same")

    def _deformed(self, points: FloatArray, seed: int) -> FloatArray:
        """Return the outline displaced along its normals by the common form and a smooth random one."""
        steps = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
        rng = np.random.default_rng([seed, 9])
        scatter = gaussian_filter1d(rng.standard_normal(len(points)), 0.3 / steps.mean(), mode="wrap")
        x, z = points.T
        curl = np.sin(4.0 * x + 0.7) * np.exp(-((z / 2.0) ** 4))
        form = 1e-3 * (self.scatter_um * scatter / scatter.std() + self.curl_um * curl)
        tangents = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
        tangents /= np.hypot(*tangents.T)[:, None]
        return np.asarray(points + form[:, None] * np.column_stack([tangents[:, 1], -tangents[:, 0]]))


def _area(points: FloatArray) -> float:
    x, z = points.T
    return 0.5 * float(np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z))

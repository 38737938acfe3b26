"""Prints of a drawing by another model than solen's, and their micrographs.

Light of each pixel is a blunt disc with wide tails, the lamp is brighter on one side, resin sets above a threshold
(which makes walls grow), all shrinks, and each print has a slight form of its own. Nothing of solen's print model is
used: the drawing is painted by the renderer of micrographs, blurred by a kernel that is no Gaussian, and cut.
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
"""Corners of what is looked at: x, z."""


@dataclass(frozen=True)
class Printer:
    """How a drawing comes out.

    ``level`` is the share of full light at which resin sets, ``tilt`` by how much light rises from left to right over
    the window, ``once_um`` the form that each print has for itself (rms), ``curl_um`` the height of one that all have.
    """

    pixel_mm: float = 0.027
    disc_mm: float = 0.022
    tail_mm: float = 0.06
    tails: float = 0.12
    level: float = 0.22
    tilt: float = 0.06
    shrinkage: float = 0.006
    once_um: float = 0.3
    curl_um: float = 5.0

    def printed(self, ring: FloatArray, seed: int) -> FloatArray:
        """Outline (N, 2) in mm, counter-clockwise, of a print of a closed polygon (M, 2), cut off by the window."""
        light = self._light(ring)
        x = LOW[0] + CELL_MM * (np.arange(light.shape[1]) + 0.5)
        light = light * (1.0 + self.tilt * x / HIGH[0])
        contour = max(find_contours(np.pad(light, 1), self.level), key=len)[:-1] - 1.0
        points = np.array(LOW) + CELL_MM * (contour[:, ::-1] + 0.5)
        points = points if _area(points) > 0.0 else points[::-1]
        points = points - points.mean(axis=0) * 0.0
        return self._formed((1.0 - self.shrinkage) * points, seed)

    def _light(self, ring: FloatArray) -> FloatArray:
        """Light on fine cells: pixels of the covered share, 255 greys, and the kernel."""
        fine = round(self.pixel_mm / CELL_MM)
        rows, columns = (round((HIGH[axis] - LOW[axis]) / self.pixel_mm) for axis in (1, 0))
        share = coverage([(ring - np.array(LOW)) / self.pixel_mm], (rows, columns))
        cells = np.kron(np.round(255.0 * share) / 255.0, np.ones((fine, fine)))
        reach = round(5.0 * self.tail_mm / CELL_MM)
        y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1] * CELL_MM
        r = np.hypot(x, y)
        disc, tail = 1.0 / (1.0 + np.exp((r - self.disc_mm) / 0.004)), np.exp(-r / (self.tail_mm / 2.0))
        kernel = (1.0 - self.tails) * disc / disc.sum() + self.tails * tail / tail.sum()
        return fftconvolve(cells, kernel, mode="same")

    def _formed(self, points: FloatArray, seed: int) -> FloatArray:
        """Forms along the normals: that of all prints, and a slow random one."""
        steps = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
        rng = np.random.default_rng([seed, 9])
        once = gaussian_filter1d(rng.standard_normal(len(points)), 0.3 / steps.mean(), mode="wrap")
        x, z = points.T
        curl = np.sin(4.0 * x + 0.7) * np.exp(-((z / 2.0) ** 4))
        form = 1e-3 * (self.once_um * once / once.std() + self.curl_um * curl)
        way = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
        way /= np.hypot(*way.T)[:, None]
        return np.asarray(points + form[:, None] * np.column_stack([way[:, 1], -way[:, 0]]))


def _area(points: FloatArray) -> float:
    x, z = points.T
    return 0.5 * float(np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z))

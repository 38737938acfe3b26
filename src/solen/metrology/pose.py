"""Pose of a part in an image: the transformation between its coordinates in mm and pixels."""

import cmath
import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray


@dataclass(frozen=True)
class Pose:
    """Position, rotation and scale of a part in an image.

    Attributes
    ----------
    rotation_deg
        Counter-clockwise rotation in the image; at 0 the part's second axis (a lens's z, a layout's y) points up.
    origin_px
        (x, y) = (column, row) of the part's origin: a lens's vertex, the centre of a layout.
    um_per_px
        Size of a pixel.
    mirrored
        Whether the image shows the part from its other side, left and right exchanged before it is rotated.
    """

    rotation_deg: float
    origin_px: tuple[float, float]
    um_per_px: float
    mirrored: bool = False

    @classmethod
    def fitted(cls, points_mm: FloatArray, points_px: FloatArray, *, mirrored: bool) -> "Pose":
        """Fit the pose, including the scale, to at least two pairs of points (N, 2) and (N, 2) by least squares."""
        p = (-1.0 if mirrored else 1.0) * points_mm[:, 0] - 1j * points_mm[:, 1]
        q = points_px[:, 0] + 1j * points_px[:, 1]
        p0, q0 = p.mean(), q.mean()
        factor = complex(np.sum((q - q0) * np.conj(p - p0)) / np.sum(np.abs(p - p0) ** 2))
        origin = complex(q0 - factor * p0)
        return cls(-math.degrees(cmath.phase(factor)), (origin.real, origin.imag), 1e3 / abs(factor), mirrored)

    @property
    def px_per_mm(self) -> float:
        """Pixels per millimetre of the part."""
        return 1e3 / self.um_per_px

    def to_px(self, points_mm: FloatArray) -> FloatArray:
        """Return the positions (..., 2) in the image of points (..., 2) of the part."""
        return np.asarray(points_mm @ self._matrix.T * self.px_per_mm + np.asarray(self.origin_px))

    def to_mm(self, points_px: FloatArray) -> FloatArray:
        """Return the points (..., 2) of the part at positions (..., 2) in the image."""
        return np.asarray((points_px - np.asarray(self.origin_px)) @ self._matrix * (self.um_per_px / 1e3))

    def direction_px(self, directions: FloatArray) -> FloatArray:
        """Return the image directions (..., 2) of part directions (..., 2), with the same length."""
        return np.asarray(directions @ self._matrix.T)

    @property
    def _matrix(self) -> FloatArray:
        """Matrix from the part's axes to the image axes, x to the right and y downwards."""
        c, s = math.cos(math.radians(self.rotation_deg)), math.sin(math.radians(self.rotation_deg))
        flip = -1.0 if self.mirrored else 1.0
        return np.array([[flip * c, -s], [-flip * s, -c]])

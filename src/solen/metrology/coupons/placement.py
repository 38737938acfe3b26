"""Where a coupon lies in a picture: turned, moved, perhaps mirrored, at a scale of its own."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.geometry.coupons import Feature


@dataclass(frozen=True)
class Placement:
    """From mm of the layout (x right, y up) to px (x = column, y = row, downwards).

    Attributes
    ----------
    px_per_mm
        Scale at which the layout's places fit those of the picture.
    angle_deg
        How far the coupon is turned counter-clockwise as seen.
    middle_px
        Where the middle of the coupon lies.
    mirrored
        Whether it is seen as in a mirror, left and right exchanged before it is turned.
    """

    px_per_mm: float
    angle_deg: float
    middle_px: tuple[float, float]
    mirrored: bool = False

    @classmethod
    def of(cls, factor: complex, shift: complex, *, mirrored: bool) -> "Placement":
        """Placement of q = factor p + shift, with p = ±x − i y and q = column + i row."""
        return cls(abs(factor), -math.degrees(np.angle(factor)), (shift.real, shift.imag), mirrored)

    @property
    def factor(self) -> complex:
        """Factor of the complex form."""
        return complex(self.px_per_mm * np.exp(-1j * math.radians(self.angle_deg)))

    def px(self, places_mm: FloatArray) -> FloatArray:
        """Places (N, 2) of the picture."""
        seen = self.factor * flat(places_mm, mirrored=self.mirrored) + complex(*self.middle_px)
        return np.column_stack([seen.real, seen.imag])

    def direction_rad(self, from_mm: tuple[float, float], to_mm: tuple[float, float]) -> float:
        """Direction in the picture from one place of the layout to another: atan2(rows, columns)."""
        (x0, y0), (x1, y1) = self.px(np.array([from_mm, to_mm]))
        return math.atan2(y1 - y0, x1 - x0)


def flat(places_mm: FloatArray, *, mirrored: bool) -> NDArray[np.complex128]:
    """Places (N, 2) of the layout as complex numbers, imaginary part downwards."""
    x = -places_mm[:, 0] if mirrored else places_mm[:, 0]
    return np.asarray(x - 1j * places_mm[:, 1])


def places(features: Sequence[Feature]) -> FloatArray:
    """Middles (N, 2) of features, mm."""
    return np.array([(one.x_mm, one.y_mm) for one in features])


def fitted(places_mm: FloatArray, seen_px: FloatArray, *, mirrored: bool) -> Placement:
    """Placement of least squares for matched places (N, 2) and (N, 2); two at least."""
    p, q = flat(places_mm, mirrored=mirrored), seen_px[:, 0] + 1j * seen_px[:, 1]
    p0, q0 = p.mean(), q.mean()
    factor = np.sum((q - q0) * np.conj(p - p0)) / np.sum(np.abs(p - p0) ** 2)
    return Placement.of(complex(factor), complex(q0 - factor * p0), mirrored=mirrored)

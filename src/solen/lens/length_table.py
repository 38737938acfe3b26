"""Conversion between the lateral position on a designed lens and the arc length from its left edge."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from solen.arrays import FloatArray
from solen.lens.spline import DesignedLens

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


GRID = 4001
"""Number of points at which arc lengths are tabulated."""


@dataclass(frozen=True, eq=False)
class LengthTable:
    """Table of the arc length along a lens from its left edge; `LengthTable.of` makes one."""

    x_mm: FloatArray
    length_mm: FloatArray

    @classmethod
    def of(cls, lens: DesignedLens) -> "LengthTable":
        """Return the table of a lens, computed with Simpson's rule."""
        x = np.linspace(-lens.half_width_mm, lens.half_width_mm, GRID)
        middle = 0.5 * (x[:-1] + x[1:])
        start, mid, end = (np.hypot(1.0, lens.slope(position)) for position in (x[:-1], middle, x[1:]))
        steps = np.diff(x) * (start + 4.0 * mid + end) / 6.0
        return cls(x, np.concatenate([[0.0], np.cumsum(steps)]))

    @property
    def total_mm(self) -> float:
        """Total arc length of the lens."""
        return float(self.length_mm[-1])

    def length_at(self, x_mm: FloatArray) -> FloatArray:
        """Return arc lengths (N,) at lateral positions."""
        return np.asarray(self._length_spline(x_mm))

    def length_per_x(self, x_mm: FloatArray) -> FloatArray:
        """Return derivatives (N,) of the arc length with respect to the lateral position."""
        return np.asarray(self._length_spline(x_mm, 1))

    def x_at(self, length_mm: FloatArray) -> FloatArray:
        """Return lateral positions (N,) at arc lengths."""
        return np.interp(length_mm, self.length_mm, self.x_mm)

    @cached_property
    def _length_spline(self) -> "CubicSpline":
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.x_mm, self.length_mm)

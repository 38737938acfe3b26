"""Grey pixels: the light that a grey value transmits, and the value to draw for a share of light.

The idea: an edge is drawn by pixels that are covered in part, and their grey value was always taken for their light.
A screen's pixels need not answer in proportion. Where the answer is measured, light over grey, a pixel is drawn by the
grey that gives it its covered share of light; where it is not, its light is that of the grey it is drawn with. A power
over all of it holds what is not known: an error of the penetration depth that the answer was measured with is exactly
such a power, as the depth is in the exponent of Jacobs' law.

The interface: `Greys.light` and `Greys.pictured` by the share in 255ths, and `Greys.shift`, what an edge moves by.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray

FULL = 255
"""Grey value of a pixel that is covered wholly."""
_FINE = 4096


@dataclass(frozen=True)
class Greys:
    """Light of grey pixels.

    Attributes
    ----------
    answer
        Pairs of grey and light, both as shares of the full ones, ascending; proportional without any.
    corrected
        Whether pixels are drawn by the grey that gives their share of light.
    power
        Exponent of the light beyond the answer; 1 where that is right.
    pixels_um
        Sides of the process's pixels along X and Y.
    """

    answer: tuple[tuple[float, float], ...] = ()
    corrected: bool = True
    power: float = 1.0
    pixels_um: tuple[float, float] | None = None

    def light_of(self, grey: FloatArray) -> FloatArray:
        """Light of greys, both 0 to 1: a monotone curve through the pairs, 0 and 1."""
        if not self.answer:
            return np.asarray(grey, float) ** self.power
        from scipy.interpolate import PchipInterpolator

        greys, light = np.array(sorted({(0.0, 0.0), *self.answer, (1.0, 1.0)})).T
        return np.asarray(np.clip(PchipInterpolator(greys, light)(grey), 0.0, 1.0) ** self.power)

    @cached_property
    def pictured(self) -> NDArray[np.uint8]:
        """Grey value to draw for each covered share in 255ths, (256,); dark stays dark, and full stays full."""
        shares = np.arange(FULL + 1) / FULL
        if not (self.answer and self.corrected):
            return np.arange(FULL + 1, dtype=np.uint8)
        fine = np.linspace(0.0, 1.0, _FINE)
        light = Greys(self.answer).light_of(fine)
        last = np.append(np.diff(light) > 0.0, True)  # of a stretch without change the last grey
        greys = np.interp(shares, light[last], fine[last])
        greys[0] = 0.0
        return np.asarray(np.rint(FULL * greys), np.uint8)

    @cached_property
    def light(self) -> FloatArray:
        """Light of a pixel for each covered share in 255ths, (256,), as it is drawn."""
        return self.light_of(self.pictured / FULL)

    @property
    def shift(self) -> float:
        """Outward shift of a straight edge in pixels, mean over its positions between them."""
        return float(np.trapezoid(self.light, dx=1.0 / FULL)) - 0.5

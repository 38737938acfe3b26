"""Grey pixels: the light that a grey value transmits, and the grey value to draw for a fraction of the full light.

The idea: an edge is drawn by partly covered pixels, and their grey value is usually taken as their light. The pixels of
a screen need not respond in proportion. If the response (light over grey) is measured, a pixel is drawn with the grey
that gives it its covered fraction of the light; otherwise, its light equals its grey value. An exponent on the measured
light represents its uncertainty: an error of the penetration depth used in measuring the response is exactly such an
exponent, as the depth is in the exponent of Jacobs' law.

The interface: `Greys.light` and `Greys.pictured` over the covered share in 255ths, and `Greys.shift`, the shift of an
edge.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray

FULL = 255
"""Grey value of a fully covered pixel."""
_FINE = 4096


@dataclass(frozen=True)
class Greys:
    """Light of grey pixels.

    Attributes
    ----------
    answer
        Pairs of grey and light, as fractions of the full values, ascending; if empty, light is proportional to grey.
    corrected
        Whether pixels are drawn with the grey that gives their share of light.
    power
        Exponent applied to the light of the response; 1 if the response is right.
    pixels_um
        Pixel pitch of the process along X and Y.
    """

    answer: tuple[tuple[float, float], ...] = ()
    corrected: bool = True
    power: float = 1.0
    pixels_um: tuple[float, float] | None = None

    def light_of(self, grey: FloatArray) -> FloatArray:
        """Light of greys, both from 0 to 1: a monotone curve through the pairs and through 0 and 1."""
        if not self.answer:
            return np.asarray(grey, float) ** self.power
        from scipy.interpolate import PchipInterpolator

        greys, light = np.array(sorted({(0.0, 0.0), *self.answer, (1.0, 1.0)})).T
        return np.asarray(np.clip(PchipInterpolator(greys, light)(grey), 0.0, 1.0) ** self.power)

    @cached_property
    def pictured(self) -> NDArray[np.uint8]:
        """Grey value to draw for each covered share in 255ths, (256,); 0 stays dark and 255 full."""
        shares = np.arange(FULL + 1) / FULL
        if not (self.answer and self.corrected):
            return np.arange(FULL + 1, dtype=np.uint8)
        fine = np.linspace(0.0, 1.0, _FINE)
        light = Greys(self.answer).light_of(fine)
        last = np.append(np.diff(light) > 0.0, True)  # the last grey of a range with constant light
        greys = np.interp(shares, light[last], fine[last])
        greys[0] = 0.0
        return np.asarray(np.rint(FULL * greys), np.uint8)

    @cached_property
    def light(self) -> FloatArray:
        """Light of a pixel, as drawn, for each covered share in 255ths, (256,)."""
        return self.light_of(self.pictured / FULL)

    @property
    def shift(self) -> float:
        """Outward shift of a straight edge in pixels, averaged over the edge's positions in a pixel."""
        return float(np.trapezoid(self.light, dx=1.0 / FULL)) - 0.5

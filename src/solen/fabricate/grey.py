"""Grey pixels: the light of a grey level, and the grey level required for a fraction of the full light.

Edges are drawn with pixels that are partly covered. Their light is usually assumed to be proportional to their grey
level, but the pixels of a screen need not be linear. If the grey response (light against grey level) was measured, a
pixel is drawn with the grey level that gives its covered fraction of the full light. An exponent of the measured light
represents its uncertainty: an error of the penetration depth with which the response was measured has exactly the
effect of such an exponent, because the depth is in the exponent of Jacobs' law.

`Greys.light` and `Greys.levels` are functions of the covered fraction in 255ths; `Greys.shift` is the shift of an edge.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray

FULL = 255
"""Grey level of a fully covered pixel."""
_LEVELS = 4096  # grey levels at which the response is inverted


@dataclass(frozen=True)
class Greys:
    """Light of grey pixels.

    Attributes
    ----------
    response
        Pairs of grey level and light, as fractions of the full values, in ascending order; if empty, light is
        proportional to grey level.
    corrected
        Whether pixels are drawn with the grey level that gives their covered fraction of the light.
    exponent
        Exponent of the light of the response; 1 if the response is correct.
    pixels_um
        Pixel sizes of the process along X and Y.
    """

    response: tuple[tuple[float, float], ...] = ()
    corrected: bool = True
    exponent: float = 1.0
    pixels_um: tuple[float, float] | None = None

    def light_of(self, grey: FloatArray) -> FloatArray:
        """Return the light of grey levels, both from 0 to 1: a monotonic curve through the pairs, through 0 and 1."""
        if not self.response:
            return np.asarray(grey, float) ** self.exponent
        from scipy.interpolate import PchipInterpolator

        greys, light = np.array(sorted({(0.0, 0.0), *self.response, (1.0, 1.0)})).T
        return np.asarray(np.clip(PchipInterpolator(greys, light)(grey), 0.0, 1.0) ** self.exponent)

    @cached_property
    def levels(self) -> NDArray[np.uint8]:
        """Grey level that is drawn for each covered fraction in 255ths, (256,); 0 and 255 are unchanged."""
        fractions = np.arange(FULL + 1) / FULL
        if not (self.response and self.corrected):
            return np.arange(FULL + 1, dtype=np.uint8)
        levels = np.linspace(0.0, 1.0, _LEVELS)
        light = Greys(self.response).light_of(levels)
        last = np.append(np.diff(light) > 0.0, True)  # the last level of a range with constant light
        greys = np.interp(fractions, light[last], levels[last])
        greys[0] = 0.0
        return np.asarray(np.rint(FULL * greys), np.uint8)

    @cached_property
    def light(self) -> FloatArray:
        """Light of a pixel as drawn, for each covered fraction in 255ths, (256,)."""
        return self.light_of(self.levels / FULL)

    @property
    def shift(self) -> float:
        """Outward shift of a straight edge in pixels, averaged over the position of the edge within a pixel."""
        return float(np.trapezoid(self.light, dx=1.0 / FULL)) - 0.5

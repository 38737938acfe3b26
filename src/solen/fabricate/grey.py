"""Grey pixels: the light that a grey level transmits, and the grey level required for a fraction of the full light.

Edges are drawn by partly covered pixels, and their transmitted light is usually assumed proportional to their grey
level. The pixels of a screen need not respond in proportion. If the response (light against grey level) was measured, a
pixel is drawn with the grey level that transmits its covered fraction of the light; otherwise the light is assumed
proportional to the grey level. An exponent on the measured light represents its uncertainty: an error of the
penetration depth used to measure the response acts as exactly this exponent, because the depth appears in the exponent
of Jacobs' law.

`Greys.light` and `Greys.levels` are functions of the covered fraction in 255ths; `Greys.shift` is the edge shift.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray

FULL = 255
"""Grey level of a fully covered pixel."""
_FINE = 4096


@dataclass(frozen=True)
class Greys:
    """Light transmitted by grey pixels.

    Attributes
    ----------
    answer
        Pairs of grey level and light, as fractions of the full values, ascending; if empty, light is proportional to
        grey level.
    corrected
        Whether pixels are drawn with the grey level that transmits their covered fraction of the light.
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
        """Return the light of grey levels, both from 0 to 1: a monotone curve through the pairs and through 0 and 1."""
        if not self.answer:
            return np.asarray(grey, float) ** self.power
        from scipy.interpolate import PchipInterpolator

        greys, light = np.array(sorted({(0.0, 0.0), *self.answer, (1.0, 1.0)})).T
        return np.asarray(np.clip(PchipInterpolator(greys, light)(grey), 0.0, 1.0) ** self.power)

    @cached_property
    def levels(self) -> NDArray[np.uint8]:
        """Grey level to draw for each covered fraction in 255ths, (256,); 0 stays dark and 255 is full."""
        shares = np.arange(FULL + 1) / FULL
        if not (self.answer and self.corrected):
            return np.arange(FULL + 1, dtype=np.uint8)
        fine = np.linspace(0.0, 1.0, _FINE)
        light = Greys(self.answer).light_of(fine)
        last = np.append(np.diff(light) > 0.0, True)  # the last grey level of a range with constant light
        greys = np.interp(shares, light[last], fine[last])
        greys[0] = 0.0
        return np.asarray(np.rint(FULL * greys), np.uint8)

    @cached_property
    def light(self) -> FloatArray:
        """Light of a pixel as drawn, for each covered fraction in 255ths, (256,)."""
        return self.light_of(self.levels / FULL)

    @property
    def shift(self) -> float:
        """Outward shift of a straight edge in pixels, averaged over edge positions within a pixel."""
        return float(np.trapezoid(self.light, dx=1.0 / FULL)) - 0.5

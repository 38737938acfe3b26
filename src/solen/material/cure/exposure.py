"""What a layer's optics do with its exposure: transmittance, and index where it is known, at some wavelengths.

The idea: layers cured for 2, 4 and 6 s are three points, and what three points can say is a trend with an interval, not
a curve. Each sample counts once. A trend of the transmittance is one of the layer: a layer that was cured longer may
also be thicker, rougher or yellower, and a trend alone does not say which.

The interface: `Sample` holds a layer; `trend` of values against exposure gives a `Trend`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.material.regression import fitted, t_tail


@dataclass(frozen=True)
class Sample:
    """A layer: its name, exposure in s, and its spectra as fractions, shape (n,), by ascending wavelength in nm.

    ``reflectance`` is None where it was not measured.
    """

    name: str
    exposure_s: float
    wavelength_nm: FloatArray
    transmittance: FloatArray
    reflectance: FloatArray | None = None


@dataclass(frozen=True)
class Trend:
    """Straight line of a value against exposure.

    Attributes
    ----------
    slope, u_slope, interval95
        Change per unit of exposure; the last two are None where two samples leave nothing to judge it by.
    p
        How likely a slope this steep is by chance; None as above.
    middle, at
        Value of the line at the mean exposure, and that.
    samples, exposures
        How many of each.
    """

    slope: float
    u_slope: float | None
    interval95: tuple[float, float] | None
    p: float | None
    middle: float
    at: float
    samples: int
    exposures: int

    def value(self, exposure: ArrayLike) -> FloatArray:
        """Value of the line at an exposure."""
        return self.middle + self.slope * (np.asarray(exposure, float) - self.at)


def trend(exposure: ArrayLike, values: ArrayLike) -> Trend | None:
    """Trend of values against exposures, shape (n,); NaN is left out. None where fewer than two exposures are left."""
    x, y = np.asarray(exposure, float), np.asarray(values, float)
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    kinds = len(np.unique(x))
    if kinds < 2:
        return None
    at = float(x.mean())
    if len(x) == 2:
        slope = float((y[1] - y[0]) / (x[1] - x[0]))
        return Trend(slope, None, None, None, float(y.mean()), at, 2, 2)
    fit = fitted(np.column_stack([np.ones(len(x)), x - at]), y)
    slope, u = float(fit.parameters[1]), fit.u((0.0, 1.0))
    p = t_tail(slope / u, fit.error_df) if u > 0.0 else float(slope == 0.0)
    return Trend(slope, u, fit.interval((0.0, 1.0)), p, float(fit.parameters[0]), at, len(x), kinds)

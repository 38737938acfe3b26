"""Penetration depth from an absorbance, at one wavelength and in the light of a lamp.

The idea: a resin that lets 10^(-A) through a path h takes light off as e^(-z/Dp) with Dp = h/(A ln 10). A lamp has many
wavelengths, and the deeper its light comes, the more it is of those that the resin takes least: the dose falls slower
with depth, so no single Dp describes it. `Attenuation` keeps the sum over the lamp's lines; its `local_um` is the
penetration depth at a place, and between two depths `between_um` is what a working curve through discs of these
thicknesses has for its slope.

This is absorption alone. A working curve's Dp has in it also how well each wavelength starts the cure, bleaching and
what the cured resin absorbs: the two agree where these are small.

The interface: `penetration_depth_um` in one number, `attenuation` gives an `Attenuation`.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.light import Light


@dataclass(frozen=True)
class Attenuation:
    """How a lamp's light is taken off with depth.

    Attributes
    ----------
    wavelength_nm, weight
        Lines of the lamp, shape (n,), and their shares of its power at the surface.
    per_um
        What the resin takes off at each, base e, shape (n,).
    """

    wavelength_nm: FloatArray
    weight: FloatArray
    per_um: FloatArray

    def share(self, depth_um: ArrayLike) -> FloatArray:
        """Share of the light that reaches a depth."""
        depth = np.asarray(depth_um, float)
        return np.asarray(np.exp(-depth[..., None] * self.per_um) @ self.weight)

    def local_um(self, depth_um: float = 0.0) -> float:
        """Penetration depth at a depth: the light there over how fast it falls."""
        reached = self.weight * np.exp(-depth_um * (self.per_um - self._least))
        return float(reached.sum() / (reached @ self.per_um))

    def between_um(self, upper_um: float, lower_um: float) -> float:
        """Penetration depth of the exponential through two depths."""
        return (lower_um - upper_um) / (self._ln_share(upper_um) - self._ln_share(lower_um))

    @property
    def _least(self) -> float:
        return float(self.per_um.min())

    def _ln_share(self, depth_um: float) -> float:
        """Logarithm of `share`, also where that is too small for a number."""
        beside = self.weight @ np.exp(-depth_um * (self.per_um - self._least))
        return math.log(float(beside)) - depth_um * self._least


def penetration_depth_um(
    path_um: float, absorbance: ArrayLike, spectrum: ArrayLike | None = None
) -> FloatArray | float:
    """Penetration depth h/(A ln 10) in µm.

    Parameters
    ----------
    path_um
        Path h of the light through the resin in µm.
    absorbance
        A, base 10, a number or shape (n,).
    spectrum
        Power of a lamp at each of the wavelengths of A, shape (n,). With it the answer is one number, that at the
        surface: the mean of what is taken off, weighted with power.

    Raises
    ------
    DataError
        Where the path or an absorbance (with a spectrum, its weighted mean) is not above 0.
    """
    _check_path(path_um)
    per_um = np.asarray(absorbance, float) * math.log(10.0) / path_um
    if spectrum is not None:
        weight = np.asarray(spectrum, float)
        per_um = np.asarray(weight @ per_um / weight.sum())
    if not np.all(per_um > 0.0):
        raise DataError(
            "absorbance",
            value=float(np.min(np.asarray(per_um))) * path_um / math.log(10.0),
            limit="must be above 0: without absorption there is no penetration depth",
            remedy="take a longer path, or another wavelength",
        )
    return 1.0 / per_um if per_um.ndim else float(1.0 / per_um)


def attenuation(path_um: float, wavelength_nm: ArrayLike, absorbance: ArrayLike, light: Light) -> Attenuation:
    """Attenuation of a lamp's light in a resin.

    Parameters
    ----------
    path_um
        Path in µm through which the absorbance was measured.
    wavelength_nm, absorbance
        Absorbance, base 10, at wavelengths in any order, shape (n,); NaN where it is not known.
    light
        Of the lamp.

    Raises
    ------
    DataError
        Where the lamp shines at wavelengths at which the absorbance is not known, or is not above 0.
    """
    _check_path(path_um)
    resin_nm, values = _sorted(wavelength_nm, absorbance)
    nm = light.wavelength_nm
    if nm[0] < resin_nm[0] or nm[-1] > resin_nm[-1]:
        limit = f"the absorbance is known from {resin_nm[0]:g} to {resin_nm[-1]:g} nm only"
        raise DataError("lamp", value=f"{nm[0]:g} to {nm[-1]:g} nm", limit=limit, remedy="measure it over the lamp")
    at = np.interp(nm, resin_nm, values)
    if not np.all(at > 0.0):
        limit = "absorbance must be above 0 wherever the lamp shines"
        worst = int(np.argmin(at))
        raise DataError(f"absorbance at {nm[worst]:.0f} nm", value=float(at[worst]), limit=limit)
    return Attenuation(nm, light.share, at * math.log(10.0) / path_um)


def _check_path(path_um: float) -> None:
    if not 0.0 < path_um < math.inf:
        raise DataError("path", value=path_um, limit="must be above 0 µm")


def _sorted(nm: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Pairs with both numbers known, by ascending wavelength; where one comes twice, the mean."""
    x, y = np.asarray(nm, float), np.asarray(values, float)
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        raise DataError("absorbance", limit="holds no numbers")
    unique, place = np.unique(x[known], return_inverse=True)
    return unique, np.bincount(place, weights=y[known]) / np.bincount(place)

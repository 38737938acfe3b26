"""The result of every route: index and extinction against wavelength, with uncertainty, bounds and masks."""

from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.material.index.masks import UNRESOLVED, Codes, Why, reasons
from solen.material.index.reading import Combined, Length
from solen.ranks import Caution


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values with their uncertainty, shape (n,) each: NaN where masked or unknown.

    Attributes
    ----------
    value
        Best value.
    u, u_random, u_common
        Standard uncertainty (68.27 %) and its parts, u² = u_random² + u_common².
    u95
        Half-width of the 95 % interval.
    scatter
        Like u_random, but not widened for few repeats, because many wavelengths determine the scatter.
    common
        As in `solen.material.index.reading.Combined`, shape (parts, n).
    why
        Codes of `solen.material.index.masks.Why`; values masked as not resolved keep their uncertainty.
    """

    value: FloatArray
    u: FloatArray
    u_random: FloatArray
    u_common: FloatArray
    u95: FloatArray
    scatter: FloatArray
    common: FloatArray
    why: Codes

    @property
    def known(self) -> BoolArray:
        """Whether each value is not masked."""
        return np.asarray(self.why == Why.FINE)

    @property
    def without_u(self) -> "Estimate":
        """Return the same values without their uncertainty."""
        nothing = np.full(self.value.shape, np.nan)
        none = np.empty((0, nothing.size))
        gone = {"u": nothing, "u_random": nothing, "u_common": nothing, "u95": nothing, "scatter": nothing}
        return replace(self, **gone, common=none)


@dataclass(frozen=True, eq=False)
class IndexSpectrum:
    """Index and extinction against wavelength; arrays of shape (n,).

    Attributes
    ----------
    mode
        Name of the route.
    measurement
        Whether n follows from measured values.
    wavelength_nm
        Wavelengths, as given.
    n, k
        Refractive index and extinction coefficient.
    k_low95, k_high95
        95 % bounds, given that k ≥ 0, also where k is masked as not resolved. NaN where there is no bound.
    correlation
        Correlation of the errors of n and k.
    lossless
        The index from T alone, assuming k = 0.
    reflectance, transmittance
        The inverted readings, unmasked; the reflectance of the lossless route is 1 − T.
    thickness
        Thickness of the layer; None if the route needs none.
    warnings
        Warnings, in sentences with numbers.
    """

    mode: str
    measurement: bool
    wavelength_nm: FloatArray
    n: Estimate
    k: Estimate
    k_low95: FloatArray
    k_high95: FloatArray
    correlation: FloatArray
    lossless: Estimate
    reflectance: FloatArray
    transmittance: FloatArray
    thickness: Length | None
    warnings: tuple[Caution, ...] = ()

    @property
    def reason(self) -> tuple[str | None, ...]:
        """Reason why n or k is masked at each wavelength, in words, or None if neither is."""
        return reasons(self.n.why, self.k.why)


def estimate(value: FloatArray, u: Combined, why: Codes) -> Estimate:
    """Return values and uncertainties, masked."""
    gone = ~np.isin(why, (Why.FINE, *UNRESOLVED))
    common = np.where(gone, np.nan, u.common)
    return Estimate(
        value=np.where(why == Why.FINE, value, np.nan),
        u=np.where(gone, np.nan, u.u),
        u_random=np.where(gone, np.nan, u.u_random),
        u_common=np.sqrt((common**2).sum(axis=0)),
        u95=np.where(gone, np.nan, u.bound(0.95)),
        scatter=np.where(gone, np.nan, u.random),
        common=common,
        why=why,
    )


def nothing(why: Codes) -> Estimate:
    """Return an estimate in which every value is masked for the same reason."""
    none = np.full(why.shape, np.nan)
    return Estimate(none, none, none, none, none, none, np.empty((0, why.size)), why)

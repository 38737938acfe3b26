"""The common result of all routes: index and extinction against wavelength, with uncertainty, bounds and masks."""

from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.material.index.masks import UNRESOLVED, Codes, Reason, reasons
from solen.material.index.reading import Combined, Length
from solen.ranks import Caution


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values with their uncertainty; arrays of shape (n,), NaN where masked or unknown.

    Attributes
    ----------
    value
        The values.
    u, u_random, u_common
        Standard uncertainty (68.27 %) and its parts, u² = u_random² + u_common².
    u95
        Half-width of the 95 % interval.
    scatter
        The same as u_random, but not widened for few repeats, because many wavelengths determine the scatter.
    common
        Signed errors common to all wavelengths, shape (parts, n): the covariance of two wavelengths is the sum of the
        products of their errors over the parts.
    codes
        Codes of `solen.material.index.masks.Reason`; values that are masked as not resolved keep their uncertainty.
    """

    value: FloatArray
    u: FloatArray
    u_random: FloatArray
    u_common: FloatArray
    u95: FloatArray
    scatter: FloatArray
    common: FloatArray
    codes: Codes

    @property
    def known(self) -> BoolArray:
        """Whether each value is not masked."""
        return np.asarray(self.codes == Reason.NONE)

    @property
    def without_u(self) -> "Estimate":
        """The same values without uncertainty."""
        nan = np.full(self.value.shape, np.nan)
        return replace(self, u=nan, u_random=nan, u_common=nan, u95=nan, scatter=nan, common=np.empty((0, nan.size)))


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
        95 % bounds of k, given that k ≥ 0, also where k is masked as not resolved; NaN where there is no bound.
    correlation
        Correlation of the errors of n and k.
    lossless
        Index from T alone, assuming k = 0.
    reflectance, transmittance
        R and T, unmasked; the reflectance of the lossless route in air is 1 − T.
    thickness
        Thickness of the layer; None if the route does not use it.
    warnings
        Warnings, one sentence each.
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
        return reasons(self.n.codes, self.k.codes)


def estimate(value: FloatArray, u: Combined, codes: Codes) -> Estimate:
    """Return values and uncertainties, masked by the codes."""
    masked = ~np.isin(codes, (Reason.NONE, *UNRESOLVED))
    common = np.where(masked, np.nan, u.common)
    return Estimate(
        value=np.where(codes == Reason.NONE, value, np.nan),
        u=np.where(masked, np.nan, u.u),
        u_random=np.where(masked, np.nan, u.u_random),
        u_common=np.sqrt((common**2).sum(axis=0)),
        u95=np.where(masked, np.nan, u.bound(0.95)),
        scatter=np.where(masked, np.nan, u.random),
        common=common,
        codes=codes,
    )


def all_masked(codes: Codes) -> Estimate:
    """Return an estimate in which every value is masked, for the reason of its code."""
    nan = np.full(codes.shape, np.nan)
    return Estimate(nan, nan, nan, nan, nan, nan, np.empty((0, codes.size)), codes)

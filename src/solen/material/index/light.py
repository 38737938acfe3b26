"""The index that light of some spectrum meets: an LED's, or one wavelength's.

The idea: an index between measured wavelengths is linear, so the index weighted with the power of a spectrum is a sum
of measured ones with known shares. What scatters from wavelength to wavelength averages out in it, what all wavelengths
have in common does not. Light outside the measured range is not guessed at.

The interface: `Light` with `lines` and `led`; `index_in` gives the `Evaluated` index of a spectrum, `formula_in` that
of a formula.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.dispersion import Dispersion
from solen.material.index.spectrum import Estimate, IndexSpectrum
from solen.parts.light import FWHM_OF_SIGMA

MOST_OUTSIDE = 0.02
"""Share of the light that may lie where nothing was measured."""
NOISE = 0.01
"""Share of its peak below which a measured spectrum is noise."""
_LINES, _REACH = 241, 3.0  # lines of an LED, and how many standard deviations they reach


@dataclass(frozen=True)
class Light:
    """Wavelengths in nm, ascending, and the share of the power at each, 1 in all."""

    wavelength_nm: FloatArray
    share: FloatArray

    @property
    def mean_nm(self) -> float:
        """Mean wavelength, weighted with power."""
        return float(self.wavelength_nm @ self.share)


@dataclass(frozen=True)
class Evaluated:
    """An index in some light.

    Attributes
    ----------
    wavelength_nm
        Mean wavelength of the light.
    n, u_n
        Index and standard uncertainty; None where not known.
    u_random, u_common
        Parts of u_n.
    bridged
        Share of the light at wavelengths where n is masked, taken from those beside.
    outside
        Share of the light at wavelengths that were not measured.
    reason
        Why there is no index, or None.
    """

    wavelength_nm: float
    n: float | None
    u_n: float | None
    u_random: float | None
    u_common: float | None
    bridged: float
    outside: float
    reason: str | None


def lines(wavelength_nm: ArrayLike, power: ArrayLike) -> Light:
    """Light of given powers at given wavelengths, in any order.

    A measured spectrum on an even grid is one as it is. `DataError` where powers are negative or all nothing.
    """
    nm, weight = np.asarray(wavelength_nm, dtype=float), np.asarray(power, dtype=float)
    seen = np.isfinite(nm) & np.isfinite(weight)
    nm, weight = nm[seen], weight[seen]
    if not nm.size or (weight < 0.0).any() or not weight.sum() > 0.0 or (nm <= 0.0).any():
        limit = "needs wavelengths above 0 and powers of at least 0, not all 0"
        raise DataError("spectrum of the light", limit=limit)
    order = np.argsort(nm)
    return Light(nm[order], weight[order] / weight.sum())


def measured_light(wavelength_nm: ArrayLike, power: ArrayLike) -> Light:
    """Light of a measured power per nm, each wavelength standing for what is nearest to it.

    What is below 1 % of the peak is left out: there a spectrometer shows its noise, on both sides of 0.
    """
    nm, values = np.asarray(wavelength_nm, dtype=float), np.asarray(power, dtype=float)
    order = np.argsort(nm)
    nm, values = nm[order], values[order]
    width = np.gradient(nm) if nm.size > 1 else np.ones(nm.size)
    lit = values >= NOISE * np.nanmax(values, initial=0.0)
    return lines(nm[lit], values[lit] * width[lit])


def led(peak_nm: float, fwhm_nm: float | None) -> Light:
    """Light of an LED: a normal distribution about its peak, or one line where no width is known."""
    if not fwhm_nm:
        return lines([peak_nm], [1.0])
    steps = np.linspace(-_REACH, _REACH, _LINES)
    return lines(peak_nm + steps * fwhm_nm / FWHM_OF_SIGMA, np.exp(-(steps**2) / 2.0))


def index_in(spectrum: IndexSpectrum, light: Light) -> Evaluated:
    """Index of a spectrum in some light."""
    return estimate_in(spectrum.wavelength_nm, spectrum.n, light)


def estimate_in(wavelength_nm: FloatArray, n: Estimate, light: Light) -> Evaluated:
    """Index in some light, of an estimate along ascending wavelengths."""
    known = np.flatnonzero(n.known)
    if not known.size:
        return Evaluated(light.mean_nm, None, None, None, None, 0.0, 1.0, "n is masked at all wavelengths")
    nm = wavelength_nm[known]
    inside = (light.wavelength_nm >= nm[0]) & (light.wavelength_nm <= nm[-1])
    outside = float(1.0 - light.share[inside].sum())
    if outside > MOST_OUTSIDE:
        told = f"{outside:.0%} of the light lies outside {nm[0]:g} to {nm[-1]:g} nm, where n is known"
        return Evaluated(light.mean_nm, None, None, None, None, 0.0, outside, told)
    at, weight = light.wavelength_nm[inside], light.share[inside] / light.share[inside].sum()
    share, bridged = _shares(nm, known, at, weight)
    random = float(np.sqrt(np.sum((share * n.u_random[known]) ** 2)))
    common = float(np.sqrt(np.sum((n.common[:, known] @ share) ** 2)))
    stated = bool(np.isfinite(n.u[known][share > 0.0]).all())
    return Evaluated(
        light.mean_nm,
        n=float(share @ n.value[known]),
        u_n=float(np.hypot(random, common)) if stated else None,
        u_random=random if stated else None,
        u_common=common if stated else None,
        bridged=bridged,
        outside=max(outside, 0.0),
        reason=None,
    )


def formula_in(model: Dispersion, light: Light) -> Evaluated:
    """Index in some light, of a formula.

    Its uncertainty is the mean of that at the light's wavelengths, as if those were wrong together: they nearly are.
    """
    low, high = model.range_nm
    inside = (light.wavelength_nm >= low) & (light.wavelength_nm <= high)
    outside = float(1.0 - light.share[inside].sum())
    if outside > MOST_OUTSIDE:
        told = f"{outside:.0%} of the light lies outside {low:g} to {high:g} nm, where the formula holds"
        return Evaluated(light.mean_nm, None, None, None, None, 0.0, outside, told)
    weight = light.share[inside] / light.share[inside].sum()
    at = light.wavelength_nm[inside].tolist()
    u = [model.u_index(nm) for nm in at]
    u_n = None if None in u else float(weight @ np.array(u, dtype=float))
    n = float(weight @ np.array([model.index(nm) for nm in at]))
    return Evaluated(light.mean_nm, n, u_n, None, u_n, 0.0, max(outside, 0.0), None)


def _shares(nm: FloatArray, place: NDArray[np.intp], at: FloatArray, weight: FloatArray) -> tuple[FloatArray, float]:
    """Share of each known wavelength in what is linear between them, and of light beside which a value is masked."""
    share = np.zeros(nm.size)
    right = np.clip(np.searchsorted(nm, at, side="left"), 1 if nm.size > 1 else 0, nm.size - 1)
    left = np.maximum(right - 1, 0)
    gap = nm[right] - nm[left]
    part = np.where(gap > 0.0, (at - nm[left]) / np.where(gap > 0.0, gap, 1.0), 1.0)
    np.add.at(share, left, weight * (1.0 - part))
    np.add.at(share, right, weight * part)
    over = (place[right] - place[left] > 1) & (part > 0.0) & (part < 1.0)
    return share, float(weight[over].sum())

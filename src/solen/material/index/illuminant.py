"""The index for light with a given spectrum: from an LED, or a single wavelength.

An index between measured wavelengths is interpolated linearly, so the power-weighted index is a sum of measured indices
with known weights. Scatter from wavelength to wavelength averages out in it; errors common to all wavelengths do not.
Nothing is extrapolated to light outside the measured range.

`lines`, `led`, `measured_light` and `named_light` return an `Illuminant`. `index_in` evaluates a spectrum in its light,
and `formula_in` a formula.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray, IndexArray
from solen.errors import DataError
from solen.material.dispersion import Dispersion
from solen.material.index.spectrum import IndexSpectrum
from solen.parts import EmitterPart, library, library_part, load_part
from solen.parts.light import FWHM_PER_SIGMA
from solen.recording import read, spectra
from solen.recording.optical import listed

MAX_OUTSIDE = 0.02
"""Largest fraction of the light that may be at wavelengths without a measurement."""
NOISE = 0.01
"""Values of a measured spectrum below this fraction of the peak are treated as noise."""
_LINES, _REACH = 241, 3.0  # number of lines of an LED, and their range in standard deviations


@dataclass(frozen=True, eq=False)
class Illuminant:
    """Ascending wavelengths in nm, the fraction of the power at each (in total 1), and their origin in words."""

    wavelength_nm: FloatArray
    share: FloatArray
    source: str = ""

    @property
    def mean_nm(self) -> float:
        """Mean wavelength, weighted by power."""
        return float(self.wavelength_nm @ self.share)


@dataclass(frozen=True)
class Evaluated:
    """An index for some light.

    Attributes
    ----------
    source
        Origin of the light's spectrum; empty for single wavelengths.
    wavelength_nm
        Mean wavelength of the light.
    n, u_n
        Index and standard uncertainty; None if not known.
    u_random_n, u_common_n
        Random and common parts of u_n.
    bridged
        Fraction of the light at wavelengths where n is masked and interpolated from neighbours.
    outside
        Fraction of the light at wavelengths that were not measured.
    reason
        Why there is no index, or None.
    """

    source: str
    wavelength_nm: float
    n: float | None = None
    u_n: float | None = None
    u_random_n: float | None = None
    u_common_n: float | None = None
    bridged: float = 0.0
    outside: float = 0.0
    reason: str | None = None


def lines(wavelength_nm: ArrayLike, power: ArrayLike, source: str = "") -> Illuminant:
    """Return light with given powers at given wavelengths, in any order.

    A measured spectrum on a uniform grid can be used directly. `DataError` if a power is negative or all are zero.
    """
    nm, weight = np.asarray(wavelength_nm, dtype=float), np.asarray(power, dtype=float)
    seen = np.isfinite(nm) & np.isfinite(weight)
    nm, weight = nm[seen], weight[seen]
    if not nm.size or (weight < 0.0).any() or not weight.sum() > 0.0 or (nm <= 0.0).any():
        limit = "requires wavelengths above 0 and powers of at least 0, at least one of which is above 0"
        raise DataError("spectrum of the light", limit=limit)
    order = np.argsort(nm)
    return Illuminant(nm[order], weight[order] / weight.sum(), source)


def measured_light(wavelength_nm: ArrayLike, power: ArrayLike, source: str = "") -> Illuminant:
    """Return light with a measured power per nm; each wavelength represents its nearest neighbourhood.

    Values below 1 % of the peak are omitted, because a spectrometer shows noise on both sides of 0 there.
    """
    nm, values = np.asarray(wavelength_nm, dtype=float), np.asarray(power, dtype=float)
    order = np.argsort(nm)
    nm, values = nm[order], values[order]
    width = np.gradient(nm) if nm.size > 1 else np.ones(nm.size)
    lit = values >= NOISE * np.nanmax(values, initial=0.0)
    return lines(nm[lit], values[lit] * width[lit], source)


def led(peak_nm: float, fwhm_nm: float | None, source: str = "") -> Illuminant:
    """Return the light of an LED: a normal distribution about its peak, or a single line if no width is known."""
    if not fwhm_nm:
        return lines([peak_nm], [1.0], source)
    steps = np.linspace(-_REACH, _REACH, _LINES)
    return lines(peak_nm + steps * fwhm_nm / FWHM_PER_SIGMA, np.exp(-(steps**2) / 2.0), source)


def named_light(name: str) -> Illuminant:
    """Return the light of an emitter from the library, from a part's .toml file, or from a file with a spectrum."""
    if name in library() or not Path(name).suffix:
        return _light_of_part(library_part(name))
    if Path(name).suffix.lower() == ".toml":
        return _light_of_part(load_part(Path(name)))
    recording = read(name)
    traces = spectra(recording)
    if len(traces) != 1:
        names = listed([trace.channel.name for trace in traces])
        limit = f"requires one power column in addition to the wavelength, but has {names}"
        raise DataError(recording.provenance.file, limit=limit)
    source = f"spectrum of {recording.provenance.file}"
    return measured_light(traces[0].wavelength_nm, traces[0].channel.values, source)


def _light_of_part(part: object) -> Illuminant:
    if not isinstance(part, EmitterPart):
        raise DataError("--led", value=getattr(part, "name", None), limit="is not an emitter")
    peak_nm, fwhm_nm = part.peak_nm.nominal, part.fwhm_nm.nominal if part.fwhm_nm else None
    width = f", {fwhm_nm:g} nm wide" if fwhm_nm else ", width unknown"
    return led(peak_nm, fwhm_nm, f"{part.name}, peak at {peak_nm:g} nm{width}")


def index_in(spectrum: IndexSpectrum, light: Illuminant) -> Evaluated:
    """Return the index of a spectrum along ascending wavelengths for some light."""
    n = spectrum.n
    known = np.flatnonzero(n.known)
    if not known.size:
        reason = "n is masked at all wavelengths"
        return Evaluated(light.source, light.mean_nm, outside=1.0, reason=reason)
    nm = spectrum.wavelength_nm[known]
    inside, result = _inside(light, nm[0], nm[-1], "n is known")
    if result.reason:
        return result
    share, bridged = _shares(nm, known, inside.wavelength_nm, inside.share)
    random = float(np.sqrt(np.sum((share * n.u_random[known]) ** 2)))
    common = float(np.sqrt(np.sum((n.common[:, known] @ share) ** 2)))
    result = replace(result, n=float(share @ n.value[known]), bridged=bridged)
    if not np.isfinite(n.u[known][share > 0.0]).all():
        return result
    return replace(result, u_n=float(np.hypot(random, common)), u_random_n=random, u_common_n=common)


def formula_in(model: Dispersion, light: Illuminant) -> Evaluated:
    """Return the index of a formula for some light.

    The uncertainty is the mean over the light's wavelengths, as if their errors were fully correlated, which they
    nearly are.
    """
    inside, result = _inside(light, *model.range_nm, "the formula holds")
    if result.reason:
        return result
    n, u = model.along(inside.wavelength_nm)
    u_n = float(inside.share @ u) if np.isfinite(u).all() else None
    return replace(result, n=float(inside.share @ n), u_n=u_n, u_common_n=u_n)


def _inside(light: Illuminant, low_nm: float, high_nm: float, what: str) -> tuple[Illuminant, Evaluated]:
    """Return the light within a range and, if too much is outside, a result with a reason but no index."""
    inside = (light.wavelength_nm >= low_nm) & (light.wavelength_nm <= high_nm)
    outside = float(1.0 - light.share[inside].sum())
    if outside > MAX_OUTSIDE:
        reason = f"{outside:.0%} of the light is outside {low_nm:g} to {high_nm:g} nm, where {what}"
        return light, Evaluated(light.source, light.mean_nm, outside=outside, reason=reason)
    share = light.share[inside] / light.share[inside].sum()
    kept = Illuminant(light.wavelength_nm[inside], share, light.source)
    return kept, Evaluated(light.source, light.mean_nm, outside=max(outside, 0.0))


def _shares(nm: FloatArray, place: IndexArray, at: FloatArray, weight: FloatArray) -> tuple[FloatArray, float]:
    """Return the interpolation weights of the unmasked wavelengths, and the fraction of light at masked ones."""
    share = np.zeros(nm.size)
    right = np.clip(np.searchsorted(nm, at, side="left"), 1 if nm.size > 1 else 0, nm.size - 1)
    left = np.maximum(right - 1, 0)
    gap = nm[right] - nm[left]
    part = np.where(gap > 0.0, (at - nm[left]) / np.where(gap > 0.0, gap, 1.0), 1.0)
    np.add.at(share, left, weight * (1.0 - part))
    np.add.at(share, right, weight * part)
    over = (place[right] - place[left] > 1) & (part > 0.0) & (part < 1.0)
    return share, float(weight[over].sum())

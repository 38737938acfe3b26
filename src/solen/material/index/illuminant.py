"""The mean index for light with a given spectrum, such as that of an LED, or for a single wavelength.

An index between measured wavelengths is interpolated linearly, so the power-weighted mean index is a sum of measured
indices with known weights. Scatter from wavelength to wavelength averages out in it; errors common to all wavelengths
do not. The index is not extrapolated to light outside the measured range.

`lines`, `led`, `measured_light` and `named_light` return an `Illuminant`. `index_in` evaluates an index spectrum for
this light, and `formula_in` a formula.
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
"""Maximum fraction of the light at wavelengths that were not measured."""
MIN_POWER = 0.01
"""Values of a measured spectrum below this fraction of the peak are treated as noise."""
_LINES, _MAX_SIGMAS = 241, 3.0  # number of lines of an LED, and their range in standard deviations


@dataclass(frozen=True, eq=False)
class Illuminant:
    """A spectrum: wavelengths in nm in ascending order, fractions of the power (in total 1), and the source."""

    wavelength_nm: FloatArray
    weight: FloatArray
    source: str = ""

    @property
    def mean_nm(self) -> float:
        """Mean wavelength, weighted by power."""
        return float(self.wavelength_nm @ self.weight)


@dataclass(frozen=True)
class EvaluatedIndex:
    """Index for light with a spectrum, or for a single wavelength.

    Attributes
    ----------
    source
        Source of the spectrum of the light; empty for a single wavelength.
    wavelength_nm
        Mean wavelength of the light.
    n, u_n
        Index and standard uncertainty; None if unknown.
    u_random_n, u_common_n
        Random and common parts of u_n.
    bridged
        Fraction of the light at wavelengths where n is masked, and interpolated between neighbours.
    outside
        Fraction of the light at wavelengths that were not measured.
    reason
        Reason why the index is unknown, or None.
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

    A measured spectrum on a uniform grid can be used directly.

    Raises
    ------
    DataError
        If a wavelength or a power is invalid, or no power is above 0.
    """
    nm, weight = np.asarray(wavelength_nm, dtype=float), np.asarray(power, dtype=float)
    known = np.isfinite(nm) & np.isfinite(weight)
    nm, weight = nm[known], weight[known]
    if not nm.size or (weight < 0.0).any() or not weight.sum() > 0.0 or (nm <= 0.0).any():
        limit = "requires wavelengths above 0 and powers of at least 0, at least one of which is above 0"
        raise DataError("spectrum of the light", limit=limit)
    order = np.argsort(nm)
    return Illuminant(nm[order], weight[order] / weight.sum(), source)


def measured_light(wavelength_nm: ArrayLike, spectrum: ArrayLike, source: str = "") -> Illuminant:
    """Return light with a measured power per nm, weighted by the spacing of the wavelengths.

    Values below 1 % of the peak are omitted, because a spectrometer shows noise on both sides of 0 there.
    """
    nm, values = np.asarray(wavelength_nm, dtype=float), np.asarray(spectrum, dtype=float)
    order = np.argsort(nm)
    nm, values = nm[order], values[order]
    spacing = np.gradient(nm) if nm.size > 1 else np.ones(nm.size)
    keep = values >= MIN_POWER * np.nanmax(values, initial=0.0)
    return lines(nm[keep], values[keep] * spacing[keep], source)


def led(peak_nm: float, fwhm_nm: float | None, source: str = "") -> Illuminant:
    """Return the light of an LED: a normal distribution about its peak, or a single line if its width is unknown."""
    if not fwhm_nm:
        return lines([peak_nm], [1.0], source)
    sigmas = np.linspace(-_MAX_SIGMAS, _MAX_SIGMAS, _LINES)
    return lines(peak_nm + sigmas * fwhm_nm / FWHM_PER_SIGMA, np.exp(-(sigmas**2) / 2.0), source)


def named_light(name: str) -> Illuminant:
    """Return the light of an emitter in the library or in a part's .toml file, or the spectrum in any other file."""
    if name in library() or not Path(name).suffix:
        return _light_of_part(library_part(name))
    if Path(name).suffix.lower() == ".toml":
        return _light_of_part(load_part(Path(name)))
    recording = read(name)
    traces = spectra(recording)
    if len(traces) != 1:
        names = listed([trace.channel.name for trace in traces])
        limit = f"must have one column in addition to the wavelength, the power, but has {names}"
        raise DataError(recording.provenance.file, limit=limit)
    source = f"spectrum of {recording.provenance.file}"
    return measured_light(traces[0].wavelength_nm, traces[0].channel.values, source)


def _light_of_part(part: object) -> Illuminant:
    if not isinstance(part, EmitterPart):
        raise DataError("--led", value=getattr(part, "name", None), limit="is not an emitter")
    peak_nm, fwhm_nm = part.peak_nm.nominal, part.fwhm_nm.nominal if part.fwhm_nm else None
    width = f", {fwhm_nm:g} nm wide" if fwhm_nm else ", width unknown"
    return led(peak_nm, fwhm_nm, f"{part.name}, peak at {peak_nm:g} nm{width}")


def index_in(spectrum: IndexSpectrum, light: Illuminant) -> EvaluatedIndex:
    """Return the mean index for light, from a spectrum with wavelengths in ascending order."""
    n = spectrum.n
    known = np.flatnonzero(n.known)
    if not known.size:
        reason = "n is masked at all wavelengths"
        return EvaluatedIndex(light.source, light.mean_nm, outside=1.0, reason=reason)
    nm = spectrum.wavelength_nm[known]
    inside, result = _inside(light, nm[0], nm[-1], "n is known")
    if result.reason:
        return result
    weight, bridged = _interpolation_weights(nm, known, inside)
    random = float(np.sqrt(np.sum((weight * n.u_random[known]) ** 2)))
    common = float(np.sqrt(np.sum((n.common[:, known] @ weight) ** 2)))
    result = replace(result, n=float(weight @ n.value[known]), bridged=bridged)
    if not np.isfinite(n.u[known][weight > 0.0]).all():
        return result
    return replace(result, u_n=float(np.hypot(random, common)), u_random_n=random, u_common_n=common)


def formula_in(model: Dispersion, light: Illuminant) -> EvaluatedIndex:
    """Return the mean index for light, from a formula.

    The uncertainty is the weighted mean of u(n) over the wavelengths of the light, which assumes that the errors are
    fully correlated; this is nearly exact.
    """
    inside, result = _inside(light, *model.range_nm, "the formula is valid")
    if result.reason:
        return result
    n, u = model.indices(inside.wavelength_nm)
    u_n = float(inside.weight @ u) if np.isfinite(u).all() else None
    return replace(result, n=float(inside.weight @ n), u_n=u_n, u_common_n=u_n)


def _inside(light: Illuminant, low_nm: float, high_nm: float, range_text: str) -> tuple[Illuminant, EvaluatedIndex]:
    """Return the light within a range, and a result without an index, with a reason if too much light is outside."""
    inside = (light.wavelength_nm >= low_nm) & (light.wavelength_nm <= high_nm)
    outside = float(1.0 - light.weight[inside].sum())
    if outside > MAX_OUTSIDE:
        reason = f"{outside:.0%} of the light is outside {low_nm:g} to {high_nm:g} nm, where {range_text}"
        return light, EvaluatedIndex(light.source, light.mean_nm, outside=outside, reason=reason)
    weight = light.weight[inside] / light.weight[inside].sum()
    kept = Illuminant(light.wavelength_nm[inside], weight, light.source)
    return kept, EvaluatedIndex(light.source, light.mean_nm, outside=max(outside, 0.0))


def _interpolation_weights(nm: FloatArray, position: IndexArray, light: Illuminant) -> tuple[FloatArray, float]:
    """Return the weight of each unmasked wavelength in the mean index, and the fraction of the light at masked ones.

    ``position`` contains the positions of the unmasked wavelengths ``nm`` in the spectrum.
    """
    weight = np.zeros(nm.size)
    right = np.clip(np.searchsorted(nm, light.wavelength_nm, side="left"), 1 if nm.size > 1 else 0, nm.size - 1)
    left = np.maximum(right - 1, 0)
    gap = nm[right] - nm[left]
    fraction = np.where(gap > 0.0, (light.wavelength_nm - nm[left]) / np.where(gap > 0.0, gap, 1.0), 1.0)
    np.add.at(weight, left, light.weight * (1.0 - fraction))
    np.add.at(weight, right, light.weight * fraction)
    is_bridged = (position[right] - position[left] > 1) & (fraction > 0.0) & (fraction < 1.0)
    return weight, float(light.weight[is_bridged].sum())

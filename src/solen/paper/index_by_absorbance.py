"""Error of the index if the absorbance is used as the absorptance in the formula of the paper, and published indices.

Public names: `error_of_index`, `transmittance_for`, `literature_at`, `literature_between`, `rise_of_literature` and
`fall_of_polymers`.
"""

import numpy as np
from scipy.optimize import brentq

from solen.material.index import Length, as_published, reading
from solen.material.index.layer import LayerIndex
from solen.material.index.literature import band
from solen.material.resin import library, library_resin
from solen.paper.samples import LAYER_UM, index_of

_TRANSMITTANCES = (0.80, 0.92)
"""Transmittances between which the formula with the absorbance rises from below 2 to above 1.3."""


def index_at(result: LayerIndex, nm: float) -> tuple[float, float]:
    """Return the index of a layer from its fitted formula at a wavelength, and its standard uncertainty."""
    nearest = int(np.argmin(np.abs(result.wavelength_nm - nm)))
    u = float(result.u_n[nearest]) if np.isfinite(result.u_n[nearest]) else 0.0
    return float(result.n[nearest]), u


def error_of_index(result: LayerIndex, nm: float) -> tuple[float, float]:
    """Return the computed index of a simulated layer minus its true index, and its standard uncertainty."""
    n, u = index_at(result, nm)
    nearest = int(np.argmin(np.abs(result.wavelength_nm - nm)))
    return n - float(index_of(float(result.wavelength_nm[nearest]))[0]), u


def transmittance_for(index: float, nm: float) -> float:
    """Return the transmittance from which the formula of the paper computes an index, if A is taken as −log₁₀ T."""

    def residual(t: float) -> float:
        computed = as_published(np.array([nm]), reading(np.array([t]), None), Length(LAYER_UM, None)).n.value
        return float(computed[0]) - index

    return float(brentq(residual, *_TRANSMITTANCES, xtol=1e-9))


def literature_at(nm: float) -> tuple[float, float]:
    """Return the midpoint of the published indices of acrylates and photoresins, and its uncertainty."""
    band_at = band(nm)
    low, high = float(band_at.low[0]), float(band_at.high[0])
    return 0.5 * (low + high), (high - low) / np.sqrt(12.0)


def literature_between(*nm: float) -> tuple[float, float]:
    """Return the midpoint of the published indices, averaged over wavelengths, and its uncertainty."""
    middles, us = zip(*map(literature_at, nm), strict=True)
    return float(np.mean(middles)), float(np.mean(us))


def rise_of_literature(short_nm: float, long_nm: float) -> tuple[float, float]:
    """Return the published index at the shorter wavelength minus that at the longer one, and its uncertainty."""
    short, long = band(short_nm), band(long_nm)
    low, high = sorted((float(short.low[0] - long.low[0]), float(short.high[0] - long.high[0])))
    return 0.5 * (low + high), (high - low) / float(np.sqrt(12.0))


def fall_of_polymers(short_nm: float, long_nm: float) -> tuple[float, float, float]:
    """Return the decrease in index of the shipped resins between two wavelengths: midpoint, uncertainty, maximum."""
    resins = [library_resin(name) for name in library()]
    indices = [resin.index for resin in resins if resin.index.mode == "literature"]
    falls = [float(np.subtract(*index.indices([short_nm, long_nm])[0])) for index in indices]
    low, high = min(falls), max(falls)
    return 0.5 * (low + high), (high - low) / float(np.sqrt(12.0)), high

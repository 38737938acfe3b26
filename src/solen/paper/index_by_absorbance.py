"""Error of an index when the absorbance is used as the absorptance, as in the paper's formula.

Public names: `error_of_index`, `transmittance_for`, `fall_of_polymers` and `literature_at`.
"""

import numpy as np
from scipy.optimize import brentq

from solen.material.index import Length, as_published, reading
from solen.material.index.layer import LayerIndex
from solen.material.index.literature import band
from solen.material.resin import library, library_resin
from solen.paper.samples import LAYER_UM, index_of

_T = (0.80, 0.92)
"""Transmittances between which the formula with the absorbance rises from below 2 to above 1.3."""


def index_at(result: LayerIndex, nm: float) -> tuple[float, float]:
    """Return the index of a layer from its fitted formula at a wavelength, and its standard uncertainty."""
    place = int(np.argmin(np.abs(result.wavelength_nm - nm)))
    u = float(result.u_n[place]) if np.isfinite(result.u_n[place]) else 0.0
    return float(result.n[place]), u


def error_of_index(result: LayerIndex, nm: float) -> tuple[float, float]:
    """Return the computed index of a simulated layer minus its true index, and its standard uncertainty."""
    n, u = index_at(result, nm)
    place = int(np.argmin(np.abs(result.wavelength_nm - nm)))
    return n - float(index_of(float(result.wavelength_nm[place]))[0]), u


def transmittance_for(index: float, nm: float) -> float:
    """Return the transmittance from which the formula, with −log₁₀ T as A, computes an index."""

    def off(t: float) -> float:
        found = as_published(np.array([nm]), reading(np.array([t]), None), Length(LAYER_UM, None)).n.value
        return float(found[0]) - index

    return float(brentq(off, *_T, xtol=1e-9))


def literature_at(nm: float) -> tuple[float, float]:
    """Return the midpoint of the published indices of acrylates and photoresins, and its uncertainty."""
    found = band(nm)
    low, high = float(found.low[0]), float(found.high[0])
    return 0.5 * (low + high), (high - low) / np.sqrt(12.0)


def literature_between(*nm: float) -> tuple[float, float]:
    """Return the midpoint of the published indices, averaged over wavelengths, and its uncertainty."""
    middles, us = zip(*map(literature_at, nm), strict=True)
    return float(np.mean(middles)), float(np.mean(us))


def rise_of_literature(short_nm: float, long_nm: float) -> tuple[float, float]:
    """Return the index of acrylates and photoresins at the shorter wavelength minus that at the longer one, with u."""
    short, long = band(short_nm), band(long_nm)
    low, high = sorted((float(short.low[0] - long.low[0]), float(short.high[0] - long.high[0])))
    return 0.5 * (low + high), (high - low) / float(np.sqrt(12.0))


def fall_of_polymers(short_nm: float, long_nm: float) -> tuple[float, float, float]:
    """Return the fall in index of the shipped resins: midpoint of the range, its uncertainty, and the largest fall."""
    resins = [library_resin(name) for name in library()]
    known = [resin.index for resin in resins if resin.index.mode == "literature"]
    falls = [float(np.subtract(*one.along([short_nm, long_nm])[0])) for one in known]
    low, high = min(falls), max(falls)
    return 0.5 * (low + high), (high - low) / float(np.sqrt(12.0)), high

"""Films by a plain transfer matrix, averaged over slit and thickness by brute force: what a spectrophotometer reads."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from solen.arrays import FloatArray
from solen.recording import Channel, Provenance, Recording

_DRAWS = 100  # thicknesses within the beam


@dataclass(frozen=True, eq=False)
class Film:
    """A film as it is: spectra without noise, n and k along the wavelengths, and what made them."""

    nm: FloatArray
    clean: dict[str, FloatArray]
    n: FloatArray
    k: FloatArray
    thickness_um: float
    slit_nm: float
    spread: float


def coherent(n: FloatArray, k: FloatArray, thickness_um: float, nm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """T and R of a plane film in air, by the product of its interfaces' and its own matrices."""
    index = n + 1j * k
    phase = 2.0 * np.pi * index * 1e3 * thickness_um / nm
    into, out = _interface(np.ones_like(index), index), _interface(index, np.ones_like(index))
    through = np.zeros((nm.size, 2, 2), dtype=complex)
    through[:, 0, 0], through[:, 1, 1] = np.exp(-1j * phase), np.exp(1j * phase)
    whole = into @ through @ out
    return np.abs(1.0 / whole[:, 0, 0]) ** 2, np.abs(whole[:, 1, 0] / whole[:, 0, 0]) ** 2


def _interface(before: Any, after: Any) -> Any:
    r, t = (before - after) / (before + after), 2.0 * before / (before + after)
    return np.stack([np.stack([1.0 / t, r / t], axis=-1), np.stack([r / t, 1.0 / t], axis=-1)], axis=-2)


def drawn(
    rng: np.random.Generator,
    thickness_um: float,
    slit_nm: float,
    spread: float,
    *,
    step_nm: float = 1.0,
    even: bool = True,
    resonance: float = 0.0,
    pole_nm: float = 0.0,
) -> Film:
    """A film of some dispersion and absorption, 450 to 900 nm, through a triangular slit.

    A ``resonance`` moves n about 650 nm by up to so much, up below and down above, as no Cauchy formula does. With a
    ``pole_nm`` n is one pole of Sellmeier's formula instead.
    """
    low, high = 450.0, 900.0
    a, b, c = rng.uniform(1.44, 1.56), rng.uniform(0.003, 0.008), rng.uniform(0.0, 5e-4)
    dark = 10.0 ** rng.uniform(-6.5, -4.3)
    fine = step_nm / np.ceil(step_nm / min(slit_nm / 16.0, low**2 / (3.2e3 * thickness_um) / 50.0))
    margin = int(np.ceil(slit_nm / fine)) + 2
    grid = low + fine * np.arange(-margin, round((high - low) / fine) + margin + 1)
    um = grid / 1e3
    n, k = a + b / um**2 + c / um**4, dark * (1.0 + 2.0 * np.exp(-(grid - low) / 60.0))
    if pole_nm:
        n = np.sqrt(1.0 + (a**2 - 1.0) / (1.0 - (pole_nm / grid) ** 2))
    x = (grid - 650.0) / 60.0
    n = n - 2.0 * resonance * x / (1.0 + x**2)
    share = (np.arange(_DRAWS) + 0.5) / _DRAWS
    around = np.sqrt(3.0) * (2.0 * share - 1.0) if even else ndtri(share)
    sums = np.zeros((2, grid.size))
    for thickness in thickness_um * (1.0 + spread * around):
        sums += np.array(coherent(n, k, float(thickness), grid)) / _DRAWS
    reach = int(np.ceil(slit_nm / fine))
    slit = np.clip(1.0 - np.abs(np.arange(-reach, reach + 1)) * fine / slit_nm, 0.0, None)
    t, r = (np.convolve(one, slit / slit.sum(), "same") for one in sums)
    nm = np.arange(low, high + step_nm / 2.0, step_nm)
    at = np.round((nm - grid[0]) / fine).astype(int)
    return Film(nm, {"T": t[at], "R": r[at]}, n[at], k[at], thickness_um, slit_nm, spread)


def recorded(film: Film, rng: np.random.Generator, noise: float, offset: float, *, repeats: int = 3) -> Recording:
    """The film as read several times, with noise, and an error of T and of R that all wavelengths share."""
    channels = [Channel("wavelength", "wavelength", "nm", film.nm)]
    for kind, quantity in (("T", "transmittance"), ("R", "reflectance")):
        shift = rng.normal(0.0, offset)
        for number in range(repeats):
            values = film.clean[kind] + shift + rng.normal(0.0, noise, film.nm.size)
            channels.append(Channel(f"{kind}{number}", quantity, "1", values, axis="wavelength"))
    return Recording(tuple(channels), Provenance(file="film.csv", simulated=True))

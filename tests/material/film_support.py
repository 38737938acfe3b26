"""Simulated films: a transfer matrix, averaged numerically over slit and thickness, as a spectrophotometer reads it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from solen.arrays import FloatArray
from solen.recording import Channel, Provenance, Recording

_THICKNESSES = 100  # thicknesses within the beam


@dataclass(frozen=True, eq=False)
class Film:
    """A true film: spectra without noise, n and k at each wavelength, and the parameters of the simulation."""

    nm: FloatArray
    clean: dict[str, FloatArray]
    n: FloatArray
    k: FloatArray
    thickness_um: float
    slit_nm: float
    relative_sd: float  # of the thickness


def coherent(n: FloatArray, k: FloatArray, thickness_um: float, nm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return T and R of a plane film in air from the first column of its transfer matrix, up to a common factor."""
    index = n + 1j * k
    phase = 2.0 * np.pi * index * 1e3 * thickness_um / nm
    forward, backward = np.exp(-1j * phase), np.exp(1j * phase)
    (r1, t1), (r2, t2) = _interface(1.0, index), _interface(index, 1.0)
    incident, reflected = forward + r1 * r2 * backward, r1 * forward + r2 * backward
    return np.abs(t1 * t2 / incident) ** 2, np.abs(reflected / incident) ** 2


def _interface(before: Any, after: Any) -> tuple[Any, Any]:
    """Return the Fresnel amplitudes r and t at normal incidence."""
    return (before - after) / (before + after), 2.0 * before / (before + after)


def random_film(
    rng: np.random.Generator,
    thickness_um: float,
    slit_nm: float,
    relative_sd: float,
    *,
    step_nm: float = 1.0,
    uniform: bool = True,
    resonance: float = 0.0,
    pole_nm: float = 0.0,
) -> Film:
    """Return a film of random dispersion and absorption, 450 to 900 nm, through a triangular slit.

    The thickness within the beam is distributed uniformly, or normally if not ``uniform``. ``resonance`` raises n by
    up to this value below 650 nm and lowers it above, which no Cauchy formula describes. With ``pole_nm``, n is a
    Sellmeier formula of one pole instead.
    """
    low, high = 450.0, 900.0
    a, b, c = rng.uniform(1.44, 1.56), rng.uniform(0.003, 0.008), rng.uniform(0.0, 5e-4)
    base_k = 10.0 ** rng.uniform(-6.5, -4.3)
    fine = step_nm / np.ceil(step_nm / min(slit_nm / 16.0, low**2 / (3.2e3 * thickness_um) / 50.0))
    margin = int(np.ceil(slit_nm / fine)) + 2
    grid = low + fine * np.arange(-margin, round((high - low) / fine) + margin + 1)
    um = grid / 1e3
    n, k = a + b / um**2 + c / um**4, base_k * (1.0 + 2.0 * np.exp(-(grid - low) / 60.0))
    if pole_nm:
        n = np.sqrt(1.0 + (a**2 - 1.0) / (1.0 - (pole_nm / grid) ** 2))
    x = (grid - 650.0) / 60.0
    n = n - 2.0 * resonance * x / (1.0 + x**2)
    quantiles = (np.arange(_THICKNESSES) + 0.5) / _THICKNESSES
    deviations = np.sqrt(3.0) * (2.0 * quantiles - 1.0) if uniform else ndtri(quantiles)
    means = np.zeros((2, grid.size))
    for thickness in thickness_um * (1.0 + relative_sd * deviations):
        means += np.array(coherent(n, k, float(thickness), grid)) / _THICKNESSES
    reach = int(np.ceil(slit_nm / fine))
    slit = np.clip(1.0 - np.abs(np.arange(-reach, reach + 1)) * fine / slit_nm, 0.0, None)
    t, r = (np.convolve(mean, slit / slit.sum(), "same") for mean in means)
    nm = np.arange(low, high + step_nm / 2.0, step_nm)
    index = np.round((nm - grid[0]) / fine).astype(int)
    return Film(nm, {"T": t[index], "R": r[index]}, n[index], k[index], thickness_um, slit_nm, relative_sd)


def record(film: Film, rng: np.random.Generator, noise: float, offset: float, *, repeats: int = 3) -> Recording:
    """Return repeated readings of the film, with noise and an offset of T and of R common to all wavelengths."""
    channels = [Channel("wavelength", "wavelength", "nm", film.nm)]
    for kind, quantity in (("T", "transmittance"), ("R", "reflectance")):
        error = rng.normal(0.0, offset)
        for number in range(repeats):
            values = film.clean[kind] + error + rng.normal(0.0, noise, film.nm.size)
            channels.append(Channel(f"{kind}{number}", quantity, "1", values, axis="wavelength"))
    return Recording(tuple(channels), Provenance(file="film.csv", simulated=True))

"""A free-standing slab in air: reflectance and transmittance from index, extinction and thickness.

The idea: a layer much thicker than the light's coherence length adds powers, not amplitudes. With the reflectance F of
one face at normal incidence and the transmittance τ of one pass, the series of all passes sums to

    T = (1 − F)² τ / (1 − F² τ²),   R = F (1 + τ T).

F. Nichelatti, J. Opt. A 4, 400 (2002), doi:10.1088/1464-4258/4/4/306. Fringes, rough faces and scattering are not in
it.

The interface: `face`, `attenuation` and `forward`, on arrays that broadcast; `fringe_spacing_nm` says where the
incoherent formula ends.
"""

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.units import NM_PER_UM


def face(n: ArrayLike, k: ArrayLike) -> FloatArray:
    """Share of the power that one face between air and n − ik reflects at normal incidence."""
    n, k2 = np.asarray(n, dtype=float), np.asarray(k, dtype=float) ** 2
    return np.asarray(((n - 1.0) ** 2 + k2) / ((n + 1.0) ** 2 + k2))


def attenuation(thickness_um: ArrayLike, wavelength_nm: ArrayLike) -> FloatArray:
    """What k is multiplied with for the optical depth of one pass, 4πh/λ."""
    return np.asarray(4.0 * np.pi * NM_PER_UM * np.asarray(thickness_um, dtype=float) / np.asarray(wavelength_nm))


def forward(
    n: ArrayLike, k: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Reflectance and transmittance of a slab in air at normal incidence, as fractions.

    Parameters
    ----------
    n, k
        Refractive index and extinction coefficient (n > 0, k ≥ 0); arrays that broadcast with the others.
    thickness_um, wavelength_nm
        Thickness of the slab in µm and wavelength in air in nm.
    """
    n, k = np.asarray(n, dtype=float), np.asarray(k, dtype=float)
    once = face(n, k)
    through = 4.0 * n / ((n + 1.0) ** 2 + k**2)  # 1 − F without its cancellation
    tau = np.exp(-attenuation(thickness_um, wavelength_nm) * k)
    transmittance = through**2 * tau / (1.0 - (once * tau) ** 2)
    return once * (1.0 + tau * transmittance), transmittance


def fringe_spacing_nm(n: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike) -> FloatArray:
    """Distance in nm between two maxima of the interference of a layer's two faces, λ²/(2nh)."""
    wavelength = np.asarray(wavelength_nm, dtype=float)
    return np.asarray(wavelength**2 / (2.0 * np.asarray(n) * np.asarray(thickness_um) * NM_PER_UM))

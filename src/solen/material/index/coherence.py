"""Readings of a spectrophotometer on a layer whose two faces interfere, wholly or in part: the forward model.

The idea: with φ = 4πnh/λ, real Fresnel amplitudes (k ≪ n) and g the product of the two inner ones and of what one pass
leaves, a plane layer transmits (1 − F₁)(1 − F₂)τ/(1 − 2g cos φ + g²), and the rest of the light is reflected or
absorbed. The fraction is a Fourier series,

    1/(1 − 2g cos φ + g²) = (1 + 2 Σ gᵐ cos mφ)/(1 − g²),

so that a slit, a thickness that varies, a wedge or a rough face only multiply each harmonic by what they leave of it.
With nothing left it is the sum of powers of `solen.material.index.stack`, with everything left the coherent film: one
formula from one to the other.

The interface: `Blur` says what takes contrast away, `layer` is a layer as a piece to be `joined`, `stacked` the layer
on its sheet as the instrument reads it. All is analytic in its arguments, so that a complex step gives derivatives.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from solen.material.index.stack import Powers, Readings, Setup, incoherent, internal_transmittance, joined
from solen.units import NM_PER_UM

HARMONICS = 4
"""Harmonics of the series that are kept; of n = 1.6 in air the next is 5e-7 of the light."""


@dataclass(frozen=True, eq=False)
class Blur:
    """Causes that reduce the contrast of fringes.

    Attributes
    ----------
    slit_nm
        Full width at half maximum of the monochromator's triangular slit function.
    rough
        Relative standard deviation of a normally distributed thickness within the beam, as of a rough face.
    wedge
        The same of an evenly distributed one, as of a wedge.
    other
        Contrast lost otherwise, relative: to a slit function that is no triangle, or a face that is not plane.
    """

    slit_nm: Any
    rough: Any = 0.0
    wedge: Any = 0.0
    other: Any = 0.0

    def left(self, phase: Any, phase_per_nm: Any) -> Iterator[Any]:
        """Remaining shares of the harmonics 1, 2, ... for a phase φ and its change per nm."""
        slits, wedges = _sincs(phase_per_nm * self.slit_nm / 2.0), _sincs(np.sqrt(3.0) * phase * self.wedge)
        share = step = np.exp(-((phase * self.rough) ** 2) / 2.0)
        twice = step**2
        for harmonic, slit, wedge in zip(range(1, HARMONICS + 1), slits, wedges, strict=False):
            yield share * (1.0 - harmonic * self.other) * slit**2 * wedge
            step = step * twice
            share = share * step  # of harmonic m: the first to the power of m²


def _sincs(x: Any) -> Iterator[Any]:
    """The series sin(mx)/(mx) for m = 1, 2, ..., from one sine and one cosine."""
    x = np.where(x == 0.0, 1e-20, x)
    twice, before, sine = 2.0 * np.cos(x), 0.0, np.sin(x)
    for harmonic in count(1):
        yield sine / (harmonic * x)
        before, sine = sine, twice * sine - before


def layer(n: Any, slope_per_nm: Any, k: Any, thickness_um: Any, wavelength_nm: Any, behind: Any, blur: Blur) -> Powers:
    """A layer between air and a medium of index ``behind`` as a piece of a stack, its faces included.

    Parameters
    ----------
    n, slope_per_nm, k
        Index, its derivative by the wavelength, and extinction.
    thickness_um, wavelength_nm
        Of the layer, and of the light in air.
    """
    tau = internal_transmittance(k, thickness_um, wavelength_nm)
    front, back = (n - 1.0) / (n + 1.0), (n - behind) / (n + behind)
    g = front * back * tau
    path = 4.0 * np.pi * NM_PER_UM * thickness_um
    phase = path * n / wavelength_nm
    phase_per_nm = path * (slope_per_nm - n / wavelength_nm) / wavelength_nm
    series, power, before, cosine = 1.0, 1.0, 1.0, np.cos(phase)
    twice = 2.0 * cosine
    for left in blur.left(phase, phase_per_nm):
        power = power * g
        series = series + 2.0 * power * left * cosine
        before, cosine = cosine, twice * cosine - before
    series = series / (1.0 - g**2)
    one, other = front**2, back**2
    return Powers(
        1.0 - (1.0 + g**2 - one - other * tau**2) * series,
        (1.0 - one) * (1.0 - other) * tau * series,
        1.0 - (1.0 + g**2 - other - one * tau**2) * series,
    )


def stacked(piece: Powers, sheet: tuple[Any, Any, Any] | None, wavelength_nm: Any, setup: Setup | None) -> Readings:
    """Readings of a layer, free or on a sheet of index, extinction and thickness."""
    if sheet is None or setup is None:
        return Readings(piece.through, piece.front)
    n, k, thickness_um = sheet
    tau = internal_transmittance(k, thickness_um, wavelength_nm)
    face = ((n - 1.0) / (n + 1.0)) ** 2
    before = Powers(piece.front, piece.through * tau, piece.back * tau**2)
    whole = joined(before, Powers(face, 1.0 - face, face))
    bare = incoherent([n], [k], [thickness_um], wavelength_nm)
    reflected = whole.front if setup.side == "layer" else whole.back
    return Readings(
        whole.through / bare.through if setup.baseline == "substrate" else whole.through,
        reflected / bare.front if setup.baseline_r == "substrate" else reflected,
    )

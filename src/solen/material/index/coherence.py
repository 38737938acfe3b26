"""Forward model of spectrophotometer readings on a layer whose two faces interfere, fully or partially.

With φ = 4πnh/λ, real Fresnel amplitudes (k ≪ n) and g the product of the two inner amplitudes and the transmittance of
one pass, a plane layer transmits (1 − F₁)(1 − F₂)τ/(1 − 2g cos φ + g²), and the remaining light is reflected or
absorbed. The fraction is a Fourier series,

    1/(1 − 2g cos φ + g²) = (1 + 2 Σ gᵐ cos mφ)/(1 − g²),

so a slit, a varying thickness, a wedge or a rough face only multiplies each harmonic by a factor. If all factors are 0,
the result is the sum of powers of `solen.material.index.stack`; if all are 1, it is the coherent film; the same formula
covers the entire range.

`Blur` describes the causes of lost contrast; `layer` returns a layer as an element of a stack; and `stacked` returns
the instrument readings for a layer on its sheet. All functions are analytic in their arguments, so the complex-step
method gives their derivatives.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from solen.material.index.stack import Powers, Readings, Setup, incoherent, internal_transmittance, joined
from solen.units import NM_PER_UM

HARMONICS = 4
"""Number of harmonics in the series; for n = 1.6 in air, the first omitted harmonic is 5e-7 of the light."""


@dataclass(frozen=True, eq=False)
class Blur:
    """Causes that reduce the contrast of fringes.

    Attributes
    ----------
    slit_nm
        Full width at half maximum of the monochromator's triangular slit function.
    rough
        Relative standard deviation of a normally distributed thickness within the beam, for example due to a rough
        face.
    wedge
        Relative standard deviation of a uniformly distributed thickness, for example due to a wedge.
    other
        Further relative loss of contrast, for example from a slit function that is not triangular or a face that is not
        plane.
    """

    slit_nm: Any
    rough: Any = 0.0
    wedge: Any = 0.0
    other: Any = 0.0

    def left(self, phase: Any, phase_per_nm: Any) -> Iterator[Any]:
        """Yield the remaining fractions of the harmonics 1, 2, ... for a phase φ and its change per nm."""
        slits, wedges = _sincs(phase_per_nm * self.slit_nm / 2.0), _sincs(np.sqrt(3.0) * phase * self.wedge)
        share = step = np.exp(-((phase * self.rough) ** 2) / 2.0)
        twice = step**2
        for harmonic, slit, wedge in zip(range(1, HARMONICS + 1), slits, wedges, strict=False):
            yield share * (1.0 - harmonic * self.other) * slit**2 * wedge
            step = step * twice
            share = share * step  # harmonic m has the first factor to the power of m²


def _sincs(x: Any) -> Iterator[Any]:
    """Yield the series sin(mx)/(mx) for m = 1, 2, ..., from one sine and one cosine."""
    x = np.where(x == 0.0, 1e-20, x)
    twice, before, sine = 2.0 * np.cos(x), 0.0, np.sin(x)
    for harmonic in count(1):
        yield sine / (harmonic * x)
        before, sine = sine, twice * sine - before


def layer(n: Any, slope_per_nm: Any, k: Any, thickness_um: Any, wavelength_nm: Any, behind: Any, blur: Blur) -> Powers:
    """Return a layer between air and a medium of index ``behind`` as an element of a stack, including its faces.

    Parameters
    ----------
    n, slope_per_nm, k
        Index, its derivative with respect to wavelength, and extinction coefficient.
    thickness_um, wavelength_nm
        Thickness of the layer, and wavelength in air.
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
    """Return the readings for a layer, free-standing or on a sheet with a given index, extinction and thickness."""
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

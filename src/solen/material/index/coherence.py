"""Forward model of spectrophotometer readings on a layer with interference between its faces, full or partial.

With φ = 4πnh/λ, real Fresnel amplitudes (k ≪ n), the reflectances F₁ and F₂ of the faces, the transmittance τ of one
pass, and g the product of the two inner amplitudes and τ, a plane layer transmits (1 − F₁)(1 − F₂)τ/(1 − 2g cos φ +
g²); the remaining light is reflected or absorbed. The resonance factor is a Fourier series,

    1/(1 − 2g cos φ + g²) = (1 + 2 Σ gᵐ cos mφ)/(1 − g²),

so a slit, a varying thickness, a wedge or a rough face only multiplies each harmonic by a factor. If all factors are 0,
the result is the incoherent sum of `solen.material.index.stack`; if all are 1, the film is fully coherent.

`Blur` describes the causes of reduced contrast; `layer` returns a layer as an element of a stack; and `stacked` returns
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
"""Number of harmonics; for n = 1.6 in air, the amplitude of the first omitted harmonic is below 1e-6."""


@dataclass(frozen=True, eq=False)
class Blur:
    """Effects that reduce the contrast of fringes.

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
        Relative loss of contrast due to other causes, for example a slit function that is not triangular or a face that
        is not plane.
    """

    slit_nm: Any
    rough: Any = 0.0
    wedge: Any = 0.0
    other: Any = 0.0

    def factors(self, phase: Any, phase_per_nm: Any) -> Iterator[Any]:
        """Yield the factors of the harmonics 1, 2, ... for a phase φ and its derivative with respect to wavelength."""
        slits, wedges = _sincs(phase_per_nm * self.slit_nm / 2.0), _sincs(np.sqrt(3.0) * phase * self.wedge)
        rough = step = np.exp(-((phase * self.rough) ** 2) / 2.0)
        square = step**2
        for harmonic, slit, wedge in zip(range(1, HARMONICS + 1), slits, wedges, strict=False):
            yield rough * (1.0 - harmonic * self.other) * slit**2 * wedge
            step = step * square
            rough = rough * step  # for harmonic m, the factor of the first harmonic to the power of m²


def _sincs(x: Any) -> Iterator[Any]:
    """Yield sin(mx)/(mx) for m = 1, 2, ..., computed from one sine and one cosine."""
    x = np.where(x == 0.0, 1e-20, x)
    twice_cosine, previous, sine = 2.0 * np.cos(x), 0.0, np.sin(x)
    for harmonic in count(1):
        yield sine / (harmonic * x)
        previous, sine = sine, twice_cosine * sine - previous


def layer(n: Any, slope_per_nm: Any, k: Any, thickness_um: Any, wavelength_nm: Any, behind: Any, blur: Blur) -> Powers:
    """Return a layer between air and a medium of index ``behind`` as an element of a stack, including its faces.

    Parameters
    ----------
    n, slope_per_nm, k
        Index, its derivative with respect to wavelength, and extinction coefficient.
    thickness_um, wavelength_nm
        Thickness of the layer, and wavelength in air.
    behind, blur
        Index of the medium behind the layer, and causes of reduced contrast.
    """
    tau = internal_transmittance(k, thickness_um, wavelength_nm)
    front, back = (n - 1.0) / (n + 1.0), (n - behind) / (n + behind)
    g = front * back * tau
    path = 4.0 * np.pi * NM_PER_UM * thickness_um
    phase = path * n / wavelength_nm
    phase_per_nm = path * (slope_per_nm - n / wavelength_nm) / wavelength_nm
    series, power, previous, cosine = 1.0, 1.0, 1.0, np.cos(phase)
    twice_cosine = 2.0 * cosine
    for factor in blur.factors(phase, phase_per_nm):
        power = power * g
        series = series + 2.0 * power * factor * cosine
        previous, cosine = cosine, twice_cosine * cosine - previous
    series = series / (1.0 - g**2)
    f1, f2 = front**2, back**2
    return Powers(
        1.0 - (1.0 + g**2 - f1 - f2 * tau**2) * series,
        (1.0 - f1) * (1.0 - f2) * tau * series,
        1.0 - (1.0 + g**2 - f2 - f1 * tau**2) * series,
    )


def stacked(film: Powers, sheet: tuple[Any, Any, Any] | None, wavelength_nm: Any, setup: Setup | None) -> Readings:
    """Return the readings for a film from `layer`, on a sheet (n, k, thickness in µm) or, if None, free-standing."""
    if sheet is None or setup is None:
        return Readings(film.through, film.front)
    n, k, thickness_um = sheet
    tau = internal_transmittance(k, thickness_um, wavelength_nm)
    face = ((n - 1.0) / (n + 1.0)) ** 2
    film_and_sheet = Powers(film.front, film.through * tau, film.back * tau**2)
    stack = joined(film_and_sheet, Powers(face, 1.0 - face, face))
    bare = incoherent([n], [k], [thickness_um], wavelength_nm)
    reflected = stack.front if setup.side == "layer" else stack.back
    return Readings(
        stack.through / bare.through if setup.baseline == "substrate" else stack.through,
        reflected / bare.front if setup.baseline_r == "substrate" else reflected,
    )

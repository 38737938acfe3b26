"""Forward model of spectrophotometer readings on a printed layer, free-standing or on its substrate.

The reflections inside a layer that is much thicker than the coherence length of the light add incoherently, by power.
Two neighbouring elements of a stack combine to one by a geometric series, T = Ta Tb / (1 − Ra' Rb); repeated, this
combines any number of elements. For a single layer in air, with F the reflectance of a face and τ the transmittance of
one pass, the result is

    T = (1 − F)² τ / (1 − F² τ²),   R = F (1 + τ T)

(F. Nichelatti, J. Opt. A 4, 400 (2002), doi:10.1088/1464-4258/4/4/306). An instrument whose 100 % reading is that of
the bare substrate reports the ratio to that reading, which is above 1 for a lossless layer on PET, because the layer
acts as an antireflection coating.

`forward` models a single layer in air, `incoherent` one or more layers in air, and `on_substrate` the instrument
readings for a layer on a substrate, as described by a `Setup`. The model assumes normal incidence, thick layers without
fringes, no scattering, and k ≪ n, so that an interface absorbs no light. All functions broadcast and are analytic in
their arguments, so that the complex-step method gives exact derivatives. The inverse is in
`solen.material.index.inversion` and `solen.material.index.substrate`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.units import NM_PER_UM

Numbers = NDArray[Any]  # float, or complex for a complex-step derivative

Side = Literal["layer", "substrate"]
Baseline = Literal["substrate", "air"]


class Powers(NamedTuple):
    """Power fractions of an element: front reflectance, transmittance in either direction, back reflectance."""

    front: Numbers
    through: Numbers
    back: Numbers


def interface_reflectance(n1: ArrayLike, k1: ArrayLike, n2: ArrayLike, k2: ArrayLike) -> Numbers:
    """Return the Fresnel reflectance of one interface at normal incidence, the same from both sides."""
    n1, k1, n2, k2 = (np.asarray(value) for value in (n1, k1, n2, k2))
    absorbing = (k1 - k2) ** 2
    return np.asarray(((n1 - n2) ** 2 + absorbing) / ((n1 + n2) ** 2 + (k1 + k2) ** 2))


def optical_depth(thickness_um: ArrayLike, wavelength_nm: ArrayLike) -> Numbers:
    """Return the optical depth of one pass through a layer with k = 1, 4πh/λ."""
    return np.asarray(4.0 * np.pi * NM_PER_UM * np.asarray(thickness_um) / np.asarray(wavelength_nm))


def internal_transmittance(k: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike) -> Numbers:
    """Return the transmittance of one pass through a layer, exp(−4πkh/λ)."""
    return np.asarray(np.exp(-optical_depth(thickness_um, wavelength_nm) * np.asarray(k)))


def joined(left: Powers, right: Powers) -> Powers:
    """Combine two elements into one, summing all reflections between them by power."""
    series = 1 / (1 - left.back * right.front)
    return Powers(
        left.front + left.through**2 * right.front * series,
        left.through * right.through * series,
        right.back + right.through**2 * left.back * series,
    )


def incoherent(
    n: Sequence[ArrayLike], k: Sequence[ArrayLike], thickness_um: Sequence[ArrayLike], wavelength_nm: ArrayLike
) -> Powers:
    """Return reflectances and transmittance of plane layers in air, listed in the order of light from the front.

    Parameters
    ----------
    n, k, thickness_um
        Properties of each layer, arrays that broadcast with the wavelengths.
    wavelength_nm
        Wavelength in air in nm.

    Returns
    -------
    Powers
        Front reflectance, transmittance, back reflectance.

    Notes
    -----
    The power form of the matrix method for incoherent layers (C. C. Katsidis and D. I. Siapkas, Appl. Opt. 41, 3978,
    2002), in which an interface transmits 1 − R. For k > 0 the exact fraction differs by (k/n)², 1e-9 at k = 5e-5.
    """
    indices, losses = (1.0, *n, 1.0), (0.0, *k, 0.0)
    faces = [interface_reflectance(*sides) for sides in zip(indices, losses, indices[1:], losses[1:], strict=False)]
    stack, *others = (Powers(reflected, 1 - reflected, reflected) for reflected in faces)
    for face, loss, thickness in zip(others, k, thickness_um, strict=True):
        tau = internal_transmittance(loss, thickness, wavelength_nm)
        stack = joined(Powers(stack.front, stack.through * tau, stack.back * tau**2), face)
    return stack


def forward(
    n: ArrayLike, k: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the reflectance and transmittance of one layer in air at normal incidence, as fractions.

    Parameters
    ----------
    n, k
        Refractive index and extinction coefficient (n > 0, k ≥ 0); arrays that broadcast with the others.
    thickness_um, wavelength_nm
        Thickness in µm and wavelength in air in nm.
    """
    powers = incoherent([n], [k], [thickness_um], wavelength_nm)
    return powers.front, powers.through


@dataclass(frozen=True, eq=False)
class Substrate:
    """The sheet under a layer.

    Attributes
    ----------
    n, k
        Index and extinction at the wavelengths of the measurement, or a single number for all.
    thickness_um
        Thickness of the sheet.
    u_n, u_k, u_thickness_um
        Standard uncertainties, each from a single error common to all wavelengths. For PET, that of n dominates: a
        pressed sheet has an index near 1.57 at 590 nm, a drawn film an index near 1.64 in its plane.
    """

    n: ArrayLike
    k: ArrayLike
    thickness_um: float
    u_n: ArrayLike = 0.0
    u_k: ArrayLike = 0.0
    u_thickness_um: float = 0.0

    def __post_init__(self) -> None:
        """Reject impossible properties of the sheet."""
        if not (np.isfinite(self.thickness_um) and self.thickness_um > 0):
            raise DataError("substrate thickness", value=self.thickness_um, limit="must be above 0 µm")
        for name, minimum in (("n", 1.0), ("k", 0.0), ("u_n", 0.0), ("u_k", 0.0), ("u_thickness_um", 0.0)):
            values = np.asarray(getattr(self, name), dtype=float)
            if not (np.isfinite(values) & (values >= minimum)).all():
                raise DataError(f"substrate {name}", value=float(values.min()), limit=f"must be at least {minimum:g}")


@dataclass(frozen=True, eq=False)
class Setup:
    """Conditions under which a layer on its substrate was measured.

    Attributes
    ----------
    substrate
        The sheet under the layer, with its uncertainties.
    side
        Side on which the light is incident. R depends on it; T does not.
    baseline, baseline_r
        Reference for 100 % transmittance and reflectance: the bare substrate, or air (for R, a calibrated mirror).
    near
        Expected index; if two indices fit the readings, the result is the index nearer to it.
    """

    substrate: Substrate
    side: Side = "layer"
    baseline: Baseline = "substrate"
    baseline_r: Baseline = "air"
    near: float = 1.5

    @property
    def u(self) -> Mapping[str, ArrayLike]:
        """Standard uncertainties of the sheet, with the keys ``sheet_n``, ``sheet_k`` and ``sheet_um``."""
        sheet = self.substrate
        return {"sheet_n": sheet.u_n, "sheet_k": sheet.u_k, "sheet_um": sheet.u_thickness_um}


class Readings(NamedTuple):
    """Readings T and R of a layer on its substrate, relative to the 100 % readings of the instrument."""

    T: Numbers
    R: Numbers


def on_substrate(
    n: ArrayLike, k: ArrayLike, thickness_um: ArrayLike, wavelength_nm: ArrayLike, setup: Setup
) -> Readings:
    """Return the T and R that an instrument measures for a layer on a substrate.

    For a lossless layer with an index below that of the substrate, T relative to the substrate is above 1.
    """
    sheet = (setup.substrate.n, setup.substrate.k, setup.substrate.thickness_um)
    return readings((n, k, thickness_um), sheet, wavelength_nm, setup)


Layer = tuple[ArrayLike, ArrayLike, ArrayLike]  # n, k, thickness in µm


def readings(layer: Layer, sheet: Layer, wavelength_nm: ArrayLike, setup: Setup) -> Readings:
    """Return T and R of a layer on a sheet, whose properties may be complex, for complex-step derivatives."""
    first, second = (layer, sheet) if setup.side == "layer" else (sheet, layer)
    n, k, thickness_um = zip(first, second, strict=True)
    stack = incoherent(n, k, thickness_um, wavelength_nm)
    bare = incoherent(sheet[:1], sheet[1:2], sheet[2:], wavelength_nm)
    return Readings(
        stack.through / bare.through if setup.baseline == "substrate" else stack.through,
        stack.front / bare.front if setup.baseline_r == "substrate" else stack.front,
    )

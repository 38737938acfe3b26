"""What a surface is beyond smooth, clean and bare: films on it, roughness, the texture of a print, a grey mirror.

A `Surface` belongs to an interface; without one an interface is smooth, clean and bare. *Scatter* sends a share of what
leaves the surface, reflected or transmitted, into other directions; a *texture* tilts the surface itself by chance; a
*coating* is a stack of thin films between the interface's two media, computed as waves. Counting, which has no
powers, sees of all this scatter, texture, and films thicker than the wavelength, by their total reflection.

Scatter is stated in direction cosines along the surface: in the plane one number from −1 to 1, in an extruded scene a
point of the unit disc. A profile is centred on the direction that the smooth surface would give, and cut off where the
direction would leave its half-space; what it takes in is the stated share, so that no power is lost.
"""

import math
from dataclasses import dataclass
from typing import Literal

from solen.curve import check_numbers, check_range
from solen.errors import DesignError

MOST_LAYERS = 64


@dataclass(frozen=True)
class Layer:
    """A thin film: refractive index, thickness in nm, extinction coefficient (0: it absorbs nothing)."""

    index: float
    thickness_nm: float
    extinction: float = 0.0

    def __post_init__(self) -> None:
        check_range("layer index", self.index, 1e-3, 1e3)
        check_range("layer thickness_nm", self.thickness_nm, 0.0)
        check_range("layer extinction", self.extinction, 0.0)


@dataclass(frozen=True)
class Coating:
    """Thin films, walked from the region on the interface's left to the one on its right.

    A film of air between a body and what touches it is the gap of a frustrated total reflection.
    """

    layers: tuple[Layer, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.layers) <= MOST_LAYERS:
            raise DesignError("coating", value=f"{len(self.layers)} layers", limit=f"must be 1 to {MOST_LAYERS}")


@dataclass(frozen=True)
class Lambertian:
    """The ``share`` of what leaves the surface has the same radiance in all directions, wherever it came from."""

    share: float = 1.0
    kind: Literal["lambertian"] = "lambertian"

    def __post_init__(self) -> None:
        check_range("scatter share", self.share, 0.0, 1.0)


@dataclass(frozen=True)
class Gaussian:
    """The ``share`` is spread about the smooth surface's direction: exp(−Δ²/2σ²) in direction cosines Δ."""

    sigma: float
    share: float = 1.0
    kind: Literal["gaussian"] = "gaussian"

    def __post_init__(self) -> None:
        check_range("scatter share", self.share, 0.0, 1.0)
        check_range("gaussian scatter sigma", self.sigma, most=10.0, above=0.0)


@dataclass(frozen=True)
class HarveyShack:
    """The ``share`` is spread as (1 + (Δ/shoulder)²)^(−slope/2) in direction cosines Δ.

    Harvey's shift-invariant model (J. E. Harvey, 1976), with its shoulder and the slope of its wing.
    """

    shoulder: float
    slope: float
    share: float = 1.0
    kind: Literal["harvey-shack"] = "harvey-shack"

    def __post_init__(self) -> None:
        check_range("scatter share", self.share, 0.0, 1.0)
        check_range("harvey-shack shoulder", self.shoulder, 1e-4, 10.0)
        check_range("harvey-shack slope", self.slope, 0.5, 10.0)


Scatter = Lambertian | Gaussian | HarveyShack


@dataclass(frozen=True)
class Texture:
    """Sinusoidal ripple of a printed wall: amplitude (half of peak to valley) and pitch in µm.

    Its crests stand one after another along the interface (``"along"``), or along y, as of a part printed lying flat
    (``"across"``: invisible in the plane). Rays see its slopes, with a phase drawn for each; the pitch must be long
    against the wavelength, as neither diffraction nor shadows are computed.
    """

    pitch_um: float
    amplitude_um: float
    direction: Literal["along", "across"] = "along"

    def __post_init__(self) -> None:
        check_numbers("texture amplitude_um", self.amplitude_um)
        check_range("texture pitch_um", self.pitch_um, above=0.0)
        if not 0.0 <= self.slope <= 1.0:
            limit = "2 pi amplitude / pitch, its steepest slope, must be from 0 to 1"
            raise DesignError(
                "texture amplitude_um", value=self.amplitude_um, limit=limit, remedy="shadows would count"
            )

    @property
    def slope(self) -> float:
        """Its steepest slope."""
        return 2.0 * math.pi * self.amplitude_um / self.pitch_um


@dataclass(frozen=True)
class Surface:
    """What an interface is beyond smooth, clean and bare.

    Attributes
    ----------
    reflectance
        Of a mirror: the share of the power that it reflects, the rest is absorbed.
    transmitted
        Of a splitter: the share of the power that goes straight on, the rest is reflected.
    focal_mm
        Of a thin lens or a mirror: its focal length, of an ideal element that bends rays by their height over it, as
        paraxial optics do at any angle. Positive where it gathers light.
    partial
        False where refraction loses nothing to partial reflection, as under a perfect antireflection coating.
    band_nm
        Wavelengths from which to which the behaviour holds; at others the interface is a bare refracting one. From the
        higher to the lower: those outside it.
    coating, scatter, texture
        See there.
    """

    reflectance: float = 1.0
    transmitted: float = 0.5
    focal_mm: float | None = None
    partial: bool = True
    band_nm: tuple[float, float] | None = None
    coating: Coating | None = None
    scatter: Scatter | None = None
    texture: Texture | None = None

    def __post_init__(self) -> None:
        for what, share in (("reflectance", self.reflectance), ("transmitted", self.transmitted)):
            check_range(f"surface {what}", share, 0.0, 1.0)
        if self.focal_mm is not None and not (math.isfinite(self.focal_mm) and self.focal_mm != 0.0):
            raise DesignError("surface focal_mm", value=self.focal_mm, limit="must be finite and not 0")
        if self.band_nm is not None:
            check_numbers("surface band_nm", *self.band_nm)

    def acts_at(self, wavelength_nm: float | None) -> bool:
        """Whether the interface's behaviour holds at a wavelength."""
        if self.band_nm is None:
            return True
        if wavelength_nm is None:
            return False
        first, last = self.band_nm
        within = min(first, last) <= wavelength_nm <= max(first, last)
        return within if first <= last else not within

    @property
    def is_random(self) -> bool:
        """Whether what it does is drawn by chance."""
        return self.scatter is not None or self.texture is not None

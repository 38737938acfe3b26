"""Surface treatments: films, roughness, printed texture, partial reflectance.

A `Surface` belongs to an interface; without one the interface is smooth, clean and bare. A *table* gives measured power
fractions as a function of the angle of incidence; a *grating* diffracts light into its orders. *Scatter* sends a
fraction of the light that leaves the surface, reflected or transmitted, into other directions; a *texture* tilts the
surface itself at random; a *coating* is a stack of thin films between the two media, computed with wave optics.
Counting mode, which has no powers, includes only scatter, texture, orders, and total reflection at films thicker than
the wavelength.

Scatter is defined in direction cosines along the surface: in the plane one number from −1 to 1, in an extruded scene a
point of the unit disc. A profile is centred on the direction of the smooth surface and truncated where the direction
would leave its half-space; the remainder is normalised to the specified fraction, so no power is lost.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from solen.curve import check_numbers, check_range
from solen.errors import DesignError

MAX_LAYERS = 64


@dataclass(frozen=True)
class Layer:
    """A thin film: refractive index, thickness in nm, and extinction coefficient (0: no absorption)."""

    index: float
    thickness_nm: float
    extinction: float = 0.0

    def __post_init__(self) -> None:
        check_range("layer index", self.index, 1e-3, 1e3)
        check_range("layer thickness_nm", self.thickness_nm, 0.0)
        check_range("layer extinction", self.extinction, 0.0)


@dataclass(frozen=True)
class Coating:
    """Thin films, in order from the region on the left of the interface to the region on its right.

    A film of air between a body and a medium that touches it is the gap of a frustrated total reflection.
    """

    layers: tuple[Layer, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.layers) <= MAX_LAYERS:
            raise DesignError("coating", value=f"{len(self.layers)} layers", limit=f"must be 1 to {MAX_LAYERS}")


@dataclass(frozen=True)
class Lambertian:
    """Scatter in which ``share`` of the light leaves with the same radiance in all directions, at any incidence."""

    share: float = 1.0
    kind: Literal["lambertian"] = "lambertian"

    def __post_init__(self) -> None:
        check_range("scatter share", self.share, 0.0, 1.0)


@dataclass(frozen=True)
class Gaussian:
    """The fraction ``share`` is scattered with the profile exp(−Δ²/2σ²).

    Δ is the difference in direction cosine from the direction of the smooth surface.
    """

    sigma: float
    share: float = 1.0
    kind: Literal["gaussian"] = "gaussian"

    def __post_init__(self) -> None:
        check_range("scatter share", self.share, 0.0, 1.0)
        check_range("gaussian scatter sigma", self.sigma, most=10.0, above=0.0)


@dataclass(frozen=True)
class HarveyShack:
    """The fraction ``share`` is scattered with the profile (1 + (Δ/shoulder)²)^(−slope/2), Δ as for `Gaussian`.

    This is Harvey's shift-invariant model (J. E. Harvey, 1976), specified by its shoulder and the slope of its wing.
    """

    shoulder: float
    slope: float
    share: float = 1.0
    kind: Literal["harvey-shack"] = "harvey-shack"

    def __post_init__(self) -> None:
        check_range("scatter share", self.share, 0.0, 1.0)
        check_range("harvey-shack shoulder", self.shoulder, 1e-4, 10.0)
        check_range("harvey-shack slope", self.slope, 0.5, 10.0)


@dataclass(frozen=True)
class ScatterTable:
    """The fraction ``share`` is scattered with a measured ``density`` at each ``offset`` Δ, defined as for `Gaussian`.

    Offsets increase from 0 to at most 2; the density is linear in between and 0 beyond the last. Only the ratios of
    densities matter, as in a measured BSDF.
    """

    offset: tuple[float, ...]
    density: tuple[float, ...]
    share: float = 1.0
    kind: Literal["table"] = "table"

    def __post_init__(self) -> None:
        check_range("scatter share", self.share, 0.0, 1.0)
        _check_axis("scatter table offset", self.offset, 2.0, full=False)
        _check_column("scatter table density", self.density, "offset", self.offset, math.inf)
        if not any(self.density):
            raise DesignError("scatter table density", value=0, limit="must be above 0 for at least one offset")


Scatter = Lambertian | Gaussian | HarveyShack | ScatterTable


@dataclass(frozen=True)
class AngleTable:
    """Measured fractions of the power that a surface reflects and transmits, as a function of the angle of incidence.

    Attributes
    ----------
    angle_deg
        Angle of incidence in degrees, ascending from 0 to 90; fractions are linear in between.
    reflected, transmitted
        Fractions at these angles; without ``transmitted``, no light is transmitted. The remaining light is absorbed.
    reflected_p, transmitted_p
        Fractions for light polarised in the plane of incidence, if they differ; ``reflected`` and ``transmitted`` then
        apply to light polarised perpendicular to that plane.
    """

    angle_deg: tuple[float, ...]
    reflected: tuple[float, ...]
    transmitted: tuple[float, ...] = ()
    reflected_p: tuple[float, ...] = ()
    transmitted_p: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _check_axis("surface table angle_deg", self.angle_deg, 90.0, full=True)
        for name in ("reflected", "transmitted", "reflected_p", "transmitted_p"):
            if name == "reflected" or getattr(self, name):
                _check_column(f"surface table {name}", getattr(self, name), "angle", self.angle_deg, 1.0)
        for angle_deg, reflected_s, reflected_p, transmitted_s, transmitted_p in self.rows:
            most = max(reflected_s + transmitted_s, reflected_p + transmitted_p)
            if most > 1.0 + ROUNDING:
                limit = "the sum of the reflected and transmitted fractions must be at most 1"
                raise DesignError(f"surface table at {angle_deg:g} deg", value=most, limit=limit)

    @property
    def rows(self) -> tuple[tuple[float, float, float, float, float], ...]:
        """Angle in degrees, fractions reflected in s and p, fractions transmitted in s and p."""
        transmitted = self.transmitted or (0.0,) * len(self.angle_deg)
        columns = (self.reflected, self.reflected_p or self.reflected, transmitted, self.transmitted_p or transmitted)
        return tuple(zip(self.angle_deg, *columns, strict=True))


ROUNDING = 1e-9
"""Rounding error by which the sum of fractions may exceed 1."""


def _check_axis(what: str, values: tuple[float, ...], most: float, full: bool) -> None:
    check_numbers(what, *values)
    ends = len(values) > 1 and values[0] == 0.0 and (values[-1] == most if full else values[-1] <= most)
    if not ends or any(a >= b for a, b in pairwise(values)):
        given = f"{len(values)} values" + (f" from {values[0]:g} to {values[-1]:g}" if values else "")
        span = f"0 to {most:g}" if full else f"0 to at most {most:g}"
        raise DesignError(what, value=given, limit=f"must be two or more numbers in ascending order, from {span}")


def _check_column(what: str, values: tuple[float, ...], axis_name: str, axis: tuple[float, ...], most: float) -> None:
    check_numbers(what, *values)
    if len(values) != len(axis):
        count = f"{len(values)} value{'s' * (len(values) != 1)}"
        raise DesignError(what, limit=f"has {count}, but must have {len(axis)}, one for each {axis_name}")
    for value in values:
        check_range(what, value, 0.0, most)


@dataclass(frozen=True)
class Grating:
    """A thin diffraction grating in the plane, with its grooves along y.

    Diffraction order m obeys the grating equation n₂ sin θ₂ = n₁ sin θ₁ + m λ ``lines_per_mm``. Angles are positive to
    the right as seen along the incident light, from whichever side it comes.

    Attributes
    ----------
    orders
        Number m and diffraction efficiency of each order. The efficiency is the fraction of the incident power, and is
        the same at all angles; the remaining power, and that of evanescent orders, is absorbed. Efficiencies that add
        up to more than 1, which a ray-optics scene may contain, are supported only when tracing with the algorithm of
        that program.
    mirrored
        True for a reflection grating, False for a transmission grating.
    """

    lines_per_mm: float
    orders: tuple[tuple[int, float], ...]
    mirrored: bool = False

    def __post_init__(self) -> None:
        check_range("grating lines_per_mm", self.lines_per_mm, above=0.0)
        numbers = [order for order, _ in self.orders]
        if not numbers or len(set(numbers)) < len(numbers):
            raise DesignError(
                "grating orders", value=numbers, limit="must be one or more diffraction orders, all different"
            )
        for _, efficiency in self.orders:
            check_range("grating orders", efficiency, 0.0)


@dataclass(frozen=True)
class Texture:
    """Sinusoidal ripple of a printed wall: amplitude (half of peak to valley) and pitch in µm.

    The crests follow one another along the interface (``"along"``), or along y, as on a part printed lying flat
    (``"across"``: invisible in the plane). Each ray meets the slopes at a random phase. The pitch must be long compared
    with the wavelength, because neither diffraction nor shadowing is computed.
    """

    pitch_um: float
    amplitude_um: float
    direction: Literal["along", "across"] = "along"

    def __post_init__(self) -> None:
        check_numbers("texture amplitude_um", self.amplitude_um)
        check_range("texture pitch_um", self.pitch_um, above=0.0)
        if not 0.0 <= self.slope <= 1.0:
            limit = "2 pi amplitude / pitch, the steepest slope, must be from 0 to 1"
            raise DesignError(
                "texture amplitude_um",
                value=self.amplitude_um,
                limit=limit,
                remedy="reduce the amplitude: steeper slopes cast shadows",
            )

    @property
    def slope(self) -> float:
        """Largest slope of the ripple."""
        return 2.0 * math.pi * self.amplitude_um / self.pitch_um


@dataclass(frozen=True)
class Surface:
    """Treatments of an interface: films, roughness, texture, reflectance.

    Attributes
    ----------
    reflectance
        For a mirror: fraction of the power that is reflected; the remainder is absorbed.
    transmitted
        For a splitter: fraction of the power that is transmitted undeviated; the remainder is reflected.
    focal_mm
        For a thin lens or a mirror: focal length of an ideal element, which deflects rays in proportion to their height
        above its centre, as in paraxial optics, at any angle. It is positive for a converging element.
    partial
        False if refraction has no partial reflection, as with a perfect antireflection coating.
    band_nm
        Shortest and longest wavelength at which the behaviour applies; at other wavelengths the interface is bare and
        refracting. If the first value is larger, the behaviour applies outside the band.
    table, table_right
        Power fractions as a function of the angle of incidence for light from the left, and for light from the right if
        different. They replace the reflectance of a mirror, or partial reflection at a refracting interface. If no
        light can be transmitted, the transmitted fraction in the table is reflected.
    coating, scatter, texture, grating
        See the classes of these names.
    """

    reflectance: float = 1.0
    transmitted: float = 0.5
    focal_mm: float | None = None
    partial: bool = True
    band_nm: tuple[float, float] | None = None
    coating: Coating | None = None
    scatter: Scatter | None = None
    texture: Texture | None = None
    table: AngleTable | None = None
    table_right: AngleTable | None = None
    grating: Grating | None = None

    def __post_init__(self) -> None:
        for what, fraction in (("reflectance", self.reflectance), ("transmitted", self.transmitted)):
            check_range(f"surface {what}", fraction, 0.0, 1.0)
        if self.focal_mm is not None and not (math.isfinite(self.focal_mm) and self.focal_mm != 0.0):
            raise DesignError("surface focal_mm", value=self.focal_mm, limit="must be finite and not 0")
        if self.band_nm is not None:
            check_numbers("surface band_nm", *self.band_nm)
        if self.table_right is not None and self.table is None:
            raise DesignError("surface table_right", limit="requires `table` as well")

    def acts_at(self, wavelength_nm: float | None) -> bool:
        """Whether the behaviour of the interface applies at a wavelength."""
        if self.band_nm is None:
            return True
        if wavelength_nm is None:
            return False
        first, last = self.band_nm
        within = min(first, last) <= wavelength_nm <= max(first, last)
        return within if first <= last else not within

    @property
    def is_random(self) -> bool:
        """Whether the effect of the surface on a ray is random."""
        return self.scatter is not None or self.texture is not None or self.grating is not None

"""Tables of the light: the emitter and the ambient light."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.spec.quantities import Angle, Length, Place, Point, Size, Wavelength
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, refused, reported_as


def pattern_problem(pairs: Sequence[tuple[float, float]]) -> str:
    """Return what is wrong with pairs of angle (degrees) and relative intensity; empty if they are a valid pattern."""
    if len(pairs) < 2:
        return "must have at least 2 entries"
    angles = [angle for angle, _ in pairs]
    if angles[0] != 0.0 or angles[-1] > 180.0 or any(low >= high for low, high in pairwise(angles)):
        return "angles must be in ascending order from 0 to at most 180 degrees"
    values = [value for _, value in pairs]
    return "" if min(values) >= 0.0 and max(values) > 0.0 else "intensities must be at least 0 and cannot all be 0"


class Emitter(Strict):
    """The light source in front of the lens, and the rays that represent it."""

    table: ClassVar[str] = "emitter"
    reserved: ClassVar[frozenset[str]] = frozenset({"power_mW"})

    part: Text | None = Field(
        None,
        description="Name of an emitter in the library, or a part file (ends in .toml or contains a / or \\), "
        "relative to the design file. This table overrides its pattern, spectrum and size.",
    )
    wavelength_nm: Wavelength = Field(
        860.0, description="Wavelength in nm; default: that of the spectrum or the part, or 860 without them."
    )
    spectrum: Annotated[tuple[tuple[Wavelength, Positive], ...], Field(min_length=1)] | None = Field(
        None, description="Wavelengths in nm with their weights, [[850, 1], [870, 0.5]]."
    )
    fwhm_nm: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        None, description="Full width at half maximum in nm of a Gaussian spectrum centred at the wavelength."
    )
    distance_mm: Length = Field(1.0, description="Distance from the lens vertex in mm.")
    offset_mm: Place = Field(0.0, description="Decentre from the axis in mm, positive towards +x.")
    y_mm: Place = Field(
        0.0, description="Height of the emitter's centre above the mid-plane of the body in mm; in space only."
    )
    width_mm: Size = Field(0.0, description="Width of the chip perpendicular to the axis in mm; 0 for a point.")
    height_mm: Size = Field(0.0, description="Height of the chip along y in mm; 0 for a line.")
    cone_deg: Annotated[Number, Field(gt=0, le=360)] = Field(
        120.0,
        description="Full opening angle of the emission in degrees; default: 120 for a fan, 180 for uniform and "
        "lambertian, 360 for a table.",
    )
    rays: Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)] = Field(100, description="Number of rays.")
    point_mm: Annotated[Point, reported_as("must be [x_mm, z_mm] with two finite numbers")] | None = Field(
        None, description="Position [x_mm, z_mm] of the emitter of an outline; default: as drawn."
    )
    axis_deg: Annotated[Number, Field(ge=-360, le=360)] | None = Field(
        None, description="Direction of the emitter of an outline, counter-clockwise from +z; default: as drawn."
    )
    pattern: Literal["fan", "uniform", "lambertian", "table"] = Field(
        "fan",
        description="Angular pattern. fan: uniform in angle, in the plane; uniform: the same in all directions; "
        "lambertian: cos^exponent; or a table.",
    )
    exponent: Annotated[Number, Field(ge=0, le=10_000)] = Field(
        1.0, description="Exponent m of the pattern cos^m, with lambertian only."
    )
    pattern_table: Annotated[tuple[tuple[Angle, NotNegative], ...], Field(min_length=2)] | None = Field(
        None,
        description="Pairs of an angle from the axis in degrees, from 0 on, and a relative intensity per solid angle.",
    )
    pattern_file: Text | None = Field(
        None, description="Text file with an angle and an intensity on each line, relative to the design file."
    )
    ray_file: Text | None = Field(
        None,
        description="Ray file (Zemax .dat or .sdf, TM-25 .tm25ray), relative to the design file; it replaces pattern "
        "and size.",
    )

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        if self.spectrum is not None and self.fwhm_nm is not None:
            raise refused("fwhm_nm", "cannot be combined with spectrum", value=self.fwhm_nm, remedy="omit one of them")
        tables = [key for key in ("pattern_table", "pattern_file") if getattr(self, key) is not None]
        if len(tables) > 1:
            raise refused("pattern_file", "cannot be combined with pattern_table", remedy="omit one of them")
        if tables and self.pattern != "table":
            raise refused(tables[0], f'does not apply with pattern = "{self.pattern}"', remedy='set pattern = "table"')
        if self.pattern == "table" and not tables:
            remedy = "add pattern_table = [[0, 1], [90, 0]], or pattern_file"
            raise refused("pattern_table", 'is missing: required with pattern = "table"', remedy=remedy)
        if self.pattern_table is not None and (problem := pattern_problem(self.pattern_table)):
            raise refused("pattern_table", problem)
        if self.exponent != 1.0 and self.pattern != "lambertian":
            limit = f'does not apply with pattern = "{self.pattern}"'
            raise refused("exponent", limit, value=self.exponent, remedy='set pattern = "lambertian"')
        if self.height_mm > 0.0 and self.pattern == "fan" and self.part is None:
            limit = 'does not apply with pattern = "fan", which lies in the plane'
            raise refused("height_mm", limit, value=self.height_mm, remedy='set pattern = "lambertian"')
        if self.ray_file is not None:
            self._check_ray_file()
        return self

    def _check_ray_file(self) -> None:
        """Reject the keys that a ray file replaces."""
        for key in ("part", "y_mm", "width_mm", "height_mm", "cone_deg", "pattern", "spectrum", "fwhm_nm"):
            if self.sets(key):
                raise refused(key, "cannot be combined with ray_file", remedy=f"omit {key}")

    def sets(self, key: str) -> bool:
        """Return whether the design sets a key, even to its default."""
        return key in self.model_fields_set

    @property
    def is_fan(self) -> bool:
        """Whether the emitter radiates in the plane only: a fan that no part or ray file replaces."""
        replaced = self.ray_file is not None or (self.part is not None and not self.sets("pattern"))
        return self.pattern == "fan" and not replaced


class Ambient(Strict):
    """Isotropic ambient light, reported separately from the emitter's light for each receiver."""

    table: ClassVar[str] = "ambient"

    power: NotNegative = Field(
        0.0,
        description="Ambient power that enters a circle around the sensor, relative to the emitted power; 0 for none.",
    )
    irradiance_per_mm: NotNegative = Field(
        0.0, description="Ambient power per mm of an exposed face, relative to the emitted power."
    )
    rays: Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)] = Field(10_000, description="Number of rays.")

    @model_validator(mode="after")
    def _check_power(self) -> Self:
        if self.power > 0.0 and self.irradiance_per_mm > 0.0:
            limit, value = "cannot be combined with power", self.irradiance_per_mm
            raise refused("irradiance_per_mm", limit, value=value, remedy="omit one of them")
        return self

"""Tables of the light: the emitter and the ambient light."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.spec.quantities import Angle, Length, Place, Point, Size, Wavelength
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, or_refuse, refused


def why_no_pattern(pairs: Sequence[tuple[float, float]]) -> str:
    """Return why pairs of angle (degrees) and relative intensity are no valid pattern; empty if they are."""
    if len(pairs) < 2:
        return "must have at least 2 entries"
    angles = [angle for angle, _ in pairs]
    if angles[0] != 0.0 or angles[-1] > 180.0 or any(low >= high for low, high in pairwise(angles)):
        return "its angles must ascend from 0, up to 180 at most"
    values = [value for _, value in pairs]
    return "" if min(values) >= 0.0 and max(values) > 0.0 else "its values must be at least 0 and cannot all be 0"


class Emitter(Strict):
    """The light source in front of the lens, and the rays that represent it."""

    table: ClassVar[str] = "emitter"
    reserved: ClassVar[frozenset[str]] = frozenset({"power_mW"})

    part: Text | None = Field(
        None,
        description="Name of an emitter in the library, or a part file (ends in .toml or contains a / or \\), "
        "relative to the design file. Its pattern, spectrum and size apply unless this table "
        "states them.",
    )
    wavelength_nm: Wavelength = Field(
        860.0, description="Wavelength in nm; default: that of the part or the spectrum, or 860 if neither is stated."
    )
    spectrum: Annotated[tuple[tuple[Wavelength, Positive], ...], Field(min_length=1)] | None = Field(
        None, description="Wavelengths in nm with their weights, [[850, 1], [870, 0.5]]."
    )
    fwhm_nm: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        None, description="Full width at half maximum, in nm, of a Gaussian spectrum about the wavelength."
    )
    distance_mm: Length = Field(1.0, description="Distance to the lens vertex in mm.")
    offset_mm: Place = Field(0.0, description="Decentre from the axis in mm, positive towards +x.")
    y_mm: Place = Field(
        0.0, description="Height of the emitter's centre above the body's mid-plane in mm; in space only."
    )
    width_mm: Size = Field(0.0, description="Width of the chip across the axis in mm; 0 for a point.")
    height_mm: Size = Field(0.0, description="Height of the chip along y in mm; 0 for a line.")
    cone_deg: Annotated[Number, Field(gt=0, le=360)] = Field(
        120.0,
        description="Full opening angle of the emission in degrees; default: 120 for a fan, 180 for "
        "uniform and lambertian, 360 for a table.",
    )
    rays: Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)] = Field(100, description="Number of rays.")
    point_mm: Annotated[Point, or_refuse("must be [x_mm, z_mm] with two finite numbers")] | None = Field(
        None, description="Position [x_mm, z_mm] of the emitter of an outline; default: as drawn."
    )
    axis_deg: Annotated[Number, Field(ge=-360, le=360)] | None = Field(
        None, description="Direction of the emitter of an outline, counter-clockwise from +z; default: as drawn."
    )
    pattern: Literal["fan", "uniform", "lambertian", "table"] = Field(
        "fan",
        description="Angular pattern: uniform in angle in the plane (a fan), uniform in all directions, "
        "cos^exponent, or a table.",
    )
    exponent: Annotated[Number, Field(ge=0, le=10_000)] = Field(
        1.0, description="Exponent m of the pattern cos^m; with lambertian only."
    )
    pattern_table: Annotated[tuple[tuple[Angle, NotNegative], ...], Field(min_length=2)] | None = Field(
        None,
        description="Pairs of angle from the axis in degrees, starting at 0, and relative intensity per solid angle.",
    )
    pattern_file: Text | None = Field(
        None, description="Text file with pairs of angle and intensity, one pair per line, relative to the design file."
    )
    ray_file: Text | None = Field(
        None,
        description="File of rays (Zemax .dat or .sdf, TM-25 .tm25ray), relative to the design file; it replaces "
        "pattern and size.",
    )

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if self.spectrum is not None and self.fwhm_nm is not None:
            raise refused(
                "fwhm_nm", "cannot be combined with spectrum", value=self.fwhm_nm, remedy="keep one of the two"
            )
        tables = [key for key in ("pattern_table", "pattern_file") if getattr(self, key) is not None]
        if len(tables) > 1:
            raise refused("pattern_file", "cannot be combined with pattern_table", remedy="keep one of the two")
        if tables and self.pattern != "table":
            raise refused(tables[0], f'does not apply with pattern = "{self.pattern}"', remedy='set pattern = "table"')
        if self.pattern == "table" and not tables:
            remedy = "add pattern_table = [[0, 1], [90, 0]], or pattern_file"
            raise refused("pattern_table", 'missing: pattern = "table" needs it', remedy=remedy)
        if self.pattern_table is not None and (bad := why_no_pattern(self.pattern_table)):
            raise refused("pattern_table", bad)
        if self.exponent != 1.0 and self.pattern != "lambertian":
            limit = f'does not apply with pattern = "{self.pattern}"'
            raise refused("exponent", limit, value=self.exponent, remedy='set pattern = "lambertian"')
        if self.height_mm > 0.0 and self.pattern == "fan" and self.part is None:
            limit = 'does not apply with pattern = "fan", which lies in the plane'
            raise refused("height_mm", limit, value=self.height_mm, remedy='set pattern = "lambertian"')
        if self.ray_file is not None:
            self._rays_alone()
        return self

    def _rays_alone(self) -> None:
        """Reject the keys that a ray file replaces: all emitter keys except the wavelength."""
        for key in ("part", "y_mm", "width_mm", "height_mm", "cone_deg", "pattern", "spectrum", "fwhm_nm"):
            if self.states(key):
                raise refused(key, "cannot be combined with ray_file", remedy="leave it out")

    def states(self, key: str) -> bool:
        """Return whether the design file contains a key, even if its value is the default."""
        return key in self.model_fields_set

    @property
    def is_fan(self) -> bool:
        """Whether the emitter radiates in the plane only, without a part or a ray file."""
        replaced = self.ray_file is not None or (self.part is not None and not self.states("pattern"))
        return self.pattern == "fan" and not replaced


class Ambient(Strict):
    """Isotropic ambient light, reported for every receiver separately from the emitter's light."""

    table: ClassVar[str] = "ambient"

    power: NotNegative = Field(
        0.0,
        description="Ambient power through a circle around the sensor, relative to the emitter's power; 0 for none.",
    )
    irradiance_per_mm: NotNegative = Field(
        0.0, description="Ambient power per mm of an exposed face, relative to the emitter's power."
    )
    rays: Annotated[int, Field(strict=True, ge=1, le=1_000_000_000)] = Field(10_000, description="Number of rays.")

    @model_validator(mode="after")
    def _stated_once(self) -> Self:
        if self.power > 0.0 and self.irradiance_per_mm > 0.0:
            raise refused(
                "irradiance_per_mm", "cannot be combined with power", value=self.irradiance_per_mm, remedy="keep one"
            )
        return self

"""Settings of a process: the parameters of printer and resin in the print model, and quantities derived from them."""

import math
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.fabricate.grey import Greys
from solen.fabricate.process.response import GaussianPixel, MeasuredPixel, PixelResponse, measured_pixel
from solen.material.cure.law import CureLaw
from solen.material.cure.spectral import ONE_LINE, Lines
from solen.spec.strict import Number, Positive, Strict, refused

_SUM_TOLERANCE = 1e-3
_DEEP = 10.0  # penetration depths

Micrometres = Annotated[Number, Field(gt=0, le=1e4)]
ScatteredFraction = Annotated[Number, Field(ge=0, le=0.9)]
Seconds = Annotated[Number, Field(gt=0, le=1e4)]
Fraction = Annotated[Number, Field(ge=0, le=1)]
Percent = Annotated[Number, Field(ge=-20, le=20)]


class Settings(Strict):
    """Parameters of the steps from an image to the part; lengths in µm, doses in mJ/cm²."""

    table: ClassVar[str] = "process"
    error: ClassVar[type[SolenError]] = DataError

    pixel_um: Micrometres = Field(27.0, description="Size of a pixel in the plane of the resin, along x.")
    pixel_y_um: Micrometres | None = Field(
        None, description="Size of a pixel along Y of the printer (z of a flat part), if pixels are not square."
    )
    layer_um: Annotated[Number, Field(ge=1, le=1000)] = Field(25.0, description="Layer thickness.")
    irradiance_mW_per_cm2: Positive = Field(13.0, description="Irradiance at the window.")
    exposure_s: Seconds = Field(2.0, description="Exposure time of a layer.")
    burn_in_layers: Annotated[int, Field(strict=True, ge=0, le=10_000)] = Field(
        6, description="Number of burn-in layers: first layers with a longer exposure."
    )
    burn_in_s: Seconds = Field(3.0, description="Exposure time of the burn-in layers.")
    Dp_um: Micrometres = Field(
        100.0, description="Penetration depth of the light; at the surface if lamp has several lines."
    )
    Ec_mJ_per_cm2: Positive = Field(5.0, description="Critical dose, above which the resin cures.")
    lamp: tuple[tuple[Positive, Positive], ...] = Field(
        (),
        description="Lines of the lamp, each with its fraction of the light and its absorption relative to the mean at "
        "the surface, from solen resin cure --penetration; omitted for a single wavelength.",
    )
    sigma_um: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        15.0,
        description="Standard deviation of the point-spread function of the projector at the window; omitted if there "
        "is a response.",
    )
    response: PixelResponse | None = Field(
        None, description="Measured light of one pixel at the window, instead of its rectangle and sigma_um."
    )
    response_scale: Annotated[Number, Field(ge=0.1, le=10)] = Field(
        1.0, description="Factor by which the lengths of the response are multiplied."
    )
    halo_um: Annotated[Number, Field(gt=0, le=1e4)] = Field(
        60.0, description="Standard deviation of the scattered light at the window."
    )
    halo_per_depth: Annotated[Number, Field(ge=0, le=3)] = Field(
        0.3, description="Broadening of the scattered light with depth, µm per µm (added in quadrature)."
    )
    halo_fraction: ScatteredFraction = Field(0.05, description="Fraction of the light that is scattered.")
    shrinkage_percent: Percent = Field(1.0, description="Linear shrinkage in the plane, about the lens vertex.")
    shrinkage_z_percent: Percent = Field(1.0, description="Linear shrinkage along the printing direction.")
    wash_um: Annotated[Number, Field(ge=-1000, le=1000)] = Field(
        0.0,
        description="Displacement of a wall along its normal due to washing: positive for swelling, negative for "
        "erosion.",
    )
    taper_deg: Annotated[Number, Field(ge=-30, le=30)] = Field(
        0.0,
        description="Taper of walls beyond that due to the dose; positive if the part widens away from the plate.",
    )

    grey: tuple[tuple[Fraction, Fraction], ...] = Field(
        (),
        description="Measured pairs of grey level and light, as fractions of the full values; omitted if light is "
        "proportional to grey level.",
    )
    grey_drawn: Literal["corrected", "proportional"] = Field(
        "corrected",
        description="How edges are drawn. corrected: with the grey level that gives the covered fraction of the light; "
        "proportional: with a grey level equal to the covered fraction.",
    )
    grey_power: Annotated[Number, Field(gt=0.05, le=10)] = Field(
        1.0,
        description="Exponent of the light of a grey pixel; 1 if the measured (or proportional) response is correct.",
    )

    @model_validator(mode="before")
    @classmethod
    def _omit_default_blur(cls, data: Any) -> Any:
        """Omit the default of sigma_um if there is a response, which replaces it."""
        return {"sigma_um": None} | data if isinstance(data, dict) and data.get("response") is not None else data

    @model_validator(mode="after")
    def _check_blur(self) -> Self:
        if (self.sigma_um is None) == (self.response is None):
            limit = "cannot be combined with process.response: both define the light of a pixel"
            raise refused("sigma_um", limit, value=self.sigma_um, remedy="omit one of them")
        if self.response is None and self.response_scale != 1.0:
            limit = "does not apply without process.response"
            raise refused("response_scale", limit, value=self.response_scale, remedy="omit response_scale")
        return self

    @model_validator(mode="after")
    def _check_greys(self) -> Self:
        for (grey, light), (next_grey, next_light) in pairwise(self.grey):
            if not (grey < next_grey and light <= next_light):
                limit = "must be in ascending order of grey level, and the light must not fall"
                raise refused("grey", limit, value=[next_grey, next_light])
        if self.grey and self.grey[-1][0] == 1.0 and self.grey[-1][1] != 1.0:
            raise refused("grey", "must be [1, 1] for the full grey level", value=list(self.grey[-1]))
        return self

    @model_validator(mode="after")
    def _check_lamp(self) -> Self:
        fraction, absorption = np.array(self.lines).T
        sums = {"fractions": fraction.sum(), "products of fraction and absorption": fraction @ absorption}
        for name, total in sums.items():
            if abs(total - 1.0) > _SUM_TOLERANCE:
                raise refused("lamp", f"the sum of the {name} of its lines must be 1, not {total:.4g}")
        return self

    @model_validator(mode="after")
    def _check_doses(self) -> Self:
        if self.halo_um < self.blur_um:
            blur = "sigma_um" if self.response is None else "the blur of the response"
            limit = f"must be at least {blur}, {self.blur_um:.4g}, because scattered light is wider"
            raise refused("halo_um", limit, value=self.halo_um)
        self._check_dose("exposure_s", self.exposure_s)
        if self.burn_in_layers:
            self._check_dose("burn_in_s", self.burn_in_s)
        return self

    def _check_dose(self, key: str, seconds: float) -> None:
        """Reject an exposure that cures nothing."""
        dose = seconds * self.irradiance_mW_per_cm2
        if dose <= self.Ec_mJ_per_cm2:
            limit = f"gives {dose:.3g} mJ/cm², not more than the critical dose of {self.Ec_mJ_per_cm2:g} mJ/cm²"
            min_s = self.Ec_mJ_per_cm2 / self.irradiance_mW_per_cm2
            raise refused(key, limit, value=seconds, remedy=f"expose for more than {min_s:.3g} s")

    @property
    def dose_mJ_per_cm2(self) -> float:
        """Dose of a normal layer at the window."""
        return self.exposure_s * self.irradiance_mW_per_cm2

    @property
    def cure_depth_um(self) -> float:
        """Cure depth of one exposure of a normal layer; at a single wavelength, Dp ln(E/Ec)."""
        return self.law.depth_um(self.dose_mJ_per_cm2)

    @property
    def law(self) -> CureLaw:
        """Cure law of the resin."""
        return CureLaw(self.Dp_um, self.Ec_mJ_per_cm2, self.lines)

    @property
    def lines(self) -> Lines:
        """Lines of the lamp; one line for a single wavelength."""
        return self.lamp or ONE_LINE

    def transmitted(self, depth_um: ArrayLike) -> FloatArray:
        """Return the fraction of the light that is transmitted to a depth."""
        return self.law.transmitted(depth_um)

    @property
    def deep_Dp_um(self) -> float:
        """Penetration depth far below the surface, which determines the number of layers that affect one another."""
        fraction, absorption = np.array(self.lines).T
        light = fraction * np.exp(-_DEEP * absorption)
        return self.Dp_um * float(light.sum() / (light @ absorption))

    @property
    def greys(self) -> Greys:
        """Light of grey pixels."""
        return Greys(self.grey, self.grey_drawn == "corrected", self.grey_power, self.pixels_um)

    def exposures(self, layers: int) -> FloatArray:
        """Return the doses at the window of the layers of a part, (layers,), in printing order."""
        doses = np.full(layers, self.dose_mJ_per_cm2)
        doses[: self.burn_in_layers] = self.burn_in_s * self.irradiance_mW_per_cm2
        return doses

    def middle_um(self, thickness_mm: float) -> float:
        """Return the mid-height of a part, which is printed as an integer number of layers."""
        return 0.5 * max(1, round(1e3 * thickness_mm / self.layer_um)) * self.layer_um

    def inside_mJ_per_cm2(self) -> float:
        """Return the mean dose deep inside a part, where all layers are equally wide."""
        relative_depth = sum(fraction / absorption for fraction, absorption in self.lines)
        return self.dose_mJ_per_cm2 * self.Dp_um * relative_depth / self.layer_um

    @property
    def pixels_um(self) -> tuple[float, float]:
        """Sizes of a pixel along X and Y of the printer."""
        return self.pixel_um, self.pixel_um if self.pixel_y_um is None else self.pixel_y_um

    @property
    def pixel_light(self) -> GaussianPixel | MeasuredPixel:
        """Light of one pixel at the window."""
        if self.response is None:
            return GaussianPixel(self.sigma_um or 0.0, self.pixels_um)
        return measured_pixel(self.response, self.response_scale, self.pixels_um)

    @property
    def blur_key(self) -> str:
        """Key of the parameter that determines the width of the blur."""
        return "sigma_um" if self.response is None else "response_scale"

    @property
    def blur_um(self) -> float:
        """Standard deviation of the Gaussian that blurs the rectangle of a pixel to the width of its light."""
        return self.pixel_light.blur_um

    @property
    def covered_um(self) -> float:
        """Contribution of pixel coverage to the width of an edge, averaged over its position and direction."""
        return math.hypot(*self.pixels_um) / math.sqrt(24.0)

    @property
    def grey_shift_um(self) -> float:
        """Outward shift of a straight edge because light is not proportional to coverage."""
        return self.greys.shift * float(np.mean(self.pixels_um))

    @property
    def edge_um(self) -> float:
        """Standard deviation of the blur of a straight edge: pixel coverage, rectangle of a pixel, and blur."""
        return math.hypot(self.blur_um, math.sqrt(2.0) * self.covered_um)

    @property
    def min_feature_um(self) -> float:
        """Half period of a wavy wall that keeps `MIN_HEIGHT` of its height; a blur σ leaves exp(−2 (π σ / period)²)."""
        return self.edge_um * math.pi / math.sqrt(-2.0 * math.log(MIN_HEIGHT))


MIN_HEIGHT = 0.9
"""Fraction of its height with which a bump as wide as `Settings.min_feature_um` prints."""
KEYS: tuple[str, ...] = tuple(Settings.model_fields)
UNCERTAIN: tuple[str, ...] = tuple(
    key
    for key in KEYS
    if key not in {"burn_in_layers", "pixel_um", "pixel_y_um", "layer_um", "grey", "grey_drawn", "response"}
)
"""Parameters that may have an uncertainty; pixels, layers and numbers of layers are exact, and the uncertainty of grey
levels is that of ``grey_power``.
"""

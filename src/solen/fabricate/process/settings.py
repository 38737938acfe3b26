"""Process settings: the printer and resin parameters that a print model needs, and derived quantities."""

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
from solen.spec.strict import (
    Number,
    Positive,
    Strict,
    refused,
)

_WHOLE = 1e-3
_FAR = 10.0  # penetration depths

Micrometres = Annotated[Number, Field(gt=0, le=1e4)]
Share = Annotated[Number, Field(ge=0, le=0.9)]
Seconds = Annotated[Number, Field(gt=0, le=1e4)]
GreyShare = Annotated[Number, Field(ge=0, le=1)]
Percent = Annotated[Number, Field(ge=-20, le=20)]


class Settings(Strict):
    """Parameters of the steps from an image to the part; lengths in µm, doses in mJ/cm²."""

    table: ClassVar[str] = "process"
    error: ClassVar[type[SolenError]] = DataError

    pixel_um: Micrometres = Field(27.0, description="Pixel side in the plane of the resin, along x.")
    pixel_y_um: Micrometres | None = Field(
        None, description="Pixel side along the printer's Y (z of a flat part), if pixels are not square."
    )
    layer_um: Annotated[Number, Field(ge=1, le=1000)] = Field(25.0, description="Layer thickness.")
    irradiance_mW_per_cm2: Positive = Field(13.0, description="Irradiance at the window.")
    exposure_s: Seconds = Field(2.0, description="Exposure of a layer.")
    burn_in_layers: Annotated[int, Field(strict=True, ge=0, le=10_000)] = Field(
        6, description="Number of first layers that are exposed for burn_in_s."
    )
    burn_in_s: Seconds = Field(3.0, description="Exposure of the burn-in layers.")
    Dp_um: Micrometres = Field(100.0, description="Penetration depth of the light; with a lamp, at the surface.")
    Ec_mJ_per_cm2: Positive = Field(5.0, description="Critical dose, at which the resin sets.")
    lamp: tuple[tuple[Positive, Positive], ...] = Field(
        (),
        description="Lamp lines: light fraction and relative absorption of each, from solen resin "
        "cure --penetration (relative to the mean at the surface); without a table, one wavelength.",
    )
    sigma_um: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        15.0,
        description="Standard deviation of the projector's point-spread function at the "
        "window; omitted if there is a response.",
    )
    response: PixelResponse | None = Field(
        None, description="Measured light of one pixel at the window, in place of its rectangle and sigma_um."
    )
    response_scale: Annotated[Number, Field(ge=0.1, le=10)] = Field(
        1.0, description="Factor by which the lengths of the response are multiplied."
    )
    halo_um: Annotated[Number, Field(gt=0, le=1e4)] = Field(
        60.0, description="Standard deviation of the scattered light at the window."
    )
    halo_per_depth: Annotated[Number, Field(ge=0, le=3)] = Field(
        0.3, description="Growth of the scattered light with depth, µm per µm (added in quadrature)."
    )
    halo_fraction: Share = Field(0.05, description="Fraction of the light that is scattered.")
    shrinkage_percent: Percent = Field(1.0, description="Linear shrinkage in the plane, about the lens vertex.")
    shrinkage_z_percent: Percent = Field(1.0, description="Linear shrinkage along the printing direction.")
    wash_um: Annotated[Number, Field(ge=-1000, le=1000)] = Field(
        0.0,
        description="Displacement of a wall along its normal due to washing: positive for swelling, "
        "negative for erosion.",
    )
    taper_deg: Annotated[Number, Field(ge=-30, le=30)] = Field(
        0.0, description="Wall taper beyond that due to the dose; positive if walls widen away from the platform."
    )

    grey: tuple[tuple[GreyShare, GreyShare], ...] = Field(
        (),
        description="Measured pairs of grey level and light, as fractions of the full values; "
        "none for proportional light.",
    )
    grey_drawn: Literal["corrected", "proportional"] = Field(
        "corrected",
        description="How edges are drawn: with the grey level that transmits the covered fraction "
        "of light, or with the covered fraction.",
    )
    grey_power: Annotated[Number, Field(gt=0.05, le=10)] = Field(
        1.0,
        description="Exponent applied to the light of a grey pixel; 1 if the measured response "
        "(or proportionality) is correct.",
    )

    @model_validator(mode="before")
    @classmethod
    def _one_blur(cls, data: Any) -> Any:
        """Check that a response replaces the Gaussian blur, which may be omitted only then."""
        return {"sigma_um": None} | data if isinstance(data, dict) and data.get("response") is not None else data

    @model_validator(mode="after")
    def _states_one_blur(self) -> Self:
        if (self.sigma_um is None) == (self.response is None):
            limit = "cannot be combined with process.response, as both define the light of a pixel"
            raise refused("sigma_um", limit, value=self.sigma_um, remedy="omit one of the two")
        if self.response is None and self.response_scale != 1.0:
            raise refused("response_scale", "applies to a response, and none is specified", value=self.response_scale)
        return self

    @model_validator(mode="after")
    def _greys_ascend(self) -> Self:
        for (grey, light), (more, brighter) in pairwise(self.grey):
            if not (grey < more and light <= brighter):
                raise refused("grey", "must ascend, and the light must not fall", value=[more, brighter])
        if self.grey and self.grey[-1][0] == 1.0 and self.grey[-1][1] != 1.0:
            raise refused("grey", "the full grey level must have a light of 1", value=list(self.grey[-1]))
        return self

    @model_validator(mode="after")
    def _lamp_is_whole(self) -> Self:
        share, absorption = np.array(self.lines).T
        for name, total in (("shares", float(share.sum())), ("shares times absorption", float(share @ absorption))):
            if abs(total - 1.0) > _WHOLE:
                raise refused("lamp", f"{name} must add up to 1, not {total:.4g}", value=f"{len(self.lamp)} lines")
        return self

    @model_validator(mode="after")
    def _sets(self) -> Self:
        if self.halo_um < self.blur_um:
            blur = "sigma_um" if self.response is None else "the blur of the response"
            limit = f"must be at least {blur}, {self.blur_um:.4g}: scattered light is wider"
            raise refused("halo_um", limit, value=self.halo_um)
        self._check_dose("exposure_s", self.exposure_s)
        if self.burn_in_layers:
            self._check_dose("burn_in_s", self.burn_in_s)
        return self

    def _check_dose(self, key: str, seconds: float) -> None:
        """Reject an exposure that cures nothing."""
        dose = seconds * self.irradiance_mW_per_cm2
        if dose <= self.Ec_mJ_per_cm2:
            limit = f"gives {dose:.3g} mJ/cm², but the resin sets at {self.Ec_mJ_per_cm2:g} mJ/cm²: nothing cures"
            least = self.Ec_mJ_per_cm2 / self.irradiance_mW_per_cm2
            raise refused(key, limit, value=seconds, remedy=f"expose for more than {least:.3g} s")

    @property
    def dose_mJ_per_cm2(self) -> float:
        """Dose of a normal layer at the window."""
        return self.exposure_s * self.irradiance_mW_per_cm2

    @property
    def cure_depth_um(self) -> float:
        """Cure depth of one normal layer's exposure; Dp ln(E/Ec) at one wavelength."""
        return self.law.depth_um(self.dose_mJ_per_cm2)

    @property
    def law(self) -> CureLaw:
        """The law by which light cures the resin."""
        return CureLaw(self.Dp_um, self.Ec_mJ_per_cm2, self.lines)

    @property
    def lines(self) -> Lines:
        """Lamp lines; a single line for one wavelength."""
        return self.lamp or ONE_LINE

    def left(self, depth_um: ArrayLike) -> FloatArray:
        """Return the fraction of the light that remains at a depth."""
        return self.law.transmitted(depth_um)

    @property
    def deep_Dp_um(self) -> float:
        """Penetration depth far below the surface, which determines the number of relevant layers."""
        share, absorption = np.array(self.lines).T
        lit = share * np.exp(-_FAR * absorption)
        return self.Dp_um * float(lit.sum() / (lit @ absorption))

    @property
    def greys(self) -> Greys:
        """Light of grey pixels."""
        return Greys(self.grey, self.grey_drawn == "corrected", self.grey_power, self.pixels_um)

    def exposures(self, layers: int) -> FloatArray:
        """Return the dose at the window of each layer of a part, in printing order, shape (layers,)."""
        doses = np.full(layers, self.dose_mJ_per_cm2)
        doses[: self.burn_in_layers] = self.burn_in_s * self.irradiance_mW_per_cm2
        return doses

    def middle_um(self, thickness_mm: float) -> float:
        """Return the mid-height of a part with an integer number of layers."""
        return 0.5 * max(1, round(1e3 * thickness_mm / self.layer_um)) * self.layer_um

    def inside_mJ_per_cm2(self) -> float:
        """Return the mean dose deep inside a part, where all layers are equally wide."""
        longer = sum(share / absorption for share, absorption in self.lines)
        return self.dose_mJ_per_cm2 * self.Dp_um * longer / self.layer_um

    @property
    def pixels_um(self) -> tuple[float, float]:
        """Pixel sides along the printer's X and Y."""
        return self.pixel_um, self.pixel_um if self.pixel_y_um is None else self.pixel_y_um

    @property
    def pixel_light(self) -> GaussianPixel | MeasuredPixel:
        """Light of one pixel at the window."""
        if self.response is None:
            return GaussianPixel(self.sigma_um or 0.0, self.pixels_um)
        return measured_pixel(self.response, self.response_scale, self.pixels_um)

    @property
    def blur_key(self) -> str:
        """Key of the parameter that varies the blur width."""
        return "sigma_um" if self.response is None else "response_scale"

    @property
    def blur_um(self) -> float:
        """Standard deviation of the blur of a pixel rectangle; for a response, that of an equally wide Gaussian."""
        return self.pixel_light.blur_um

    @property
    def covered_um(self) -> float:
        """Standard deviation added to an edge by pixel coverage, averaged over edge positions and directions."""
        return math.hypot(*self.pixels_um) / math.sqrt(24.0)

    @property
    def grey_shift_um(self) -> float:
        """Outward shift of a straight edge if grey levels do not transmit light in proportion to coverage."""
        return self.greys.shift * float(np.mean(self.pixels_um))

    @property
    def edge_um(self) -> float:
        """Standard deviation of a straight edge's blur, from pixel coverage, pixel rectangle and blur."""
        return math.hypot(self.blur_um, math.sqrt(2.0) * self.covered_um)

    @property
    def min_feature_um(self) -> float:
        """Half period at which a wavy wall keeps `KEPT` of its height; a blur σ leaves exp(−2 (π σ / period)²)."""
        return self.edge_um * math.pi / math.sqrt(-2.0 * math.log(KEPT))


KEPT = 0.9
"""Fraction of its height that a bump as wide as `Settings.min_feature_um` keeps when printed."""
KEYS: tuple[str, ...] = tuple(Settings.model_fields)
UNCERTAIN: tuple[str, ...] = tuple(
    key
    for key in KEYS
    if key not in {"burn_in_layers", "pixel_um", "pixel_y_um", "layer_um", "grey", "grey_drawn", "response"}
)
"""Parameters that may have an uncertainty; pixels, layers and layer counts are exact, and grey levels have the
uncertainty of their power.
"""

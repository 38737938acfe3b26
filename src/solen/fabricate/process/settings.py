"""The process file: the properties of a printer and a resin, each number with its uncertainty and its source.

The idea: a prediction is only as good as its inputs. So the file holds three tables with the same keys: the value
(``[process]``), its standard uncertainty (``[uncertainty]``) and its source (``[source]``), and the covariance
of jointly calibrated numbers. Missing numbers are those of the default, with its sources.

The default follows the publication that solen is built around (Cafiso et al., Methods) where it states a
number: 13 mW/cm², layers of 25 µm, 2 s, six burn-in layers of 3 s. It states only bounds of the working curve, and
nothing about the projector: those values are assumptions, marked as such in the file.

The interface: `read_process`, `default_process`, `process_text`; `Process` holds the three tables, `Settings` the
values.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import tomli_w
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.fabricate.grey import Greys
from solen.fabricate.process.response import GaussianPixel, MeasuredPixel, PixelResponse, light_of_file, measured_pixel
from solen.files import read_text
from solen.material.cure.law import CureLaw
from solen.material.cure.spectral import ONE_LINE, Lines
from solen.ranks import Caution, do_not_use, look_at
from solen.spec.strict import (
    Document,
    Migrations,
    NotNegative,
    Number,
    Positive,
    Strict,
    Text,
    error_context,
    migrated,
    parse_toml,
    refused,
)

SCHEMA = 1
MIGRATIONS: Migrations = {}

Micrometres = Annotated[Number, Field(gt=0, le=1e4)]
Share = Annotated[Number, Field(ge=0, le=0.9)]
Seconds = Annotated[Number, Field(gt=0, le=1e4)]
GreyShare = Annotated[Number, Field(ge=0, le=1)]
Percent = Annotated[Number, Field(ge=-20, le=20)]


class Settings(Strict):
    """The steps from an image to the part; lengths in µm, doses in mJ/cm²."""

    table: ClassVar[str] = "process"
    error: ClassVar[type[SolenError]] = DataError

    pixel_um: Micrometres = Field(27.0, description="Side of a pixel in the plane of the resin, along x.")
    pixel_y_um: Micrometres | None = Field(
        None, description="Its side along the printer's Y, a flat part's z, where pixels are not squares."
    )
    layer_um: Annotated[Number, Field(ge=1, le=1000)] = Field(25.0, description="Thickness of a layer.")
    irradiance_mW_per_cm2: Positive = Field(13.0, description="Irradiance at the window.")
    exposure_s: Seconds = Field(2.0, description="Exposure of a layer.")
    burn_in_layers: Annotated[int, Field(strict=True, ge=0, le=10_000)] = Field(
        6, description="How many layers, first, are exposed for burn_in_s."
    )
    burn_in_s: Seconds = Field(3.0, description="Exposure of these.")
    Dp_um: Micrometres = Field(100.0, description="Penetration depth of the light; with a lamp, at the surface.")
    Ec_mJ_per_cm2: Positive = Field(5.0, description="Critical dose, at which the resin sets.")
    lamp: tuple[tuple[Positive, Positive], ...] = Field(
        (),
        description="Lines of the lamp: share of each and its absorption over the mean at the surface, as solen resin "
        "cure --penetration gives them; without, one wavelength.",
    )
    sigma_um: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        15.0, description="Standard deviation of the projector's point-spread at the window; none beside a response."
    )
    response: PixelResponse | None = Field(
        None, description="Measured light of one pixel at the window, in place of its rectangle and sigma_um."
    )
    response_scale: Annotated[Number, Field(ge=0.1, le=10)] = Field(
        1.0, description="By what the response's lengths are multiplied."
    )
    halo_um: Annotated[Number, Field(gt=0, le=1e4)] = Field(
        60.0, description="Standard deviation of the scattered light at the window."
    )
    halo_per_depth: Annotated[Number, Field(ge=0, le=3)] = Field(
        0.3, description="By how much that grows with depth, µm per µm (added in squares)."
    )
    halo_fraction: Share = Field(0.05, description="Share of the light that is scattered.")
    shrinkage_percent: Percent = Field(1.0, description="Linear shrinkage in the plane, about the lens's vertex.")
    shrinkage_z_percent: Percent = Field(1.0, description="Linear shrinkage along the direction of printing.")
    wash_um: Annotated[Number, Field(ge=-1000, le=1000)] = Field(
        0.0, description="What washing adds to a wall along its normal: swelling above 0, erosion below."
    )
    taper_deg: Annotated[Number, Field(ge=-30, le=30)] = Field(
        0.0, description="Lean of the walls beyond that of the dose; above 0 they widen away from the platform."
    )

    grey: tuple[tuple[GreyShare, GreyShare], ...] = Field(
        (),
        description="Measured pairs of grey value and light, as shares of the full ones; none for proportional light.",
    )
    grey_drawn: Literal["corrected", "proportional"] = Field(
        "corrected", description="How an edge is drawn: by the grey that gives its share of light, or by that share."
    )
    grey_power: Annotated[Number, Field(gt=0.05, le=10)] = Field(
        1.0,
        description="Exponent of a grey pixel's light beyond that: 1 where proportion, or the measured answer, holds.",
    )

    @model_validator(mode="before")
    @classmethod
    def _one_blur(cls, data: Any) -> Any:
        """A response takes the place of the Gaussian blur, which only then may be left out."""
        return {"sigma_um": None} | data if isinstance(data, dict) and data.get("response") is not None else data

    @model_validator(mode="after")
    def _states_one_blur(self) -> Self:
        if (self.sigma_um is None) == (self.response is None):
            limit = "cannot be combined with process.response, as both define the light of a pixel"
            raise refused("sigma_um", limit, value=self.sigma_um, remedy="leave one out")
        if self.response is None and self.response_scale != 1.0:
            raise refused("response_scale", "is for a response, and none is stated", value=self.response_scale)
        return self

    @model_validator(mode="after")
    def _greys_ascend(self) -> Self:
        for (grey, light), (more, brighter) in pairwise(self.grey):
            if not (grey < more and light <= brighter):
                raise refused("grey", "must ascend, and its light not fall", value=[more, brighter])
        if self.grey and self.grey[-1][0] == 1.0 and self.grey[-1][1] != 1.0:
            raise refused("grey", "a full grey value has a light of 1", value=list(self.grey[-1]))
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
            limit = f"must be at least {blur}, {self.blur_um:.4g}: scattered light is the wider"
            raise refused("halo_um", limit, value=self.halo_um)
        self._check_dose("exposure_s", self.exposure_s)
        if self.burn_in_layers:
            self._check_dose("burn_in_s", self.burn_in_s)
        return self

    def _check_dose(self, key: str, seconds: float) -> None:
        """Reject an exposure that cures nothing at all."""
        dose = seconds * self.irradiance_mW_per_cm2
        if dose <= self.Ec_mJ_per_cm2:
            limit = f"gives {dose:.3g} mJ/cm², and the resin sets from {self.Ec_mJ_per_cm2:g} mJ/cm² on: nothing cures"
            least = self.Ec_mJ_per_cm2 / self.irradiance_mW_per_cm2
            raise refused(key, limit, value=seconds, remedy=f"expose for more than {least:.3g} s")

    @property
    def dose_mJ_per_cm2(self) -> float:
        """Dose of an ordinary layer at the window."""
        return self.exposure_s * self.irradiance_mW_per_cm2

    @property
    def cure_depth_um(self) -> float:
        """Cure depth of one ordinary layer's exposure; Dp ln(E/Ec) at one wavelength."""
        return self.law.depth_um(self.dose_mJ_per_cm2)

    @property
    def law(self) -> CureLaw:
        """The law by which light cures the resin."""
        return CureLaw(self.Dp_um, self.Ec_mJ_per_cm2, self.lines)

    @property
    def lines(self) -> Lines:
        """Lines of the lamp, one at one wavelength."""
        return self.lamp or ONE_LINE

    def left(self, depth_um: ArrayLike) -> FloatArray:
        """Share of the light that is left at a depth."""
        return self.law.left(depth_um)

    @property
    def deep_Dp_um(self) -> float:
        """Penetration depth far below the surface, which says how many layers matter."""
        share, absorption = np.array(self.lines).T
        lit = share * np.exp(-_FAR * absorption)
        return self.Dp_um * float(lit.sum() / (lit @ absorption))

    @property
    def greys(self) -> Greys:
        """Light of grey pixels."""
        return Greys(self.grey, self.grey_drawn == "corrected", self.grey_power, self.pixels_um)

    def exposures(self, layers: int) -> FloatArray:
        """Dose at the window of each of some layers, the first printed first, shape (layers,)."""
        doses = np.full(layers, self.dose_mJ_per_cm2)
        doses[: self.burn_in_layers] = self.burn_in_s * self.irradiance_mW_per_cm2
        return doses

    def inside_mJ_per_cm2(self) -> float:
        """Mean dose far inside a part, where all layers are as wide."""
        longer = sum(share / absorption for share, absorption in self.lines)
        return self.dose_mJ_per_cm2 * self.Dp_um * longer / self.layer_um

    @property
    def pixels_um(self) -> tuple[float, float]:
        """Sides of a pixel along the printer's X and Y."""
        return self.pixel_um, self.pixel_um if self.pixel_y_um is None else self.pixel_y_um

    @property
    def pixel_light(self) -> GaussianPixel | MeasuredPixel:
        """Light of one pixel at the window."""
        if self.response is None:
            return GaussianPixel(self.sigma_um or 0.0, self.pixels_um)
        return measured_pixel(self.response, self.response_scale, self.pixels_um)

    @property
    def blur_key(self) -> str:
        """Key of the number that the blur's width is varied by."""
        return "sigma_um" if self.response is None else "response_scale"

    @property
    def blur_um(self) -> float:
        """Standard deviation of the blur of a pixel's rectangle, by a response that of a Gaussian as wide."""
        return self.pixel_light.blur_um

    @property
    def covered_um(self) -> float:
        """Standard deviation that an edge gets by covering shares of pixels, mean over its places and directions."""
        return math.hypot(*self.pixels_um) / math.sqrt(24.0)

    @property
    def grey_shift_um(self) -> float:
        """Outward shift of a straight edge whose greys transmit other light than their share."""
        return self.greys.shift * float(np.mean(self.pixels_um))

    @property
    def edge_um(self) -> float:
        """Standard deviation of a straight edge's blur: by covered shares, by the pixel's rectangle, and its blur."""
        return math.hypot(self.blur_um, math.sqrt(2.0) * self.covered_um)


KEYS: tuple[str, ...] = tuple(Settings.model_fields)
UNCERTAIN: tuple[str, ...] = tuple(
    key
    for key in KEYS
    if key not in {"burn_in_layers", "pixel_um", "pixel_y_um", "layer_um", "grey", "grey_drawn", "response"}
)
"""Numbers that may have an uncertainty; pixel, layer and number of layers are exact, greys have that of their power."""


GROWTH = "growth_um"
"""Growth of a straight wall: what a calibration finds in place of the critical dose."""
CRITICAL = "Ec_mJ_per_cm2"
U_RESPONSE = 0.05
"""Default standard uncertainty of a response's scale."""
_WHOLE = 1e-3
_FAR = 10.0  # penetration depths


class Calibration(Strict):
    """Jointly fitted numbers, and their covariance in the units of their keys.

    ``growth_um`` among them means that walls grow as measured, whatever the other numbers.
    """

    table: ClassVar[str] = "calibration"
    error: ClassVar[type[SolenError]] = DataError

    keys: tuple[Text, ...] = Field(description="names of the numbers.")
    covariance: tuple[tuple[Number, ...], ...] = Field(description="covariance, a row for each.")
    features: Annotated[int, Field(strict=True, ge=0)] = Field(0, description="How many features it rests on.")
    simulated: Annotated[bool, Field(strict=True)] = Field(False, description="Whether these were computed.")

    @model_validator(mode="after")
    def _is_sound(self) -> Self:
        allowed = (GROWTH, *UNCERTAIN)
        unknown = next((key for key in self.keys if key not in allowed), None)
        if unknown is not None:
            raise refused("keys", f"must be some of {', '.join(allowed)}", value=unknown)
        matrix = np.array(self.covariance, dtype=float) if self._is_square() else np.full((1, 1), -1.0)
        if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix).min() < -1e-9 * abs(np.trace(matrix)):
            count = len(self.keys)
            raise refused("covariance", f"must be a covariance of {count} numbers: {count} rows of {count}, symmetric")
        return self

    def _is_square(self) -> bool:
        return bool(self.keys) and [len(row) for row in self.covariance] == [len(self.keys)] * len(self.keys)


class Process(Strict):
    """A process file: a name, and values, uncertainties and sources by key."""

    error: ClassVar[type[SolenError]] = DataError

    name: Text = Field(description="the process's name, one line.")
    process: Settings = Field(default_factory=Settings, description="The values.")
    uncertainty: dict[str, NotNegative] = Field(default_factory=dict, description="Standard uncertainties by key.")
    source: dict[str, str] = Field(default_factory=dict, description="Where each value comes from.")
    calibration: Calibration | None = Field(None, description="Covariance of the calibrated numbers.")

    @model_validator(mode="after")
    def _keys_are_known(self) -> Self:
        for table, allowed in (("uncertainty", UNCERTAIN), ("source", KEYS)):
            for key in getattr(self, table):
                if key not in allowed:
                    raise refused(table, f"must be one of {', '.join(allowed)}", value=key)
        unused = "response_scale" if self.process.response is None else "sigma_um"
        if unused in self.uncertainty:
            limit = f"is of no number here: the process states {'no' if unused != 'sigma_um' else 'a'} response"
            raise refused(f"uncertainty.{unused}", limit, value=self.uncertainty[unused], remedy="leave it out")
        return self

    @property
    def keeps_growth(self) -> bool:
        """Whether the growth of walls is known, and is kept when other numbers are varied."""
        return self.calibration is not None and GROWTH in self.calibration.keys

    def covariance(self) -> tuple[tuple[str, ...], FloatArray]:
        """Keys of the uncertain numbers and their covariance: the calibration's, else diagonal.

        If the growth of walls is known, it represents the critical dose.
        """
        together: tuple[str, ...] = () if self.calibration is None else self.calibration.keys
        alone = [key for key in UNCERTAIN if self.uncertainty.get(key, 0.0) > 0.0 and key not in together]
        if self.keeps_growth and CRITICAL in alone:
            alone.remove(CRITICAL)
        matrix = np.diag([0.0] * len(together) + [self.uncertainty[key] ** 2 for key in alone])
        if self.calibration is not None:
            matrix[: len(together), : len(together)] = self.calibration.covariance
        return (*together, *alone), matrix

    def with_settings(self, **values: Any) -> "Process":
        """Return the same with some values set; their uncertainty and source go, as those are of the old ones."""
        data = self.model_dump(exclude_unset=False)
        data["process"] |= values
        for key in values:
            data["uncertainty"].pop(key, None)
            data["source"].pop(key, None)
        if set(values) - {"pixel_um", "pixel_y_um"}:
            data["calibration"] = None
        return Process(**data)

    @property
    def greys(self) -> Greys:
        """Light of grey pixels; they are those of its pixels where these are not assumed."""
        assumed = self.source.get("pixel_um", "").lower().startswith("assum")
        return replace(self.process.greys, pixels_um=None) if assumed else self.process.greys

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Keys whose value is an assumption, as the first word of its source says or because it has none."""
        unused = {"sigma_um"} if self.process.response is not None else {"response", "response_scale"}
        stated = [key for key in KEYS if key not in unused]
        return tuple(key for key in stated if self.source.get(key, "assumption").lower().startswith("assum"))

    def warnings(self) -> list[Caution]:
        """Warnings about prints modelled with these numbers."""
        messages, s = [], self.process
        if s.cure_depth_um < s.layer_um:
            messages.append(
                do_not_use(
                    f"the layers do not hold: {s.exposure_s:g} s ({s.dose_mJ_per_cm2:.3g} mJ/cm2) cure "
                    f"{s.cure_depth_um:.3g} µm, less than a layer of {s.layer_um:g} µm; expose for longer or slice "
                    "thinner"
                )
            )
        hot = None if s.response is None else s.response.hot
        if hot is not None:
            row, column, ratio = hot
            messages.append(
                do_not_use(
                    f"process.response: sample {column} of row {row} is {ratio:.3g} times its brightest neighbour: "
                    "probably a hot pixel of the camera; replace it by the mean of its neighbours"
                )
            )
        assumed = [key for key in self.assumptions if key in UNCERTAIN]
        if assumed:
            messages.append(
                look_at(
                    f"assumed, not measured: {', '.join(assumed)}; calibrate them with coupons: solen print calibrate"
                )
            )
        if self.calibration is not None and self.calibration.simulated:
            messages.append(
                look_at(
                    "numbers of the process rest on simulated coupons or a simulated working curve, not on measured "
                    "ones"
                )
            )
        return messages


def default_process() -> Process:
    """Process that solen ships, each number with its source in the file."""
    text = (files("solen.fabricate.process") / "default.toml").read_text(encoding="utf-8")
    return parsed_process(text, "default process")


def read_process(path: Path) -> Process:
    """Process of a file; `DataError` if it cannot be read or a value is not possible."""
    return parsed_process(read_text(path, DataError), str(path), path.parent)


def response_of_file(path: Path) -> Path | None:
    """File of the measured light that a process file names; None if it names none."""
    data: Any = parse_toml(read_text(path, DataError), str(path), DataError)
    for key in ("process", "response", "file"):
        data = data.get(key) if isinstance(data, dict) else None
    return path.parent / data if isinstance(data, str) else None


def parsed_process(text: str, what: str, folder: Path = Path()) -> Process:
    """Process of a TOML text; what it leaves out is the default's, with the default's uncertainty and source.

    A response's file is one of the folder.
    """
    data = migrated(parse_toml(text, what, DataError), what, current=SCHEMA, migrations=MIGRATIONS, error=DataError)
    _read_response(data, what, folder)
    with error_context(what):
        process = Process(**data)
        return process if what == "default process" else _completed(process)


def _read_response(data: Document, what: str, folder: Path) -> None:
    """Put the light of a response's file in its place, and the file into the sources."""
    table = data.get("process", {}).get("response") if isinstance(data.get("process"), dict) else None
    if not isinstance(table, dict) or "file" not in table:
        return
    file = table.pop("file")
    if not isinstance(file, str) or "light" in table:
        limit = "must be the name of a file, and the only statement of the light, without light"
        raise DataError(f"{what}: process.response.file", value=file, limit=limit)
    table["light"] = light_of_file(folder / file)
    if isinstance(source := data.setdefault("source", {}), dict):
        source.setdefault("response", f"measured: {file}")


def _completed(process: Process) -> Process:
    """Process with uncertainty and source of the default for the keys that it leaves out."""
    default = default_process()
    if process.process.response is not None and "response_scale" not in process.uncertainty:
        source = {"response_scale": f"assumption: the picture's scale and focus known to {100 * U_RESPONSE:g} %"}
        stated = "response_scale" in process.process.model_fields_set
        u = process.uncertainty | ({} if stated else {"response_scale": U_RESPONSE})
        process = process.model_copy(update={"source": source | process.source, "uncertainty": u})
    left_out = [key for key in KEYS if key not in process.process.model_fields_set]
    values = {key: getattr(default.process, key) for key in left_out}
    u = {key: default.uncertainty[key] for key in left_out if key in default.uncertainty}
    source = {key: default.source[key] for key in left_out if key in default.source}
    data = process.model_dump()
    data["process"] |= values
    data["uncertainty"] = u | data["uncertainty"]
    data["source"] = source | data["source"]
    return Process(**data)


def process_text(process: Process) -> str:
    """TOML text of a process, all of its values stated; `read_process` gives the process back."""
    data: Mapping[str, Any] = process.model_dump(exclude_none=True)
    return tomli_w.dumps({"schema": SCHEMA, **{key: value for key, value in data.items() if value or key == "name"}})

"""Part files of emitters, receivers, ADCs and trimmers, with a small library.

Every number in a part file has a source. The file is TOML with ``schema = 1``, a ``name``, a ``kind``, the ``document``
that it is based on, and a table for every quantity: ``min``, ``typical`` and ``max``, their ``basis`` (the part's own
datasheet, the datasheet of a similar part, the profile of a slicer, a measurement or an estimate) and their ``source``.
Unknown values are omitted.

`load_part`, `library` and `library_part` return `EmitterPart`, `ReceiverPart`, `AdcPart` or `TrimmerPart`.
"""

from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.errors import DataError, SolenError
from solen.spec.light import pattern_problem
from solen.spec.shipped import Library
from solen.spec.strict import (
    Migrations,
    NotNegative,
    Number,
    Positive,
    Strict,
    Text,
    refused,
)

PART_SCHEMA = 1
PART_MIGRATIONS: Migrations = {}  # old version -> function that converts its tables to the next version

Basis = Literal["datasheet", "sibling", "profile", "measured", "estimate"]
Angle = Annotated[Number, Field(ge=0, le=180)]


class Sourced(Strict):
    """A value or table with its basis and source."""

    error: ClassVar[type[SolenError]] = DataError

    basis: Basis = Field(description="basis of the number: datasheet, sibling, profile, measured or estimate.")
    source: Text = Field(description="source of the number, or method of the estimate, in one line.")


class Quantity(Sourced):
    """A positive number with its range; the key ends in its unit."""

    min: Positive | None = Field(None, description="Minimum.")
    typical: Positive | None = Field(None, description="Typical value.")
    max: Positive | None = Field(None, description="Maximum.")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        values = [value for value in (self.min, self.typical, self.max) if value is not None]
        if not values:
            raise refused("", "has no value", remedy="add typical, or min and max")
        if any(low > high for low, high in pairwise(values)):
            raise refused("", "min, typical and max must be in ascending order", value=values)
        return self

    @property
    def nominal(self) -> float:
        """Typical value or, if only limits are specified, their mean."""
        limits = [value for value in (self.min, self.max) if value is not None]
        return self.typical if self.typical is not None else sum(limits) / len(limits)


class PatternPart(Sourced):
    """Relative radiant intensity against the angle from the axis, rotationally symmetric and linearly interpolated."""

    angle_deg: tuple[Angle, ...] = Field(description="angles from the axis in degrees, in ascending order from 0.")
    relative: tuple[NotNegative, ...] = Field(description="relative intensities at these angles.")

    @model_validator(mode="after")
    def _check_pattern(self) -> Self:
        _check_lengths("angle_deg", self.angle_deg, self.relative)
        if problem := pattern_problem(tuple(zip(self.angle_deg, self.relative, strict=True))):
            raise refused("", problem)
        return self


class SpectrumPart(Sourced):
    """Relative sensitivity against wavelength, linearly interpolated, and constant outside the range."""

    wavelength_nm: tuple[Positive, ...] = Field(description="wavelengths in nm, in ascending order.")
    relative: tuple[NotNegative, ...] = Field(description="relative sensitivities at these wavelengths.")

    @model_validator(mode="after")
    def _check_spectrum(self) -> Self:
        _check_lengths("wavelength_nm", self.wavelength_nm, self.relative)
        if len(self.wavelength_nm) < 2 or any(low >= high for low, high in pairwise(self.wavelength_nm)):
            raise refused("wavelength_nm", "must contain at least 2 values in ascending order")
        if not max(self.relative) > 0.0:
            raise refused("relative", "must not be 0 everywhere")
        return self


def _check_lengths(key: str, positions: tuple[float, ...], relative: tuple[float, ...]) -> None:
    if len(relative) != len(positions):
        raise refused("relative", f"has {len(relative)} values, but must have {len(positions)}, as many as {key}")


class AdcRange(Sourced):
    """An input range of an ADC, with its input noise."""

    low_v: Number = Field(description="lower limit of the range, in V.")
    high_v: Number = Field(description="upper limit of the range, in V.")
    noise_uv: NotNegative = Field(description="standard deviation of the input noise, in µV.")

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if not self.low_v < self.high_v:
            raise refused("high_v", f"must be above low_v = {self.low_v:g}", value=self.high_v)
        return self


class Sheet(Strict):
    """Keys of every part file."""

    error: ClassVar[type[SolenError]] = DataError

    name: Text = Field(description="name of the part, in one line.")
    maker: Text = Field(description="manufacturer, in one line.")
    document: Text = Field(description="document that contains the numbers, in one line.")
    notes: str = Field("", description="Further information.")

    @property
    def estimates(self) -> tuple[str, ...]:
        """Keys with values that are estimates, not specifications or measurements."""
        lists = {key: value if isinstance(value, tuple) else (value,) for key, value in self}
        return tuple(
            key
            for key, values in lists.items()
            if any(isinstance(value, Sourced) and value.basis == "estimate" for value in values)
        )


class Datasheet(Sheet):
    """Keys that emitters and receivers have in common."""

    half_angle_deg: Quantity | None = Field(
        None, description="Angle from the axis at which the intensity or sensitivity is half of that on the axis."
    )
    package_width_mm: Quantity | None = Field(None, description="Longer side of the package.")
    package_height_mm: Quantity | None = Field(None, description="Shorter side of the package.")
    package_depth_mm: Quantity | None = Field(
        None, description="Depth of the package, from its window to its contacts."
    )


class EmitterPart(Datasheet):
    """A light source: pattern, spectrum and power, with their ranges."""

    kind: Literal["emitter"] = Field(description="emitter.")
    peak_nm: Quantity = Field(description="a table with the peak wavelength.")
    fwhm_nm: Quantity | None = Field(None, description="Full width of the spectrum at half maximum.")
    pattern: PatternPart = Field(description="a table with the relative intensity against angle.")
    width_mm: Quantity | None = Field(None, description="Width of the emitting chip.")
    height_mm: Quantity | None = Field(None, description="Height of the emitting chip.")
    intensity_mw_per_sr: Quantity | None = Field(None, description="Radiant intensity on the axis, in mW/sr.")
    power_mw: Quantity | None = Field(None, description="Radiant power, in mW.")
    current_ma: Quantity | None = Field(None, description="Current at which power and intensity are specified, in mA.")
    rise_ns: Quantity | None = Field(None, description="Rise time in ns.")
    power_exponent: Quantity | None = Field(
        None, description="Exponent of the dependence of radiant power on current; 1 if proportional."
    )
    max_current_ma: Quantity | None = Field(None, description="Maximum continuous current, in mA.")
    fall_percent_per_k: Quantity | None = Field(None, description="Decrease of the radiant power per K, in percent.")


class ReceiverPart(Datasheet):
    """A light receiver: sensitivity, spectral band and limits."""

    kind: Literal["receiver"] = Field(description="receiver.")
    current_ua_per_mw_cm2: Quantity = Field(description="a table with the current in µA at 1 mW/cm².")
    sensitivity_nm: Quantity | None = Field(None, description="Wavelength at which the sensitivity is specified.")
    band_nm: Quantity | None = Field(None, description="Wavelengths at which the sensitivity is half of its maximum.")
    max_current_ma: Quantity | None = Field(None, description="Maximum current, in mA.")
    supply_v: Quantity | None = Field(None, description="Voltage at which the sensitivity is specified, in V.")
    max_supply_v: Quantity | None = Field(None, description="Maximum voltage, in V.")
    spectrum: SpectrumPart | None = Field(None, description="A table with the relative sensitivity against wavelength.")
    saturation_v: Quantity | None = Field(None, description="Saturation voltage, in V.")
    knee_v: Quantity | None = Field(
        None,
        description="Width of the knee above saturation, in V: the voltage over which the deficit of the current "
        "decreases by a factor of e.",
    )
    gain: Quantity | None = Field(None, description="Transistor gain: collector current per photocurrent.")
    dark_na: Quantity | None = Field(None, description="Dark current at 25 °C, in nA.")
    dark_doubling_k: Quantity | None = Field(None, description="Temperature rise that doubles the dark current, in K.")
    rise_percent_per_k: Quantity | None = Field(None, description="Increase of the sensitivity per K, in percent.")
    rise_us: Quantity | None = Field(None, description="Rise time with a small load, in µs.")
    rise_us_per_kohm: Quantity | None = Field(None, description="Additional rise time per kΩ of load, in µs.")


class AdcPart(Sheet):
    """An analogue-to-digital converter."""

    kind: Literal["adc"] = Field(description="adc.")
    bits: Annotated[int, Field(strict=True, ge=1, le=32)] = Field(description="resolution in bits.")
    range: Annotated[tuple[AdcRange, ...], Field(min_length=1)] = Field(description="a list of tables, [[range]].")
    bandwidth_khz: Quantity | None = Field(None, description="Bandwidth of the input, in kHz.")


class TrimmerPart(Sheet):
    """A trimmer resistor."""

    kind: Literal["trimmer"] = Field(description="trimmer.")
    resistance_ohm: Quantity = Field(description="a table with the total resistance in ohm.")
    end_ohm: Quantity | None = Field(None, description="Residual resistance at the end stop, in ohm.")
    turn_deg: Quantity | None = Field(None, description="Angle of rotation from one end stop to the other.")
    drift_ppm_per_k: Quantity | None = Field(
        None, description="Temperature coefficient of the resistance, in ppm per K, of either sign."
    )
    power_mw: Quantity | None = Field(None, description="Maximum power, in mW.")


Part = EmitterPart | ReceiverPart | AdcPart | TrimmerPart
KINDS: dict[str, type[EmitterPart] | type[ReceiverPart] | type[AdcPart] | type[TrimmerPart]] = {
    "emitter": EmitterPart,
    "receiver": ReceiverPart,
    "adc": AdcPart,
    "trimmer": TrimmerPart,
}


def load_part(path: Path | str) -> Part:
    """Read a part file.

    Raises
    ------
    DataError
        If the file cannot be read, is not TOML, has another schema, or is not a valid part.
    """
    return _LIBRARY.load(path)


def library() -> tuple[str, ...]:
    """Return the sorted names of the parts in the library."""
    return _LIBRARY.names()


@cache
def library_part(name: str) -> Part:
    """Return a part from the library; raise `DataError` with the nearest name if no part has this name."""
    return _LIBRARY.shipped(name)


def _part(**data: Any) -> Part:
    kind = KINDS.get(str(data.get("kind")))
    if kind is None:
        remedy = 'add for example kind = "emitter"' if "kind" not in data else ""
        raise DataError("kind", value=data.get("kind"), limit=f"must be one of {', '.join(KINDS)}", remedy=remedy)
    return kind(**data)


_LIBRARY: Library[Part] = Library(files("solen.parts") / "library", "part", _part, PART_SCHEMA, PART_MIGRATIONS)

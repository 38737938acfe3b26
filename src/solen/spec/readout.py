"""The readout: the receiver part and its circuit, the emitter current and the converter."""

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from solen.spec.strict import NotNegative, Number, Strict, Text, refused

_NAMED = "Name of {} in the library, or a part file (ends in .toml or contains a / or \\), relative to the design file"

Ohms = Annotated[Number, Field(ge=1e-3, le=1e9)]
Volts = Annotated[Number, Field(ge=-1e3, le=1e3)]
Supply = Annotated[Number, Field(gt=0, le=1e3)]


class Readout(Strict):
    """The circuit: each receiver is a phototransistor that pulls a load resistor down from the supply."""

    table: ClassVar[str] = "readout"

    part: Text = Field("TEMT7100X01", description=f"{_NAMED.format('a receiver')}: the part used for each receiver.")
    emitter_part: Text | None = Field(
        None,
        description=f"{_NAMED.format('an emitter')}: its power is used; default: emitter.part, or VSMY1850.",
    )
    emitter_current_ma: Annotated[Number, Field(gt=0, le=1e5)] = Field(
        2.0, description="Current of the emitter while it is on, in mA."
    )
    load_ohm: Ohms = Field(2000.0, description="Load resistor of each receiver in ohm.")
    supply_v: Supply = Field(5.0, description="Supply of the receivers in V.")
    trimmer: Text = Field("TC33X-2-202E", description=f"{_NAMED.format('a trimmer')}: the trimmer that sets the load.")
    adc: Text = Field("USB-6218", description=f"{_NAMED.format('a converter')}: the converter that reads the voltage.")
    adc_range_v: tuple[Volts, Volts] | None = Field(
        None,
        description="Input range of the converter, [low_V, high_V]; default: its smallest "
        "range that includes the supply.",
    )
    samples: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = Field(
        1, description="Samples averaged per reading."
    )
    rate_hz: Annotated[Number, Field(gt=0, le=1e6)] = Field(
        200.0, description="Readings of an emitter per second; the emitter is off for half of each period."
    )
    temperature_c: Annotated[Number, Field(ge=-55, le=150)] = Field(25.0, description="Temperature in °C.")
    ambient_mw_cm2: NotNegative = Field(
        0.0,
        description="Ambient light at the receivers in mW/cm², as equivalent light at the wavelength of "
        "their stated sensitivity.",
    )

    @model_validator(mode="after")
    def _range_is_one(self) -> Self:
        if self.adc_range_v is not None and not self.adc_range_v[0] < self.adc_range_v[1]:
            raise refused("adc_range_v", "must run from low to high", value=list(self.adc_range_v))
        return self

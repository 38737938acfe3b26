"""The readout table: the receivers and their circuit, the emitter current and the ADC."""

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from solen.spec.strict import NotNegative, Number, Strict, Text, refused

_PART = "Name of {} in the library, or a part file (ends in .toml or contains a / or \\), relative to the design file"

Ohms = Annotated[Number, Field(ge=1e-3, le=1e9)]
Volts = Annotated[Number, Field(ge=-1e3, le=1e3)]
Supply = Annotated[Number, Field(gt=0, le=1e3)]


class Readout(Strict):
    """The circuit: each receiver is a phototransistor with a load resistor to the supply, which it pulls down."""

    table: ClassVar[str] = "readout"

    part: Text = Field("TEMT7100X01", description=f"{_PART.format('a receiver')}; used for each receiver.")
    emitter_part: Text | None = Field(
        None,
        description=f"{_PART.format('an emitter')}; the emitter determines the emitted power. "
        "Default: emitter.part, or VSMY1850.",
    )
    emitter_current_ma: Annotated[Number, Field(gt=0, le=1e5)] = Field(
        2.0, description="Emitter current in mA while the emitter is on."
    )
    load_ohm: Ohms = Field(2000.0, description="Load resistor of each receiver in ohm.")
    supply_v: Supply = Field(5.0, description="Supply voltage of the receivers in V.")
    trimmer: Text = Field("TC33X-2-202E", description=f"{_PART.format('a trimmer')}; the trimmer sets the load.")
    adc: Text = Field("USB-6218", description=f"{_PART.format('an ADC')}; the ADC reads the voltage.")
    adc_range_v: tuple[Volts, Volts] | None = Field(
        None,
        description="Input range of the ADC, [low_V, high_V]; default: the smallest range that includes 0 V and "
        "the supply voltage.",
    )
    samples: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = Field(
        1, description="Number of samples averaged per reading."
    )
    rate_hz: Annotated[Number, Field(gt=0, le=1e6)] = Field(
        200.0, description="Readings per second with each emitter, which is off for half of each period."
    )
    temperature_c: Annotated[Number, Field(ge=-55, le=150)] = Field(25.0, description="Temperature in °C.")
    ambient_mw_cm2: NotNegative = Field(
        0.0,
        description="Ambient irradiance of the receivers in mW/cm², as the equivalent at the wavelength at which "
        "their sensitivity is specified.",
    )

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.adc_range_v is not None and not self.adc_range_v[0] < self.adc_range_v[1]:
            raise refused("adc_range_v", "must be in ascending order", value=list(self.adc_range_v))
        return self

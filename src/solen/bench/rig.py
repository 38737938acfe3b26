"""The rig: which instruments there are, and which sensor is wired to which emitter and inputs.

The idea: the protocol says what happens, the rig to what. A driver is named, real or simulated; the rest of a run does
not ask which. What only a simulated rig has, how prints differ and what light the room has, stands in tables of its
own, and is refused beside real instruments, where nature says it.

The interface: `Rig` with `StageOf`, `BoardOf`, `SensorOf`, `Spread`, `RoomLight`; `load_rig` of a file.
"""

from collections import Counter
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.bench.gcs2 import STAGES
from solen.errors import BenchError
from solen.files import read_text
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, migrated, parse_toml, refused, told_of

SCHEMA = 1
Input = Annotated[int, Field(strict=True, ge=1, le=64)]


class StageOf(Strict):
    """What moves."""

    table: ClassVar[str] = "stage"
    error: ClassVar[type[BenchError]] = BenchError

    driver: Literal["simulated", "gcs2"] = Field("simulated", description="simulated, or gcs2 for a controller of PI.")
    model: Text = Field("M-060.DG", description=f"Name of the stage: {', '.join(STAGES)}.")
    port: Text | None = Field(None, description="Line to the controller: COM3, /dev/ttyUSB0, socket://host:port.")
    baud: Annotated[int, Field(strict=True, ge=1200, le=10_000_000)] = Field(115_200, description="Baud rate.")
    axis: Text = Field("1", description="Name of the axis.")
    address: Annotated[int, Field(strict=True, ge=1, le=16)] | None = Field(
        None, description="Address of the controller where several share a line."
    )
    zero: Number = Field(0.0, description="Position at which the sensor is straight, in deg or mm.")
    lever_mm: Positive | None = Field(
        None, description="A linear stage pushes this far from the pivot; turns mm into degrees."
    )

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        if self.model not in STAGES:
            raise refused("model", f"must be one of {', '.join(STAGES)}", value=self.model)
        if (self.driver != "simulated") != (self.port is not None):
            raise refused("port", "is for a real stage, and a real stage needs it", value=self.port)
        if (STAGES[self.model].unit == "mm") != (self.lever_mm is not None):
            raise refused("lever_mm", "is for a linear stage, and a linear stage needs it", value=self.lever_mm)
        return self


class BoardOf(Strict):
    """What lights the emitters and samples the receivers."""

    table: ClassVar[str] = "board"
    error: ClassVar[type[BenchError]] = BenchError

    driver: Literal["simulated", "serial"] = Field("simulated", description="simulated, or serial for a real board.")
    port: Text | None = Field(None, description="Line to the board.")
    baud: Annotated[int, Field(strict=True, ge=1200, le=10_000_000)] = Field(1_000_000, description="Baud rate.")
    rate_hz: Annotated[Number, Field(ge=1, le=2000)] = Field(200.0, description="Periods per second.")
    bits: Annotated[int, Field(strict=True, ge=8, le=16)] = Field(16, description="Bits of the board's converter.")
    range_v: Positive = Field(5.0, description="Its range from 0, in V.")
    trim_v: Positive | None = Field(
        None,
        description="Trimmers of a simulated board are turned until a receiver's brightest reading stands at this "
        "voltage, as far as they go; default: readout.load_ohm of the designs as it is.",
    )
    noise_uv: NotNegative = Field(150.0, description="Noise of a simulated board's converter, in µV.")

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        if (self.driver != "simulated") != (self.port is not None):
            raise refused("port", "is for a real board, and a real board needs it", value=self.port)
        return self


class SensorOf(Strict):
    """One sensor and its wires; emitters and inputs count from 1."""

    table: ClassVar[str] = "sensor"
    error: ClassVar[type[BenchError]] = BenchError

    name: Annotated[Text, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=40)] = Field(
        description="what it is called: letters, digits, - _ ."
    )
    design: Text = Field(description="its design file, relative to the rig file.")
    lens: bool = Field(True, description="Whether it has its lens; false is the control without one.")
    emitter: Input = Field(description="which emitter of the board lights it.")
    right: Input = Field(description="which input of the board its right receiver is on.")
    left: Input = Field(description="which input of the board its left receiver is on.")


class Spread(Strict):
    """How simulated prints differ: standard deviations, drawn once for each sensor."""

    table: ClassVar[str] = "spread"
    error: ClassVar[type[BenchError]] = BenchError

    index: Annotated[Number, Field(ge=0, le=0.1)] = Field(0.0, description="Of the material's index.")
    emitter_offset_mm: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="Of the emitter's decentre, in mm."
    )
    chip_mm: Annotated[Number, Field(ge=0, le=0.5)] = Field(0.0, description="Of the chip's width, in mm.")
    parts: bool = Field(False, description="Whether receivers and emitters differ as their datasheets allow.")


class RoomLight(Strict):
    """Light of the room at simulated receivers."""

    table: ClassVar[str] = "ambient"
    error: ClassVar[type[BenchError]] = BenchError

    mean_mw_cm2: NotNegative = Field(
        0.0, description="Its mean in mW/cm², as light of the wavelength at which receivers are stated."
    )
    flicker_percent: Annotated[Number, Field(ge=0, le=100)] = Field(0.0, description="Amplitude of its flicker.")
    flicker_hz: Positive = Field(100.0, description="Of the flicker: twice the mains' frequency.")
    drift_percent_per_min: Annotated[Number, Field(ge=-100, le=100)] = Field(0.0, description="Drift of its mean.")


class Rig(Strict):
    """A stage, a board, and the sensors on them."""

    error: ClassVar[type[BenchError]] = BenchError

    name: Text = Field(description="what the rig is called.")
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)] = Field(0, description="Seed of everything drawn.")
    stage: StageOf = Field(default_factory=StageOf, description="What moves.")
    board: BoardOf = Field(default_factory=BoardOf, description="What lights and samples.")
    sensor: Annotated[tuple[SensorOf, ...], Field(min_length=1, max_length=32)] = Field(
        description="the sensors, [[sensor]]."
    )
    spread: Spread = Field(default_factory=Spread, description="How simulated prints differ.")
    ambient: RoomLight = Field(default_factory=RoomLight, description="Light at simulated receivers.")

    @model_validator(mode="after")
    def _wired_once(self) -> Self:
        for what, used in (
            ("name", [one.name for one in self.sensor]),
            ("input", [one for sensor in self.sensor for one in (sensor.right, sensor.left)]),
        ):
            twice = [value for value, times in Counter(used).items() if times > 1]
            if twice:
                raise refused("sensor", f"{what} {twice[0]} is used twice", remedy=f"give each its own {what}")
        if self.board.driver != "simulated":
            for key in ("spread", "ambient"):
                if key in self.model_fields_set:
                    raise refused(
                        key, "is for a simulated board: a real one shows what there is", remedy="leave it out"
                    )
        return self

    @property
    def emitters(self) -> int:
        """Emitters that take turns."""
        return max(sensor.emitter for sensor in self.sensor)

    @property
    def inputs(self) -> int:
        """Inputs that are sampled."""
        return max(max(sensor.right, sensor.left) for sensor in self.sensor)

    @property
    def simulated(self) -> bool:
        """Whether anything that is read from it is simulated."""
        return "simulated" in {self.stage.driver, self.board.driver}


def load_rig(path: Path) -> Rig:
    """Rig of a file; `BenchError` in one line where it cannot be read or is none."""
    data = parse_toml(read_text(path, BenchError), str(path), BenchError)
    data = migrated(data, str(path), current=SCHEMA, migrations={}, error=BenchError)
    with told_of(str(path)):
        return Rig(**data)

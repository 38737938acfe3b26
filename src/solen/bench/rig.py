"""The rig: which instruments there are, and which sensor is wired to which emitter and inputs.

The idea: the protocol says what happens, the rig to what. A driver is named, real or simulated; the rest of a run does
not ask which. What only a simulated rig has, how prints differ and what light the room has, stands in tables of its
own, and is refused beside real instruments, where nature says it.

The interface: `Rig` with its instruments (`solen.bench.rig_instruments`), `SensorOf`, `Spread`, `RoomLight`; `load_rig`
of a file.
"""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from solen.analysis.load_cell import LoadCell
from solen.arrays import FloatArray
from solen.bench.daq import Setup
from solen.bench.rig_instruments import BoardOf, DaqOf, MeterOf, StageOf
from solen.bench.tables import BenchTable, load_table
from solen.errors import BenchError
from solen.files import check_name
from solen.spec.strict import NotNegative, Number, Positive, Text, error_context, refused

Input = Annotated[int, Field(strict=True, ge=1, le=64)]


class SensorOf(BenchTable):
    """One sensor and its wires; emitters and inputs count from 1."""

    table: ClassVar[str] = "sensor"

    name: Annotated[Text, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=40)] = Field(
        description="what it is called: letters, digits, - _ ."
    )
    design: Text = Field(description="its design file, relative to the rig file.")
    lens: bool = Field(True, description="Whether it has its lens; false is the control without one.")
    emitter: Input = Field(description="which emitter of the board lights it.")
    right: Input = Field(description="which input of the board its right receiver is on.")
    left: Input = Field(description="which input of the board its left receiver is on.")

    @model_validator(mode="after")
    def _names_a_file(self) -> Self:
        check_name("name", self.name, BenchError)
        return self


class Spread(BenchTable):
    """How simulated prints differ: standard deviations, drawn once for each sensor."""

    table: ClassVar[str] = "spread"

    index: Annotated[Number, Field(ge=0, le=0.1)] = Field(0.0, description="Of the material's index.")
    emitter_offset_mm: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="Of the emitter's decentre, in mm."
    )
    chip_mm: Annotated[Number, Field(ge=0, le=0.5)] = Field(0.0, description="Of the chip's width, in mm.")
    parts: bool = Field(False, description="Whether receivers and emitters differ as their datasheets allow.")


class RoomLight(BenchTable):
    """Light of the room at simulated receivers."""

    table: ClassVar[str] = "ambient"

    mean_mw_cm2: NotNegative = Field(
        0.0, description="Its mean in mW/cm², as light of the wavelength at which receivers are stated."
    )
    flicker_percent: Annotated[Number, Field(ge=0, le=100)] = Field(0.0, description="Amplitude of its flicker.")
    flicker_hz: Positive = Field(100.0, description="Of the flicker: twice the mains' frequency.")
    drift_percent_per_min: Annotated[Number, Field(ge=-100, le=100)] = Field(0.0, description="Drift of its mean.")


class Rig(BenchTable):
    """A stage, a board or a data acquisition, and the sensors on them."""

    name: Text = Field(description="what the rig is called.")
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)] = Field(0, description="Seed of everything drawn.")
    stage: StageOf = Field(default_factory=StageOf, description="What moves.")
    board: BoardOf = Field(default_factory=BoardOf, description="What lights and samples.")
    daq: DaqOf | None = Field(None, description="What samples only, instead of a board.")
    meter: MeterOf | None = Field(None, description="What reads at its own pace, instead of a board.")
    sensor: Annotated[tuple[SensorOf, ...], Field(min_length=1, max_length=32)] = Field(
        description="the sensors, [[sensor]]."
    )
    load_cell: LoadCell | None = Field(None, description="What reads the force on the sensor.")
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
        samples = self.sampler is self.board and self.board.driver == "serial"
        if self.stage.driver == "board" and self.stage.port is None and not samples:
            raise refused("stage.driver", 'needs a port, or [board] with driver = "serial"', value="board")
        if samples and self.stage.port == self.board.port:
            remedy = "leave it out, and the board that samples drives its motor"
            raise refused("stage.port", "is the port of [board]", value=self.stage.port, remedy=remedy)
        if self.load_cell is not None:
            self._check_cell(self.load_cell)
        stated = [key for key in ("board", "daq", "meter") if key in self.model_fields_set and getattr(self, key)]
        if len(stated) > 1:
            raise refused(stated[-1], f"cannot be combined with [{stated[0]}]", remedy="keep the one in the rig")
        if self.meter is not None:
            self.meter.check_inputs(self.emitters, self.inputs)
        if self.sampler.driver != "simulated":
            for key in ("spread", "ambient"):
                if key in self.model_fields_set:
                    raise refused(key, "is for a simulated rig: a real one shows what there is", remedy="leave it out")
        return self

    def _check_cell(self, cell: LoadCell) -> None:
        """Refuse a load cell without an input of its own, or whose force is on several sensors."""
        wired = [one for sensor in self.sensor for one in (sensor.right, sensor.left)]
        if cell.input is None:
            raise refused("load_cell.input", "missing: the input that it is on", remedy=f"add input = {max(wired) + 1}")
        if cell.input in wired:
            raise refused("load_cell.input", "is a receiver's", value=cell.input, remedy="give it one of its own")
        if self.unit != "V":
            limit = f"needs a rig that measures volts; this one measures {self.unit}"
            raise refused("load_cell", limit, remedy="leave it out")
        if len(self.sensor) > 1:
            limit = f"reads the force on one sensor; there are {len(self.sensor)}"
            raise refused("load_cell", limit, remedy="state one [[sensor]]")

    @property
    def sampler(self) -> BoardOf | DaqOf | MeterOf:
        """Sampler of the receivers."""
        return self.meter or self.daq or self.board

    @property
    def unit(self) -> str:
        """Unit of its receivers; a data acquisition measures volts."""
        return "V" if self.daq is not None else (self.meter or self.board).unit

    @property
    def setup(self) -> Setup | None:
        """Settings of the data acquisition; None for a rig with a board."""
        return None if self.daq is None else self.daq.setup(self.emitters, self.inputs)

    @property
    def emitters(self) -> int:
        """Emitters that take turns."""
        return max(sensor.emitter for sensor in self.sensor)

    @property
    def inputs(self) -> int:
        """Inputs that are sampled."""
        cell = 0 if self.load_cell is None else self.load_cell.input or 0
        return max(cell, *(max(sensor.right, sensor.left) for sensor in self.sensor))

    @property
    def simulated(self) -> bool:
        """Whether anything that is read from it is simulated."""
        return "simulated" in {self.stage.driver, self.sampler.driver}


def driven_values(position: FloatArray, header: Mapping[str, Any]) -> FloatArray:
    """Angles in degrees, or depths in mm, of a sensor at positions of the stage, by the header of a run."""
    if header.get("drives") == "depth":
        return np.asarray(position - header["zero"])
    return sensor_angle_deg(position, header["zero"], header["lever_mm"])


def sensor_angle_deg(position: FloatArray, zero: float, lever_mm: float | None) -> FloatArray:
    """Angles of a sensor at positions of the stage: degrees as they are, or mm at the end of a lever."""
    moved = np.asarray(position - zero)
    return moved if lever_mm is None else np.degrees(np.arctan(moved / lever_mm))


def load_rig(path: Path) -> Rig:
    """Rig of a file; `BenchError` if it cannot be read or is invalid."""
    rig = load_table(path, Rig)
    with error_context(str(path)):
        _ = rig.setup  # what the instrument cannot do is refused here
    return rig

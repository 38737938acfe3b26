"""The rig: which instruments there are, and which sensor is wired to which emitter and inputs.

The idea: the protocol says what happens, the rig to what. A driver is named, real or simulated; the rest of a run does
not ask which. What only a simulated rig has, how prints differ and what light the room has, stands in tables of its
own, and is refused beside real instruments, where nature says it.

The interface: `Rig` with `StageOf`, `BoardOf` or `DaqOf`, `SensorOf`, `Spread`, `RoomLight`; `load_rig` of a file.
"""

from collections import Counter
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from solen.arrays import FloatArray
from solen.bench.daq import MODELS, Setup
from solen.bench.drivers import DRIVERS, KINDS
from solen.bench.gcs2 import STAGES, unit_of
from solen.bench.tables import BenchTable, load_table
from solen.errors import BenchError
from solen.files import check_name
from solen.spec.strict import NotNegative, Number, Positive, Text, error_context, refused

Input = Annotated[int, Field(strict=True, ge=1, le=64)]


def _check_driver(table: "StageOf | BoardOf | DaqOf", key: str) -> None:
    """Refuse a driver that this role does not have, and a ``key`` that says where a real instrument is found."""
    known = [name for name, driver in DRIVERS.items() if driver.role == table.table]
    if table.driver != "simulated" and table.driver not in known:
        raise refused("driver", f"must be one of simulated, {', '.join(known)}", value=table.driver)
    stated = getattr(table, key) is not None
    if stated if table.driver == "simulated" else not stated and DRIVERS[table.driver].needs == key:
        what = "instrument" if table.table == "daq" else table.table
        raise refused(key, f"is for a real {what}, and a real {what} needs it", value=getattr(table, key))


class StageOf(BenchTable):
    """What moves."""

    table: ClassVar[str] = "stage"

    driver: Text = Field(
        "simulated",
        description="simulated, gcs2 for a controller of PI, kinesis for one of Thorlabs, grbl or marlin for a "
        "stepper, zaber, hand for no motor, board for the motor of a board, or that of another package.",
    )
    model: Text = Field("M-060.DG", description=f"Name of the stage: {', '.join(STAGES)}.")
    unit: Literal["deg", "mm"] | None = Field(
        None, description="What it moves in; needed for a model that is not among these."
    )
    port: Text | None = Field(None, description="Line to the controller: COM3, /dev/ttyUSB0, socket://host:port.")
    baud: Annotated[int, Field(strict=True, ge=1200, le=10_000_000)] = Field(115_200, description="Baud rate.")
    axis: Text = Field("1", description="Name of the axis.")
    address: Annotated[int, Field(strict=True, ge=1, le=16)] | None = Field(
        None, description="Address of the controller where several share a line."
    )
    steps_per_unit: Positive | None = Field(
        None,
        description="Steps per deg or mm: of a board's motor, microsteps or counts of a stage of Zaber or Thorlabs.",
    )
    zero: Number = Field(0.0, description="Position at which the sensor is straight, in deg or mm.")
    home: Literal["here"] | bool = Field(
        False,
        description='Whether it may drive to its reference switch unasked; "here": it stands at zero now, and nothing '
        "moves.",
    )
    travel: tuple[Number, Number] | None = Field(
        None, description="Lowest and highest position that anything may send it to, in deg or mm."
    )
    lever_mm: Positive | None = Field(
        None, description="A linear stage pushes this far from the pivot; turns mm into degrees."
    )

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        _check_driver(self, "port")
        if self.travel is not None and not self.travel[0] <= self.zero <= self.travel[1]:
            raise refused("travel", f"must be from below zero = {self.zero:g} to above it", value=self.travel)
        takes = ("model",) if self.driver == "simulated" else DRIVERS[self.driver].takes
        if takes is None:
            return self
        for key in KINDS:
            if key in self.model_fields_set and key not in takes and getattr(self, key) is not None:
                limit = f"means nothing to the driver {self.driver}"
                raise refused(key, limit, value=getattr(self, key), remedy="leave it out")
        if "steps_per_unit" in takes and self.steps_per_unit is None:
            raise refused("steps_per_unit", f"is needed by the driver {self.driver}")
        try:
            unit = unit_of(self.model, self.unit) if "model" in takes else self.unit
        except BenchError as bad:
            raise refused("model" if bad.what == "stage" else bad.what, bad.limit, value=bad.value) from None
        if unit is not None and (unit == "mm") != (self.lever_mm is not None):
            raise refused("lever_mm", "is for a linear stage, and a linear stage needs it", value=self.lever_mm)
        return self

    @property
    def steps(self) -> float:
        """Steps per unit of a driver that needs them."""
        return self.steps_per_unit or 1.0

    @property
    def moves_in(self) -> Literal["deg", "mm"]:
        """Unit of its positions: as stated, or mm at the end of a lever."""
        return self.unit or ("deg" if self.lever_mm is None else "mm")


class BoardOf(BenchTable):
    """What lights the emitters and samples the receivers."""

    table: ClassVar[str] = "board"

    driver: Text = Field("simulated", description="simulated, serial for a real board, or that of another package.")
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
        _check_driver(self, "port")
        return self


_ASKED = {
    "rate_hz",
    "switch_hz",
    "switching",
    "range_v",
    "terminal",
    "enable",
    "alive",
    "settle_us",
    "buffer_s",
}
"""Keys of a data acquisition that are passed on to its `Setup`."""


class DaqOf(BenchTable):
    """What samples the receivers as they are; something outside switches the emitters, or its counters do."""

    table: ClassVar[str] = "daq"

    driver: Text = Field(
        "simulated",
        description="simulated, nidaqmx for an instrument of National Instruments, or that of another package.",
    )
    device: Text | None = Field(None, description="Name of a real one, as NI-DAQmx calls it: Dev1.")
    model: Text | None = Field(
        None, description=f"What it must be; default: whatever it says it is. Simulated: {', '.join(MODELS)}."
    )
    rate_hz: Annotated[Number, Field(ge=100, le=2_000_000)] = Field(
        10_000.0, description="Samples of each input per second."
    )
    range_v: Positive = Field(10.0, description="Its range, ± V: one that goes beyond the circuit's supply.")
    terminal: Literal["rse", "nrse", "differential"] = Field("rse", description="How inputs are wired.")
    channels: Annotated[tuple[Text, ...], Field(min_length=1, max_length=64)] | None = Field(
        None, description="Its analog inputs for the rig's inputs 1, 2, …; default: ai0, ai1, …"
    )
    switching: Literal["external", "counter"] = Field(
        "external", description="What switches the emitters: something outside, or the instrument's counters."
    )
    switch_hz: Annotated[Number, Field(ge=1, le=2000)] = Field(
        200.0, description="Times per second that each emitter is lit."
    )
    sync: Text | None = Field(None, description="Analog input that is high while emitter 1 is on.")
    enable: Text | None = Field(None, description="Static output that is high while samples are taken: port1/line7.")
    alive: Text | None = Field(
        None, description="Static output that changes its level with each reading, for a watchdog outside."
    )
    settle_us: NotNegative = Field(300.0, description="Left out after each switch, in µs.")
    buffer_s: Annotated[Number, Field(ge=1, le=60)] = Field(10.0, description="What the computer holds, in s.")
    trim_v: Positive | None = Field(None, description="As of a simulated board.")
    noise_uv: NotNegative | None = Field(
        None, description="Noise of a simulated one's converter, in µV; default: of its range by the part."
    )

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        if self.driver == "simulated" and self.kind not in MODELS:
            raise refused("model", f"must be one of {', '.join(MODELS)}", value=self.model)
        _check_driver(self, "device")
        if self.switching == "counter" and self.sync is not None:
            raise refused("sync", "has no use beside counters, which run by the clock of the samples", value=self.sync)
        return self

    @property
    def kind(self) -> str:
        """Its model; empty for a real one that is asked."""
        return self.model or ("USB-6218" if self.driver == "simulated" else "")

    def setup(self, emitters: int, inputs: int) -> Setup:
        """What it is asked to do for so many emitters and inputs; `BenchError` where it is known that it cannot."""
        pool = MODELS[self.kind].inputs[self.terminal] if self.kind in MODELS else None
        channels = self.channels or (pool or tuple(f"ai{number}" for number in range(inputs)))[:inputs]
        if len(channels) != inputs:
            limit = f"names {len(channels)} inputs; the sensors are on {inputs}"
            raise BenchError("daq.channels", limit=limit, remedy="name one for each, in their order")
        return Setup(
            channels=channels if self.sync is None else (*channels, self.sync),
            synced=self.sync is not None,
            emitters=emitters,
            model=self.kind,
            **self.model_dump(include=_ASKED),
        )


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
        if self.stage.driver == "board" and (self.daq is not None or self.board.driver != "serial"):
            raise refused("stage.driver", 'needs [board] with driver = "serial"', value="board")
        if self.daq is not None and "board" in self.model_fields_set:
            raise refused("daq", "stands beside [board]", remedy="keep the one that the rig has")
        if self.sampler.driver != "simulated":
            for key in ("spread", "ambient"):
                if key in self.model_fields_set:
                    raise refused(key, "is for a simulated rig: a real one shows what there is", remedy="leave it out")
        return self

    @property
    def sampler(self) -> BoardOf | DaqOf:
        """What samples the receivers."""
        return self.daq or self.board

    @property
    def setup(self) -> Setup | None:
        """What a data acquisition is asked to do; None of a rig with a board."""
        return None if self.daq is None else self.daq.setup(self.emitters, self.inputs)

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
        return "simulated" in {self.stage.driver, self.sampler.driver}


def sensor_angle_deg(position: FloatArray, zero: float, lever_mm: float | None) -> FloatArray:
    """Angles of a sensor at positions of the stage: degrees as they are, or mm at the end of a lever."""
    moved = np.asarray(position - zero)
    return moved if lever_mm is None else np.degrees(np.arctan(moved / lever_mm))


def load_rig(path: Path) -> Rig:
    """Rig of a file; `BenchError` in one line where it cannot be read or is none."""
    rig = load_table(path, Rig)
    with error_context(str(path)):
        _ = rig.setup  # what the instrument cannot do is refused here
    return rig

"""The rig: the instruments, and the wiring of each sensor to an emitter and inputs.

The protocol specifies the motion, and the rig what is moved. Each instrument has a driver, real or simulated; the rest
of a run does not depend on it. Quantities that only a simulated rig has, the variation of the prints and the ambient
light, are in separate tables, which are rejected for real instruments.

Public names: `Rig`, `SensorTable`, `Spread`, `AmbientLight` and `load_rig`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from solen.analysis.load_cell import LoadCell
from solen.arrays import FloatArray
from solen.bench.daq import Setup
from solen.bench.rig_instruments import BoardTable, DaqTable, MeterTable, StageTable
from solen.bench.tables import BenchTable, load_table
from solen.errors import BenchError
from solen.files import check_name
from solen.spec import load
from solen.spec.strict import NotNegative, Number, Positive, Text, error_context, refused, repeated

Input = Annotated[int, Field(strict=True, ge=1, le=64)]


class SensorTable(BenchTable):
    """One sensor and its wiring; emitters and inputs are counted from 1."""

    table: ClassVar[str] = "sensor"

    name: Annotated[Text, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=40)] = Field(
        description="name of the sensor: letters, digits, - _ ."
    )
    design: Text = Field(description="design file of the sensor, relative to the rig file.")
    lens: bool = Field(
        True, description="Whether the sensor has its lens; false for the control sensor without a lens."
    )
    emitter: Input | None = Field(None, description="Number of the board's emitter that illuminates it.")
    right: Input | None = Field(None, description="Number of the board's input for its right receiver.")
    left: Input | None = Field(None, description="Number of the board's input for its left receiver.")
    emitters: Annotated[dict[str, Input], Field(min_length=1)] | None = Field(
        None, description="For a network: the board's emitter for each of its emitters, {wrist = 1, index = 2}."
    )
    inputs: Annotated[dict[str, Input], Field(min_length=1)] | None = Field(
        None, description="For a network: the board's input for each of its receivers, {thumb = 1, middle = 2}."
    )

    @model_validator(mode="after")
    def _check_wiring(self) -> Self:
        check_name("name", self.name, BenchError)
        pair = {key: getattr(self, key) for key in ("emitter", "right", "left")}
        network = {key: getattr(self, key) for key in ("emitters", "inputs")}
        required, excluded = (network, pair) if any(network.values()) else (pair, network)
        for key, value in required.items():
            if value is None:
                raise refused(
                    key, "is missing", remedy="set emitter, right and left, or for a network emitters and inputs"
                )
        for key, value in excluded.items():
            if value is not None:
                raise refused(key, "cannot be combined with emitters and inputs", value=value, remedy="omit it")
        for key, numbers in network.items():
            twice = repeated((numbers or {}).values())
            if twice is not None:
                limit = f"must contain different numbers, but {twice} occurs twice"
                raise refused(key, limit, remedy=f"use a different number for each of the {key}")
        if self.is_network and not self.lens:
            raise refused("lens", "is for a sensor with one lens", value=False, remedy="omit it")
        return self

    @property
    def is_network(self) -> bool:
        """Whether the sensor is a network, whose emitters have names."""
        return self.emitters is not None

    @property
    def emitter_numbers(self) -> dict[str, int]:
        """Numbers of the board's emitters, keyed by their names in the design; a single emitter has no name."""
        return self.emitters or {"": self.emitter or 1}

    @property
    def input_numbers(self) -> dict[str, int]:
        """Numbers of the board's inputs, keyed by the names of the receivers."""
        return self.inputs or {"right": self.right or 1, "left": self.left or 1}


class Spread(BenchTable):
    """Variation of simulated prints, sampled at random once for each sensor."""

    table: ClassVar[str] = "spread"

    index: Annotated[Number, Field(ge=0, le=0.1)] = Field(
        0.0, description="Standard deviation of the material's refractive index."
    )
    emitter_offset_mm: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="Standard deviation of the emitter's decentre, in mm."
    )
    chip_mm: Annotated[Number, Field(ge=0, le=0.5)] = Field(
        0.0, description="Standard deviation of the chip's width, in mm."
    )
    parts: bool = Field(
        False, description="Whether receivers and emitters vary within the tolerances in their datasheets."
    )


class AmbientLight(BenchTable):
    """Ambient light at simulated receivers."""

    table: ClassVar[str] = "ambient"

    mean_mw_cm2: NotNegative = Field(
        0.0, description="Mean irradiance in mW/cm², as light of the wavelength at which receivers are specified."
    )
    flicker_percent: Annotated[Number, Field(ge=0, le=100)] = Field(
        0.0, description="Amplitude of the flicker, in % of the mean."
    )
    flicker_hz: Positive = Field(100.0, description="Frequency of the flicker in Hz: twice the mains frequency.")
    drift_percent_per_min: Annotated[Number, Field(ge=-100, le=100)] = Field(
        0.0, description="Drift of the mean, in % per minute."
    )


class Rig(BenchTable):
    """A stage, a board, a DAQ device or a meter, and the sensors connected to them."""

    name: Text = Field(description="name of the rig.")
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)] = Field(0, description="Seed of all random numbers.")
    stage: StageTable = Field(default_factory=StageTable, description="The stage, which moves the sensors.")
    stages: dict[str, StageTable] = Field(
        default_factory=dict, description="For a network: a stage for each motion, [stages.MOTION]."
    )
    board: BoardTable = Field(
        default_factory=BoardTable, description="Instrument that switches the emitters and samples the receivers."
    )
    daq: DaqTable | None = Field(None, description="Instrument that only samples, instead of a board.")
    meter: MeterTable | None = Field(None, description="Instrument that reads at its own pace, instead of a board.")
    sensor: Annotated[tuple[SensorTable, ...], Field(min_length=1, max_length=32)] = Field(
        description="the sensors, [[sensor]]."
    )
    load_cell: LoadCell | None = Field(None, description="Instrument that reads the force on the sensor.")
    spread: Spread = Field(default_factory=Spread, description="Variation of simulated prints.")
    ambient: AmbientLight = Field(default_factory=AmbientLight, description="Ambient light at simulated receivers.")

    @model_validator(mode="after")
    def _check_tables(self) -> Self:
        for what, used in (
            ("name", [sensor.name for sensor in self.sensor]),
            ("input", [number for sensor in self.sensor for number in sensor.input_numbers.values()]),
        ):
            twice = repeated(used)
            if twice is not None:
                raise refused("sensor", f"{what} {twice} is used twice", remedy=f"use a different {what} for each")
        self._check_motions()
        self._check_board_motor()
        if self.load_cell is not None:
            self._check_cell(self.load_cell)
        samplers = [key for key in ("board", "daq", "meter") if key in self.model_fields_set and getattr(self, key)]
        if len(samplers) > 1:
            raise refused(samplers[-1], f"cannot be combined with [{samplers[0]}]", remedy="omit one of them")
        if self.meter is not None:
            self.meter.check_inputs(self.emitters, self.inputs)
        if self.sampler.driver != "simulated":
            for key in ("spread", "ambient"):
                if key in self.model_fields_set:
                    raise refused(key, "is for a simulated rig only", remedy="omit it")
        return self

    def _check_board_motor(self) -> None:
        """Reject stages whose board is not specified, or is specified twice."""
        samples = self.sampler is self.board and self.board.driver == "serial"
        for motion, stage in self.axes.items():
            key = f"stages.{motion}" if motion else "stage"
            if stage.driver == "board" and stage.port is None and not samples:
                remedy = 'set port, or [board] with driver = "serial"'
                raise refused(f"{key}.driver", "requires a board", value="board", remedy=remedy)
            if samples and stage.port == self.board.port:
                remedy = f"omit {key}.port: the motor of the sampling board is then used"
                raise refused(f"{key}.port", "is also the port of [board]", value=stage.port, remedy=remedy)

    def _check_motions(self) -> None:
        """Reject [stages] without a network, a network without [stages], and keys that [stages] excludes."""
        networks = [sensor.name for sensor in self.sensor if sensor.is_network]
        if networks and not self.stages:
            limit = f"are missing: each motion of {networks[0]} requires a stage"
            raise refused("stages", limit, remedy="add [stages.MOTION] for each motion")
        if not self.stages:
            return
        if len(networks) < len(self.sensor):
            limit = "are for networks; a sensor with emitter, right and left has one motion"
            raise refused("stages", limit, remedy="use [stage], or specify emitters and inputs of each sensor")
        if "stage" in self.model_fields_set:
            raise refused("stage", "cannot be combined with [stages.MOTION]", remedy="omit it")
        if self.load_cell is not None:
            raise refused("load_cell", "cannot be combined with [stages.MOTION]", remedy="omit it")
        for motion, stage in self.stages.items():
            if stage.drives != "angle":
                limit = 'must be "angle" for a motion of a network'
                raise refused(f"stages.{motion}.drives", limit, value=stage.drives, remedy="omit it")
        if len({stage.motion_unit for stage in self.stages.values()}) > 1:
            raise refused("stages", "must all move in deg, or all in mm")
        lines = (stage.port or stage.driver for stage in self.stages.values())
        twice = repeated(line for line in lines if line not in {"simulated", "hand"})
        if twice is not None:
            limit = "is used for two motions; each motion requires a stage on its own line"
            raise refused("stages", limit, value=twice, remedy="connect each stage to its own port")
        if len({stage.driver == "simulated" for stage in self.stages.values()}) > 1:
            raise refused("stages", "must all be simulated, or all real")

    def _check_cell(self, cell: LoadCell) -> None:
        """Reject a load cell without its own input, in a rig that does not measure volts, or with several sensors."""
        wired = [number for sensor in self.sensor for number in sensor.input_numbers.values()]
        if cell.input is None:
            raise refused("load_cell.input", "is missing", remedy=f"add input = {max(wired) + 1}")
        if cell.input in wired:
            limit = "is the input of a receiver"
            raise refused("load_cell.input", limit, value=cell.input, remedy="use another input")
        if self.unit != "V":
            limit = f"requires a rig that measures volts; this one measures {self.unit}"
            raise refused("load_cell", limit, remedy="omit it")
        if len(self.sensor) > 1:
            limit = f"requires a rig with one sensor; this one has {len(self.sensor)}"
            raise refused("load_cell", limit, remedy="keep one [[sensor]]")

    @property
    def sampler(self) -> BoardTable | DaqTable | MeterTable:
        """Instrument that samples the receivers."""
        return self.meter or self.daq or self.board

    @property
    def unit(self) -> str:
        """Unit of the receiver signals."""
        return "V" if self.daq is not None else (self.meter or self.board).unit

    @property
    def setup(self) -> Setup | None:
        """Settings of the DAQ device; None for a rig without one."""
        return None if self.daq is None else self.daq.setup(self.emitters, self.inputs)

    @property
    def emitters(self) -> int:
        """Number of alternating emitters."""
        return max(number for sensor in self.sensor for number in sensor.emitter_numbers.values())

    @property
    def inputs(self) -> int:
        """Number of sampled inputs."""
        cell = 0 if self.load_cell is None else self.load_cell.input or 0
        return max(cell, *(number for sensor in self.sensor for number in sensor.input_numbers.values()))

    @property
    def simulated(self) -> bool:
        """Whether any of its data are simulated."""
        return "simulated" in {self.sampler.driver, *(axis.driver for axis in self.axes.values())}

    @property
    def axes(self) -> dict[str, StageTable]:
        """Stages, keyed by motion; the single stage of a rig without a network has no name."""
        return self.stages or {"": self.stage}

    @property
    def motion_unit(self) -> str:
        """Unit of the stages."""
        return next(iter(self.axes.values())).motion_unit

    def with_single_stage(self, stage: StageTable) -> "Rig":
        """Return the rig with one of its stages as the only one, for a driver that opens it."""
        return self.model_copy(update={"stage": stage, "stages": {}})


def check_names(rig: Rig, folder: Path) -> None:
    """Raise `BenchError` if a network lacks an emitter, a receiver or a motion that the rig names.

    Sensors that are not networks are not checked.
    """
    for number, sensor in enumerate(rig.sensor):
        if not sensor.is_network:
            continue
        design = load(folder / sensor.design)
        if design.body.kind != "network":
            limit = f"is a {design.body.kind}; the keys emitters and inputs are for a network"
            raise BenchError(sensor.design, limit=limit, remedy="use emitter, right and left")
        network = design.network
        for key, kind, names, parts in (
            (f"sensor[{number}].emitters", "emitter", sensor.emitter_numbers, network.emitters),
            (f"sensor[{number}].inputs", "receiver", sensor.input_numbers, network.receivers),
            ("stages", "motion", rig.stages, network.motion),
        ):
            known = [part.name for part in parts]
            for name in names:
                if name not in known:
                    limit = f"is not a {kind} of {sensor.design}, which has {', '.join(known) or 'none'}"
                    raise BenchError(key, value=name, limit=limit)


def driven_values(position: FloatArray, settings: Mapping[str, Any]) -> FloatArray:
    """Convert positions of a stage, with its settings, to the angles of a sensor in degrees or to depths in mm."""
    if settings.get("drives") == "depth":
        return np.asarray(position - settings["zero"])
    return sensor_angle_deg(position, settings["zero"], settings["lever_mm"])


def sensor_angle_deg(position: FloatArray, zero: float, lever_mm: float | None) -> FloatArray:
    """Return the angles of a sensor at positions of a stage in degrees, or in mm at the end of a lever."""
    shift = np.asarray(position - zero)
    return shift if lever_mm is None else np.degrees(np.arctan(shift / lever_mm))


def load_rig(path: Path) -> Rig:
    """Read a rig from a file; raise `BenchError` if it cannot be read or is invalid."""
    rig = load_table(path, Rig)
    with error_context(str(path)):
        _ = rig.setup  # raises an error if the device does not support the settings
    return rig

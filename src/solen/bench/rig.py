"""The rig: the instruments, and the wiring of each sensor to an emitter and inputs.

The protocol states the motion, the rig what is moved. A driver is named, real or simulated; the rest of a run does not
depend on which. Quantities that only a simulated rig has, the variation of the prints and the ambient light, are in
separate tables, which are rejected for real instruments.

Public names: `Rig`, `SensorOf`, `Spread`, `RoomLight` and `load_rig`.
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
from solen.spec import load
from solen.spec.strict import NotNegative, Number, Positive, Text, error_context, refused

Input = Annotated[int, Field(strict=True, ge=1, le=64)]


class SensorOf(BenchTable):
    """One sensor and its wiring; emitters and inputs are counted from 1."""

    table: ClassVar[str] = "sensor"

    name: Annotated[Text, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=40)] = Field(
        description="name of the sensor: letters, digits, - _ ."
    )
    design: Text = Field(description="its design file, relative to the rig file.")
    lens: bool = Field(
        True, description="Whether the sensor has its lens; false for the control sensor without a lens."
    )
    emitter: Input | None = Field(None, description="number of the board's emitter that illuminates it.")
    right: Input | None = Field(None, description="number of the board's input for its right receiver.")
    left: Input | None = Field(None, description="number of the board's input for its left receiver.")
    emitters: Annotated[dict[str, Input], Field(min_length=1)] | None = Field(
        None, description="For a network: number of the board's emitter for each of its own, {wrist = 1, index = 2}."
    )
    inputs: Annotated[dict[str, Input], Field(min_length=1)] | None = Field(
        None,
        description="For a network: number of the board's input for each of its receivers, {thumb = 1, middle = 2}.",
    )

    @model_validator(mode="after")
    def _is_wired(self) -> Self:
        check_name("name", self.name, BenchError)
        pair = {key: getattr(self, key) for key in ("emitter", "right", "left")}
        network = {key: getattr(self, key) for key in ("emitters", "inputs")}
        stated, beside = (network, pair) if any(network.values()) else (pair, network)
        for key, value in stated.items():
            if value is None:
                raise refused(key, "missing", remedy="for a network state emitters and inputs")
        for key, value in beside.items():
            if value is not None:
                raise refused(key, "does not apply with emitters and inputs", value=value, remedy="omit it")
        for key, wires in network.items():
            twice = [number for number, times in Counter((wires or {}).values()).items() if times > 1]
            if twice:
                raise refused(key, f"has {twice[0]} twice", remedy="use a different one for each")
        if self.is_network and not self.lens:
            raise refused("lens", "is for a sensor with one lens", value=False, remedy="omit it")
        return self

    @property
    def is_network(self) -> bool:
        """Whether it has several emitters, by name."""
        return self.emitters is not None

    @property
    def lit_by(self) -> dict[str, int]:
        """Numbers of the board's emitters by the sensor's own names; a single emitter has no name."""
        return self.emitters or {"": self.emitter or 1}

    @property
    def read_on(self) -> dict[str, int]:
        """Inputs of the board by the names of the receivers."""
        return self.inputs or {"right": self.right or 1, "left": self.left or 1}


class Spread(BenchTable):
    """Variation of simulated prints: standard deviations, drawn once for each sensor."""

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
        False, description="Whether receivers and emitters vary within the tolerances of their datasheets."
    )


class RoomLight(BenchTable):
    """Ambient light at simulated receivers."""

    table: ClassVar[str] = "ambient"

    mean_mw_cm2: NotNegative = Field(
        0.0, description="Mean in mW/cm², as light of the wavelength at which receivers are specified."
    )
    flicker_percent: Annotated[Number, Field(ge=0, le=100)] = Field(0.0, description="Amplitude of its flicker.")
    flicker_hz: Positive = Field(100.0, description="Frequency of the flicker: twice the mains frequency.")
    drift_percent_per_min: Annotated[Number, Field(ge=-100, le=100)] = Field(0.0, description="Drift of its mean.")


class Rig(BenchTable):
    """A stage, a board or a data acquisition, and the sensors on them."""

    name: Text = Field(description="name of the rig.")
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)] = Field(0, description="Seed of all random draws.")
    stage: StageOf = Field(default_factory=StageOf, description="What moves.")
    stages: dict[str, StageOf] = Field(
        default_factory=dict, description="Stages of the motions of a network, [stages.NAME] for each by its name."
    )
    board: BoardOf = Field(
        default_factory=BoardOf, description="Instrument that switches the emitters and samples the receivers."
    )
    daq: DaqOf | None = Field(None, description="Instrument that only samples, instead of a board.")
    meter: MeterOf | None = Field(None, description="Instrument that reads at its own pace, instead of a board.")
    sensor: Annotated[tuple[SensorOf, ...], Field(min_length=1, max_length=32)] = Field(
        description="the sensors, [[sensor]]."
    )
    load_cell: LoadCell | None = Field(None, description="Instrument that reads the force on the sensor.")
    spread: Spread = Field(default_factory=Spread, description="Variation of simulated prints.")
    ambient: RoomLight = Field(default_factory=RoomLight, description="Ambient light at simulated receivers.")

    @model_validator(mode="after")
    def _wired_once(self) -> Self:
        for what, used in (
            ("name", [sensor.name for sensor in self.sensor]),
            ("input", [one for sensor in self.sensor for one in sensor.read_on.values()]),
        ):
            twice = [value for value, times in Counter(used).items() if times > 1]
            if twice:
                raise refused("sensor", f"{what} {twice[0]} is used twice", remedy=f"use a different {what} for each")
        self._check_motions()
        samples = self.sampler is self.board and self.board.driver == "serial"
        for motion, stage in self.axes.items():
            key = f"stages.{motion}" if motion else "stage"
            if stage.driver == "board" and stage.port is None and not samples:
                raise refused(f"{key}.driver", 'needs a port, or [board] with driver = "serial"', value="board")
            if samples and stage.port == self.board.port:
                remedy = "omit it; the board that samples then drives its motor"
                raise refused(f"{key}.port", "is also the port of [board]", value=stage.port, remedy=remedy)
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
                    raise refused(key, "is for a simulated rig: a real one has its own", remedy="omit it")
        return self

    def _check_motions(self) -> None:
        """Raise an error for stages by motion without a network, and for a network without them.

        Keys that several stages do not support are also rejected.
        """
        networks = [sensor.name for sensor in self.sensor if sensor.is_network]
        if networks and not self.stages:
            limit = f"missing: the motions of {networks[0]} need stages of their own"
            raise refused("stages", limit, remedy="state [stages.NAME] for each motion")
        if not self.stages:
            return
        if len(networks) < len(self.sensor):
            limit = "are for networks; a sensor with emitter, right and left has one motion"
            raise refused("stages", limit, remedy="state [stage], or emitters and inputs of each sensor")
        if "stage" in self.model_fields_set:
            raise refused("stage", "cannot be combined with [stages.NAME]", remedy="omit it")
        if self.load_cell is not None:
            raise refused("load_cell", "does not apply with [stages.NAME]", remedy="omit it")
        for name, stage in self.stages.items():
            if stage.drives != "angle":
                limit = "a motion of a network is an angle"
                raise refused(f"stages.{name}.drives", limit, value=stage.drives, remedy="omit it")
        if len({stage.moves_in for stage in self.stages.values()}) > 1:
            raise refused("stages", "move in deg and in mm", remedy="use stages of one kind")
        ports = Counter(
            stage.port or stage.driver for stage in self.stages.values() if stage.driver not in {"simulated", "hand"}
        )
        if ports and (most := ports.most_common(1)[0])[1] > 1:
            limit = "makes two motions; each motion needs a stage with its own line"
            raise refused("stages", limit, value=most[0], remedy="connect them apart")
        if len({stage.driver == "simulated" for stage in self.stages.values()}) > 1:
            raise refused("stages", "are partly simulated", remedy="use stages of one kind")

    def _check_cell(self, cell: LoadCell) -> None:
        """Raise an error for a load cell without its own input, or whose force is on several sensors."""
        wired = [one for sensor in self.sensor for one in sensor.read_on.values()]
        if cell.input is None:
            raise refused(
                "load_cell.input", "missing: the input of the load cell", remedy=f"add input = {max(wired) + 1}"
            )
        if cell.input in wired:
            raise refused("load_cell.input", "is a receiver's", value=cell.input, remedy="use an input of its own")
        if self.unit != "V":
            limit = f"needs a rig that measures volts; this one measures {self.unit}"
            raise refused("load_cell", limit, remedy="omit it")
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
        """Number of alternating emitters."""
        return max(one for sensor in self.sensor for one in sensor.lit_by.values())

    @property
    def inputs(self) -> int:
        """Number of sampled inputs."""
        cell = 0 if self.load_cell is None else self.load_cell.input or 0
        return max(cell, *(one for sensor in self.sensor for one in sensor.read_on.values()))

    @property
    def simulated(self) -> bool:
        """Whether any of its data are simulated."""
        return "simulated" in {self.sampler.driver, *(axis.driver for axis in self.axes.values())}

    @property
    def axes(self) -> dict[str, StageOf]:
        """Stages by the motions that they make; the single stage of a rig without a network has no name."""
        return self.stages or {"": self.stage}

    @property
    def moves_in(self) -> str:
        """Unit of its motion."""
        return next(iter(self.axes.values())).moves_in

    def as_one(self, stage: StageOf) -> "Rig":
        """Return the rig with one of its stages as the only one, for a driver that opens it."""
        return self.model_copy(update={"stage": stage, "stages": {}})


def check_names(rig: Rig, folder: Path) -> None:
    """Raise `BenchError` if a network lacks an emitter, receiver or motion with a name that the rig wires or moves.

    Sensors that are not networks are not inspected.
    """
    for number, sensor in enumerate(rig.sensor):
        if not sensor.is_network:
            continue
        design = load(folder / sensor.design)
        if design.body.kind != "network":
            limit = f"is a {design.body.kind}; emitters and inputs by name are for a network"
            raise BenchError(sensor.design, limit=limit, remedy="state emitter, right and left")
        network = design.network
        for key, kind, names, there in (
            (f"sensor[{number}].emitters", "emitter", sensor.lit_by, network.emitters),
            (f"sensor[{number}].inputs", "receiver", sensor.read_on, network.receivers),
            ("stages", "motion", rig.stages, network.motion),
        ):
            known = [one.name for one in there]
            for name in names:
                if name not in known:
                    limit = f"names no {kind} of {sensor.design}; known are {', '.join(known) or 'none'}"
                    raise BenchError(key, value=name, limit=limit)


def driven_values(position: FloatArray, header: Mapping[str, Any]) -> FloatArray:
    """Return the angles in degrees, or depths in mm, of a sensor at positions of the stage, by the header of a run."""
    if header.get("drives") == "depth":
        return np.asarray(position - header["zero"])
    return sensor_angle_deg(position, header["zero"], header["lever_mm"])


def sensor_angle_deg(position: FloatArray, zero: float, lever_mm: float | None) -> FloatArray:
    """Return the angles of a sensor at positions of the stage: degrees unchanged, or mm at the end of a lever."""
    moved = np.asarray(position - zero)
    return moved if lever_mm is None else np.degrees(np.arctan(moved / lever_mm))


def load_rig(path: Path) -> Rig:
    """Read the rig of a file; raise `BenchError` if it cannot be read or is invalid."""
    rig = load_table(path, Rig)
    with error_context(str(path)):
        _ = rig.setup  # raises an error if the instrument does not support the settings
    return rig

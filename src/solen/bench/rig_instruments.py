"""Tables of a rig for its instruments and their connections: stage, and board, data acquisition or meter.

Public names: `StageOf`, `BoardOf`, `DaqOf` and `MeterOf`.
"""

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.bench.daq import MODELS, Setup
from solen.bench.drivers import DRIVERS, KINDS
from solen.bench.gcs2 import STAGES, unit_of
from solen.bench.tables import BenchTable
from solen.errors import BenchError
from solen.spec.strict import NotNegative, Number, Positive, Text, refused


def _check_driver(table: "StageOf | BoardOf | DaqOf", key: str) -> None:
    """Reject a driver unknown for this role, and require the ``key`` that locates a real instrument."""
    known = [name for name, driver in DRIVERS.items() if driver.role == table.table]
    if table.driver != "simulated" and table.driver not in known:
        raise refused("driver", f"must be one of simulated, {', '.join(known)}", value=table.driver)
    stated = getattr(table, key) is not None
    if stated if table.driver == "simulated" else not stated and DRIVERS[table.driver].needs == key:
        what = "instrument" if table.table == "daq" else table.table
        raise refused(key, f"is for a real {what}, and a real {what} requires it", value=getattr(table, key))


def _check_keys(table: "StageOf | MeterOf", takes: tuple[str, ...]) -> None:
    """Reject keys that its driver does not use."""
    for key in KINDS[table.table]:
        if key in table.model_fields_set and key not in takes and (value := getattr(table, key)) is not None:
            raise refused(key, f"is not used by the driver {table.driver}", value=value, remedy="omit it")


class StageOf(BenchTable):
    """The stage, which moves the sensor."""

    table: ClassVar[str] = "stage"

    driver: Text = Field(
        "simulated",
        description="simulated, gcs2 for a controller of PI, kinesis for one of Thorlabs, grbl or marlin for a "
        "stepper, zaber, hand for no motor, board for the motor of a board, or that of another package.",
    )
    model: Text = Field("M-060.DG", description=f"Name of the stage: {', '.join(STAGES)}.")
    unit: Literal["deg", "mm"] | None = Field(
        None, description="Unit of its motion; required for a model that is not among these."
    )
    port: Text | None = Field(None, description="Line to the controller: COM3, /dev/ttyUSB0, socket://host:port.")
    baud: Annotated[int, Field(strict=True, ge=1200, le=10_000_000)] = Field(115_200, description="Baud rate.")
    axis: Text = Field("1", description="Name of the axis.")
    address: Annotated[int, Field(strict=True, ge=1, le=16)] | None = Field(
        None, description="Address of the controller if several share a line."
    )
    steps_per_unit: Positive | None = Field(
        None,
        description="Steps per deg or mm for a board's motor; microsteps or counts for a stage of Zaber or Thorlabs.",
    )
    zero: Number = Field(0.0, description="Position at which the sensor is straight, in deg or mm.")
    home: Literal["here"] | bool = Field(
        False,
        description='Whether it may move to its reference switch without asking; "here": the current position is '
        "the zero, and nothing moves.",
    )
    travel: tuple[Number, Number] | None = Field(
        None, description="Lowest and highest position to which the stage may move, in deg or mm."
    )
    lever_mm: Positive | None = Field(
        None, description="Distance from the pivot at which a linear stage pushes; converts mm to degrees."
    )
    drives: Literal["angle", "depth"] = Field(
        "angle",
        description="Whether it bends the sensor, or, as a linear stage without lever_mm, presses a finger into it.",
    )

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        _check_driver(self, "port")
        if self.travel is not None and not self.travel[0] <= self.zero <= self.travel[1]:
            raise refused("travel", f"must begin below zero = {self.zero:g} and end above it", value=self.travel)
        takes = ("model",) if self.driver == "simulated" else DRIVERS[self.driver].takes
        if takes is None:
            return self
        _check_keys(self, takes)
        if "baud" in self.model_fields_set and self.port is None:
            raise refused("baud", "is not used without a port", value=self.baud, remedy="omit it")
        if "steps_per_unit" in takes and self.steps_per_unit is None:
            raise refused("steps_per_unit", f"is needed by the driver {self.driver}")
        try:
            unit = unit_of(self.model, self.unit) if "model" in takes else self.unit
        except BenchError as bad:
            raise refused("model" if bad.what == "stage" else bad.what, bad.limit, value=bad.value) from None
        self._check_drive(unit)
        return self

    def _check_drive(self, unit: str | None) -> None:
        """Reject a stage that cannot produce the stimulus of ``drives``."""
        if self.drives == "depth":
            if unit == "deg":
                raise refused("drives", "is for a linear stage", value="depth", remedy='omit it, or set unit = "mm"')
            if self.lever_mm is not None:
                limit = 'cannot be combined with drives = "depth"'
                raise refused("lever_mm", limit, value=self.lever_mm, remedy="omit one of them")
        elif unit is not None and (unit == "mm") != (self.lever_mm is not None):
            limit = "is for a linear stage, and a linear stage requires it"
            remedy = 'a stage that presses a finger into the sensor states drives = "depth"' if unit == "mm" else ""
            raise refused("lever_mm", limit, value=self.lever_mm, remedy=remedy)

    @property
    def steps(self) -> float:
        """Steps per unit, for a driver that requires them."""
        return self.steps_per_unit or 1.0

    @property
    def moves_in(self) -> Literal["deg", "mm"]:
        """Unit of its positions: as stated, or mm for a lever or a depth."""
        return self.unit or ("deg" if self.lever_mm is None and self.drives == "angle" else "mm")


class BoardOf(BenchTable):
    """Instrument that switches the emitters and samples the receivers."""

    table: ClassVar[str] = "board"

    driver: Text = Field(
        "simulated", description="Driver: simulated, serial (a real board), or one from another package."
    )
    port: Text | None = Field(None, description="Line to the board.")
    baud: Annotated[int, Field(strict=True, ge=1200, le=10_000_000)] = Field(1_000_000, description="Baud rate.")
    rate_hz: Annotated[Number, Field(ge=1, le=2000)] = Field(200.0, description="Periods per second.")
    bits: Annotated[int, Field(strict=True, ge=8, le=16)] = Field(16, description="Bits of the board's converter.")
    range_v: Positive = Field(5.0, description="Its range from 0, in V.")
    straight_v: tuple[Number, Number] | None = Field(
        None,
        description="Levels between which its converter is linear, [0.15, 2.45] for an ESP32; others cause a warning.",
    )
    unit: Text = Field("V", description="Unit of its numbers: V, or pF, ohm, lux, counts, ...")
    per_count: Positive | None = Field(
        None, description="Size of one count in a unit other than V; default for counts: 1."
    )
    trim_v: Positive | None = Field(
        None,
        description="Voltage of a receiver's brightest reading, to which the trimmers of a simulated board are set "
        "as far as possible; default: readout.load_ohm of the designs.",
    )
    noise_uv: NotNegative = Field(150.0, description="Noise of a simulated board's converter, in µV.")

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        _check_driver(self, "port")
        if self.unit == "V" and self.per_count is not None:
            raise refused(
                "per_count", "is for units other than V, whose step range_v and bits determine", value=self.per_count
            )
        if self.straight_v is not None and not self.straight_v[0] < self.straight_v[1]:
            raise refused("straight_v", "must be the lower and the higher level", value=list(self.straight_v))
        if self.unit not in {"V", "counts"} and self.per_count is None:
            raise refused("per_count", f"must state the size of one count in {self.unit}")
        if self.unit != "V" and self.driver != "simulated" and "range_v" in self.model_fields_set:
            raise refused("range_v", f"is for volts, not for {self.unit}", value=self.range_v)
        return self

    @property
    def step(self) -> float:
        """Size of one count in its unit."""
        return self.range_v / math.ldexp(1.0, self.bits) if self.unit == "V" else self.per_count or 1.0


_ASKED = {
    "rate_hz",
    "switch_hz",
    "switching",
    "lines",
    "range_v",
    "terminal",
    "enable",
    "alive",
    "settle_us",
    "buffer_s",
}
"""Keys of a data acquisition that are passed on to its `Setup`."""


class DaqOf(BenchTable):
    """Instrument that only samples the receivers; its counters or an external source switch the emitters."""

    table: ClassVar[str] = "daq"

    driver: Text = Field(
        "simulated",
        description="simulated, nidaqmx (an instrument of National Instruments), or one from another package.",
    )
    device: Text | None = Field(None, description="Name of a real device in NI-DAQmx, such as Dev1.")
    model: Text | None = Field(
        None, description=f"Required model; default: the model that it reports. Simulated: {', '.join(MODELS)}."
    )
    rate_hz: Annotated[Number, Field(ge=100, le=2_000_000)] = Field(
        10_000.0, description="Samples of each input per second."
    )
    range_v: Positive = Field(10.0, description="Its range, ± V; it must include the circuit's supply.")
    terminal: Literal["rse", "nrse", "differential"] = Field("rse", description="Wiring of the inputs.")
    channels: Annotated[tuple[Text, ...], Field(min_length=1, max_length=64)] | None = Field(
        None, description="Its analog inputs for the rig's inputs 1, 2, …; default: ai0, ai1, …"
    )
    switching: Literal["external", "counter", "lines"] = Field(
        "external",
        description="Source of the switching: external, the instrument's counters, or its clocked digital lines.",
    )
    lines: tuple[Text, ...] = Field((), description="Digital outputs that switch emitters 1, 2, …: port0/line0.")
    switch_hz: Annotated[Number, Field(ge=1, le=2000)] = Field(
        200.0, description="Switching frequency of each emitter in Hz."
    )
    sync: Text | None = Field(None, description="Analog input that is high while emitter 1 is on.")
    enable: Text | None = Field(None, description="Static output that is high while samples are taken: port1/line7.")
    alive: Text | None = Field(
        None, description="Static output that changes its level with each reading, for an external watchdog."
    )
    settle_us: NotNegative = Field(300.0, description="Time that is omitted after each switch, in µs.")
    buffer_s: Annotated[Number, Field(ge=1, le=60)] = Field(10.0, description="Size of the computer's buffer, in s.")
    trim_v: Positive | None = Field(None, description="Same as for a simulated board.")
    noise_uv: NotNegative | None = Field(
        None, description="Noise of a simulated one's converter, in µV; default: that of its range in the datasheet."
    )

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        if self.driver == "simulated" and self.kind not in MODELS:
            raise refused("model", f"must be one of {', '.join(MODELS)}", value=self.model)
        _check_driver(self, "device")
        if self.switching != "external" and self.sync is not None:
            raise refused(
                "sync", "cannot be combined with outputs that follow the clock of the samples", value=self.sync
            )
        return self

    @property
    def kind(self) -> str:
        """Its model; empty for a real one, which is queried."""
        return self.model or ("USB-6218" if self.driver == "simulated" else "")

    def setup(self, emitters: int, inputs: int) -> Setup:
        """Return its settings for a number of emitters and inputs.

        Raises `BenchError` if they are known to be impossible.
        """
        pool = MODELS[self.kind].inputs[self.terminal] if self.kind in MODELS else None
        channels = self.channels or (pool or tuple(f"ai{number}" for number in range(inputs)))[:inputs]
        if len(channels) != inputs:
            limit = f"names {len(channels)} inputs; the sensors use {inputs}"
            raise BenchError("daq.channels", limit=limit, remedy="name one for each, in their order")
        return Setup(
            channels=channels if self.sync is None else (*channels, self.sync),
            synced=self.sync is not None,
            emitters=emitters,
            model=self.kind,
            **self.model_dump(include=_ASKED),
        )


class MeterOf(BenchTable):
    """Multimeters or an oscilloscope, which read while an external source drives the emitters."""

    table: ClassVar[str] = "meter"

    driver: Text = Field("multimeter", description="multimeter, oscilloscope, or that of another package.")
    address: Annotated[tuple[Text, ...], Field(min_length=1, max_length=64)] | Text = Field(
        description="VISA address, TCPIP::192.168.0.5::5025::SOCKET; for multimeters one for each of the rig's inputs."
    )
    backend: Text = Field(
        "@py", description="PyVISA's library: @py for pure Python, @ivi for that of a manufacturer, or a path."
    )
    setup: tuple[Text, ...] = Field((), description="Commands to each before the first reading, CONF:VOLT:DC 10.")
    answer_s: Annotated[Number, Field(gt=0, le=60)] = Field(5.0, description="Longest duration of an answer, in s.")
    ask: Text = Field("READ?", description="For multimeters: the query that is answered by one reading.")
    unit: Text = Field("V", description="For multimeters: the unit of their readings.")
    channels: Annotated[tuple[Text, ...], Field(min_length=1)] | None = Field(
        None, description="For an oscilloscope: its channels for inputs 1, 2, …; default: 1, 2, …"
    )
    sync: Text | None = Field(
        None,
        description="For an oscilloscope: channel that is high while emitters are on; default: they are always on.",
    )
    switch_hz: Positive = Field(
        200.0, description="For an oscilloscope with a sync: switching frequency of the emitters in Hz."
    )
    settle_us: NotNegative = Field(
        300.0, description="For an oscilloscope: time that is omitted after each switch, in µs."
    )

    @model_validator(mode="after")
    def _is_there(self) -> Self:
        known = [name for name, driver in DRIVERS.items() if driver.role == self.table]
        if self.driver not in known:
            raise refused("driver", f"must be one of {', '.join(known)}", value=self.driver)
        if (takes := DRIVERS[self.driver].takes) is not None:
            _check_keys(self, takes)
        for key in ("switch_hz", "settle_us"):
            if key in self.model_fields_set and self.sync is None:
                raise refused(key, "is not used without a sync", value=getattr(self, key), remedy="record the sync")
        return self

    @property
    def addresses(self) -> tuple[str, ...]:
        """Return the addresses as a list."""
        return (self.address,) if isinstance(self.address, str) else self.address

    def check_inputs(self, emitters: int, inputs: int) -> None:
        """Reject a rig whose sensors it cannot read."""
        if emitters > 1:
            raise refused(
                "meter",
                "cannot switch emitters: it reads while all of them are on",
                remedy="state emitter = 1 of each sensor",
            )
        wired = {"multimeter": ("address", self.addresses), "oscilloscope": ("channels", self.channels)}
        key, names = wired.get(self.driver, ("", None))
        if names is not None and len(names) != inputs:
            limit = f"names {len(names)}; the sensors use {inputs} inputs"
            raise refused(f"meter.{key}", limit, remedy="name one for each, in their order")
        if self.driver == "oscilloscope" and len(self.addresses) > 1:
            raise refused("meter.address", "names more than one oscilloscope", value=self.address)

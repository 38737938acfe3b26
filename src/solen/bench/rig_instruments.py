"""Tables of a rig file for the instruments and their connections: stage, and board, DAQ device or meter.

Public names: `StageTable`, `BoardTable`, `DaqTable` and `MeterTable`.
"""

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.bench.daq import MODELS, Setup
from solen.bench.drivers import DRIVER_KEYS, DRIVERS
from solen.bench.gcs2 import STAGES, unit_of
from solen.bench.tables import BenchTable
from solen.errors import BenchError
from solen.spec.strict import NotNegative, Number, Positive, Text, refused


def _check_driver(table: "StageTable | BoardTable | DaqTable", key: str) -> None:
    """Reject an unknown driver; require the key that locates a real instrument, and reject it for a simulated one."""
    known = [name for name, driver in DRIVERS.items() if driver.role == table.table]
    if table.driver != "simulated" and table.driver not in known:
        raise refused("driver", f"must be one of simulated, {', '.join(known)}", value=table.driver)
    value = getattr(table, key)
    if table.driver == "simulated" and value is not None:
        raise refused(key, 'cannot be combined with driver = "simulated"', value=value, remedy="omit it")
    if table.driver != "simulated" and value is None and DRIVERS[table.driver].needs == key:
        raise refused(key, f"is required by the driver {table.driver}", remedy="add it")


def _check_keys(table: "StageTable | MeterTable", takes: tuple[str, ...]) -> None:
    """Reject keys that its driver does not use."""
    for key in DRIVER_KEYS[table.table]:
        if key in table.model_fields_set and key not in takes and (value := getattr(table, key)) is not None:
            raise refused(key, f"is not used by the driver {table.driver}", value=value, remedy="omit it")


class StageTable(BenchTable):
    """A stage, which moves the sensor."""

    table: ClassVar[str] = "stage"

    driver: Text = Field(
        "simulated",
        description="simulated, gcs2 (a controller of PI), kinesis (Thorlabs), grbl or marlin (a stepper), zaber, "
        "hand (no motor), board (the motor of a board), or a driver of another package.",
    )
    model: Text = Field(
        "M-060.DG", description=f"Name of the stage: {', '.join(STAGES)}, or another one with its unit."
    )
    unit: Literal["deg", "mm"] | None = Field(
        None, description=f"Unit of its positions; required for a model other than {' and '.join(STAGES)}."
    )
    port: Text | None = Field(None, description="Port of the controller: COM3, /dev/ttyUSB0, socket://host:port.")
    baud: Annotated[int, Field(strict=True, ge=1200, le=10_000_000)] = Field(115_200, description="Baud rate.")
    axis: Text = Field("1", description="Name of the axis.")
    address: Annotated[int, Field(strict=True, ge=1, le=16)] | None = Field(
        None, description="Address of the controller if several share a line."
    )
    steps_per_unit: Positive | None = Field(
        None,
        description="Steps per deg or mm of a board's motor; microsteps or counts of a stage of Zaber or Thorlabs.",
    )
    zero: Number = Field(0.0, description="Position at which the sensor is straight, in deg or mm.")
    home: Literal["here"] | bool = Field(
        False,
        description='Whether it may move to its reference switch without confirmation; "here" defines the current '
        "position as zero, and nothing moves.",
    )
    travel: tuple[Number, Number] | None = Field(
        None, description="Lowest and highest position to which the stage may move, in deg or mm."
    )
    lever_mm: Positive | None = Field(
        None, description="Distance from the pivot at which a linear stage pushes; converts mm to degrees."
    )
    drives: Literal["angle", "depth"] = Field(
        "angle",
        description="Quantity that it drives: the angle of the sensor, or the depth of a finger pressed into it.",
    )

    @model_validator(mode="after")
    def _check_all(self) -> Self:
        _check_driver(self, "port")
        if self.travel is not None and not self.travel[0] <= self.zero <= self.travel[1]:
            raise refused("travel", f"must include the zero, {self.zero:g}", value=self.travel)
        takes = ("model",) if self.driver == "simulated" else DRIVERS[self.driver].takes
        if takes is None:
            return self
        _check_keys(self, takes)
        if "baud" in self.model_fields_set and self.port is None:
            raise refused("baud", "is not used without a port", value=self.baud, remedy="omit it")
        if "steps_per_unit" in takes and self.steps_per_unit is None:
            raise refused("steps_per_unit", f"is required by the driver {self.driver}", remedy="add it")
        try:
            unit = unit_of(self.model, self.unit) if "model" in takes else self.unit
        except BenchError as bad:
            raise refused("model" if bad.what == "stage" else bad.what, bad.limit, value=bad.value) from None
        self._check_drive(unit)
        return self

    def _check_drive(self, unit: str | None) -> None:
        """Reject a stage that cannot drive the quantity of ``drives``."""
        if self.drives == "depth":
            if unit == "deg":
                raise refused("drives", "requires a linear stage", value="depth", remedy='omit it, or set unit = "mm"')
            if self.lever_mm is not None:
                limit = 'cannot be combined with drives = "depth"'
                raise refused("lever_mm", limit, value=self.lever_mm, remedy="omit one of them")
        elif unit == "mm" and self.lever_mm is None:
            limit = "is required for a linear stage that turns or bends a sensor"
            raise refused("lever_mm", limit, remedy='add it, or set drives = "depth" for a stage that presses')
        elif unit == "deg" and self.lever_mm is not None:
            raise refused("lever_mm", "is for a linear stage", value=self.lever_mm, remedy="omit it")

    @property
    def steps(self) -> float:
        """Steps per unit; 1 for a driver that does not use them."""
        return self.steps_per_unit or 1.0

    @property
    def motion_unit(self) -> Literal["deg", "mm"]:
        """Unit of its positions; if not specified, mm with a lever or for a depth, otherwise deg."""
        return self.unit or ("deg" if self.lever_mm is None and self.drives == "angle" else "mm")


class BoardTable(BenchTable):
    """Instrument that switches the emitters and samples the receivers."""

    table: ClassVar[str] = "board"

    driver: Text = Field(
        "simulated", description="Driver: simulated, serial (a real board), or one of another package."
    )
    port: Text | None = Field(None, description="Port of the board: COM3, /dev/ttyUSB0, socket://host:port.")
    baud: Annotated[int, Field(strict=True, ge=1200, le=10_000_000)] = Field(1_000_000, description="Baud rate.")
    rate_hz: Annotated[Number, Field(ge=1, le=2000)] = Field(200.0, description="Periods per second.")
    bits: Annotated[int, Field(strict=True, ge=8, le=16)] = Field(16, description="Bits of the ADC.")
    range_v: Positive = Field(5.0, description="Upper limit of the ADC range, in V; the lower one is 0.")
    linear_v: tuple[Number, Number] | None = Field(
        None, description="Linear range of the ADC in V, [0.15, 2.45] for an ESP32; levels outside cause a warning."
    )
    unit: Text = Field("V", description="Unit of the readings: V, or pF, ohm, lux, counts, ...")
    per_count: Positive | None = Field(
        None, description="Size of one count in a unit other than V; default for counts: 1."
    )
    trim_v: Positive | None = Field(
        None,
        description="Voltage to which the trimmer of each simulated receiver sets its brightest reading, as far as "
        "possible; default: readout.load_ohm of the design.",
    )
    noise_uv: NotNegative = Field(150.0, description="Noise of the ADC of a simulated board, in µV.")

    @model_validator(mode="after")
    def _check_all(self) -> Self:
        _check_driver(self, "port")
        if self.unit == "V" and self.per_count is not None:
            limit = "is for a unit other than V; for V, range_v and bits determine the size of a count"
            raise refused("per_count", limit, value=self.per_count, remedy="omit it")
        if self.linear_v is not None and not self.linear_v[0] < self.linear_v[1]:
            raise refused("linear_v", "must be in ascending order", value=list(self.linear_v))
        if self.unit not in {"V", "counts"} and self.per_count is None:
            raise refused("per_count", "is missing", remedy=f"set it to the size of one count in {self.unit}")
        if self.unit != "V" and self.driver != "simulated" and "range_v" in self.model_fields_set:
            raise refused("range_v", f"is for V, not for {self.unit}", value=self.range_v, remedy="omit it")
        return self

    @property
    def step(self) -> float:
        """Size of one count in its unit."""
        return self.range_v / math.ldexp(1.0, self.bits) if self.unit == "V" else self.per_count or 1.0


_SETUP_KEYS = {
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
"""Keys of `DaqTable` that are passed on to `Setup`."""


class DaqTable(BenchTable):
    """DAQ device that samples the receivers; its counters or lines, or an external source, switch the emitters."""

    table: ClassVar[str] = "daq"

    driver: Text = Field(
        "simulated",
        description="simulated, nidaqmx (a device of National Instruments), or a driver of another package.",
    )
    device: Text | None = Field(None, description="Name of a real device in NI-DAQmx, such as Dev1.")
    model: Text | None = Field(
        None, description=f"Required model of the device; default: any. Simulated: {', '.join(MODELS)}."
    )
    rate_hz: Annotated[Number, Field(ge=100, le=2_000_000)] = Field(
        10_000.0, description="Samples of each input per second."
    )
    range_v: Positive = Field(10.0, description="Input range, ± V; it must include the supply of the circuit.")
    terminal: Literal["rse", "nrse", "differential"] = Field("rse", description="Wiring of the inputs.")
    channels: Annotated[tuple[Text, ...], Field(min_length=1, max_length=64)] | None = Field(
        None, description="Analog inputs of the device for the rig's inputs 1, 2, …; default: ai0, ai1, …"
    )
    switching: Literal["external", "counter", "lines"] = Field(
        "external",
        description="What switches the emitters: an external source, or the device's counters or digital lines.",
    )
    lines: tuple[Text, ...] = Field((), description="Digital outputs that switch emitters 1, 2, …: port0/line0.")
    switch_hz: Annotated[Number, Field(ge=1, le=2000)] = Field(
        200.0, description="Switching frequency of each emitter in Hz."
    )
    sync: Text | None = Field(None, description="Analog input that is high while emitter 1 is on.")
    enable: Text | None = Field(None, description="Static output that is high while samples are taken: port1/line7.")
    alive: Text | None = Field(
        None, description="Static output that toggles with each reading, for an external watchdog."
    )
    settle_us: NotNegative = Field(300.0, description="Time after each switch whose samples are omitted, in µs.")
    buffer_s: Annotated[Number, Field(ge=1, le=60)] = Field(10.0, description="Size of the computer's buffer, in s.")
    trim_v: Positive | None = Field(None, description="The same as trim_v in [board], for a simulated device.")
    noise_uv: NotNegative | None = Field(
        None, description="Noise of the ADC of a simulated device, in µV; default: that in its datasheet."
    )

    @model_validator(mode="after")
    def _check_all(self) -> Self:
        if self.driver == "simulated" and self.kind not in MODELS:
            raise refused("model", f"must be one of {', '.join(MODELS)}", value=self.model)
        _check_driver(self, "device")
        if self.switching != "external" and self.sync is not None:
            limit = f'cannot be combined with switching = "{self.switching}"'
            raise refused("sync", limit, value=self.sync, remedy="omit it")
        return self

    @property
    def kind(self) -> str:
        """Its model; empty for a real device whose model is not specified."""
        return self.model or ("USB-6218" if self.driver == "simulated" else "")

    def setup(self, emitters: int, inputs: int) -> Setup:
        """Return the settings for a number of emitters and inputs; raise `BenchError` if they are impossible."""
        known = MODELS[self.kind].inputs[self.terminal] if self.kind in MODELS else None
        channels = self.channels or (known or tuple(f"ai{number}" for number in range(inputs)))[:inputs]
        if len(channels) != inputs:
            limit = f"must list {inputs}, one for each input of the sensors, in order"
            raise BenchError("daq.channels", value=", ".join(channels), limit=limit)
        return Setup(
            channels=channels if self.sync is None else (*channels, self.sync),
            synced=self.sync is not None,
            emitters=emitters,
            model=self.kind,
            **self.model_dump(include=_SETUP_KEYS),
        )


class MeterTable(BenchTable):
    """Multimeters or an oscilloscope, which measure while an external source drives the emitters."""

    table: ClassVar[str] = "meter"

    driver: Text = Field("multimeter", description="multimeter, oscilloscope, or a driver of another package.")
    address: Annotated[tuple[Text, ...], Field(min_length=1, max_length=64)] | Text = Field(
        description="VISA address, TCPIP::192.168.0.5::5025::SOCKET; for multimeters one for each of the rig's inputs."
    )
    backend: Text = Field(
        "@py", description="PyVISA's library: @py for pure Python, @ivi for that of a manufacturer, or a path."
    )
    setup: tuple[Text, ...] = Field(
        (), description="Commands to each instrument before the first reading, CONF:VOLT:DC 10."
    )
    answer_s: Annotated[Number, Field(gt=0, le=60)] = Field(5.0, description="Time limit for a reply, in s.")
    ask: Text = Field("READ?", description="For multimeters: the query whose reply is one reading.")
    unit: Text = Field("V", description="For multimeters: the unit of their readings.")
    channels: Annotated[tuple[Text, ...], Field(min_length=1)] | None = Field(
        None, description="For an oscilloscope: its channels for inputs 1, 2, …; default: 1, 2, …"
    )
    sync: Text | None = Field(
        None,
        description="For an oscilloscope: channel that is high while the emitters are on; omit it for steady light.",
    )
    switch_hz: Positive = Field(
        200.0, description="For an oscilloscope with a sync: switching frequency of the emitters in Hz."
    )
    settle_us: NotNegative = Field(
        300.0, description="For an oscilloscope with a sync: time after each switch whose samples are omitted, in µs."
    )

    @model_validator(mode="after")
    def _check_all(self) -> Self:
        known = [name for name, driver in DRIVERS.items() if driver.role == self.table]
        if self.driver not in known:
            raise refused("driver", f"must be one of {', '.join(known)}", value=self.driver)
        if (takes := DRIVERS[self.driver].takes) is not None:
            _check_keys(self, takes)
        for key in ("switch_hz", "settle_us"):
            if key in self.model_fields_set and self.sync is None:
                remedy = f"set sync, or omit {key}"
                raise refused(key, "is not used without a sync", value=getattr(self, key), remedy=remedy)
        return self

    @property
    def addresses(self) -> tuple[str, ...]:
        """Addresses as a tuple, also if there is only one."""
        return (self.address,) if isinstance(self.address, str) else self.address

    def check_inputs(self, emitters: int, inputs: int) -> None:
        """Reject a rig with alternating emitters, or with another number of inputs than the meter has."""
        if emitters > 1:
            limit = "cannot alternate emitters: it measures while all of them are on"
            raise refused("meter", limit, remedy="set emitter = 1 for each sensor")
        by_driver = {"multimeter": ("address", self.addresses), "oscilloscope": ("channels", self.channels)}
        key, names = by_driver.get(self.driver, ("", None))
        if names is not None and len(names) != inputs:
            limit = f"must list {inputs}, one for each input of the sensors, in order"
            raise refused(f"meter.{key}", limit, value=", ".join(names))
        if self.driver == "oscilloscope" and len(self.addresses) > 1:
            raise refused("meter.address", "must be the address of a single oscilloscope", value=self.address)

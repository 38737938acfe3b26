"""Drivers of real instruments, keyed by the name used in a rig file.

A driver opens an instrument for one of the roles in `solen.bench.roles`, from the rig, which specifies the connection,
and the clock of the run. A new driver is a module in this package and a row of `DRIVERS`. Another package adds a
`Driver` with an entry point in the group ``solen.instruments``.

Public names: `Driver`, `DRIVERS` and `open_instruments`.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

from solen import registry
from solen.bench.clock import Clock
from solen.bench.roles import Daq, Meter, Sampler, Stage
from solen.errors import BenchError

if TYPE_CHECKING:  # the tables of the rig import this module
    from solen.bench.board import SerialBoard
    from solen.bench.frames import Layout
    from solen.bench.link import Link
    from solen.bench.rig import Rig
    from solen.bench.rig_instruments import MeterTable, StageTable


DRIVER_KEYS = {
    "stage": ("model", "port", "baud", "axis", "address", "steps_per_unit"),
    "meter": ("ask", "unit", "channels", "sync", "switch_hz", "settle_us"),
}
"""Keys of each table that only some of its drivers use."""
_SERIAL_KEYS, _OSCILLOSCOPE_KEYS = ("port", "baud", "axis"), ("channels", "sync", "switch_hz", "settle_us")


@dataclass(frozen=True)
class Driver:
    """How to open an instrument of a rig.

    Attributes
    ----------
    role
        Table of the rig file in which the driver may be used.
    open
        Opens the instrument of a rig, with the clock of the run; raises `BenchError` if it cannot be opened.
    needs
        Key of that table that the driver requires: ``port``, ``device`` or ``address``; empty for none.
    takes
        Keys in `DRIVER_KEYS` that the driver uses; None for all.
    stops
        Whether the position of the stage is known only at rest.
    """

    role: Literal["stage", "board", "daq", "meter"]
    open: "Callable[[Rig, Clock], Stage | Sampler]"
    needs: str = ""
    takes: tuple[str, ...] | None = None
    stops: bool = False


@contextmanager
def on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Call ``undo`` if the body fails."""
    try:
        yield
    except BaseException:
        undo()
        raise


@contextmanager
def _serial_link(port: str | None, baud: int) -> "Iterator[Link]":
    """Open a line, and close it if the instrument at its end cannot be opened."""
    from solen.bench.link import open_link

    link = open_link(str(port), baud=baud)
    with on_failure(link.close):
        yield link


def _gcs2(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.gcs2 import Gcs2Stage

    table = rig.stage
    with _serial_link(table.port, table.baud) as link:
        return Gcs2Stage(link, clock, stage=table.model, unit=table.unit, axis=table.axis, address=table.address)


def _axis_letter(table: "StageTable") -> str:
    """Return the letter of the axis of a board that executes G-code; X by default."""
    return table.axis if "axis" in table.model_fields_set else "X"


def _grbl(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.grbl import GrblStage

    table = rig.stage
    with _serial_link(table.port, table.baud) as link:
        return GrblStage(link, clock, unit=table.motion_unit, axis=_axis_letter(table))


def _marlin(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.marlin import MarlinStage

    table = rig.stage
    with _serial_link(table.port, table.baud) as link:
        return MarlinStage(link, clock, unit=table.motion_unit, axis=_axis_letter(table))


def _zaber(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.zaber import ZaberStage

    table = rig.stage
    with _serial_link(table.port, table.baud) as link:
        return ZaberStage(
            link,
            clock,
            steps_per_unit=table.steps,
            unit=table.motion_unit,
            axis=table.axis,
            address=table.address or 1,
        )


def _kinesis(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.kinesis import KinesisStage

    table = rig.stage
    with _serial_link(table.port, table.baud) as link:
        return KinesisStage(link, clock, counts_per_unit=table.steps, unit=table.motion_unit)


def _hand(rig: "Rig", clock: Clock) -> Stage:  # noqa: ARG001  a stage turned by hand needs no clock
    from solen.bench.manual_stage import ManualStage

    return ManualStage(rig.stage.motion_unit)


def _board_motor(rig: "Rig", clock: Clock) -> Stage:
    """Open the motor of the sampling board, or of a separate board, whose emitters and inputs are not used."""
    from solen.bench.board import BoardStage
    from solen.bench.frames import Layout

    table = rig.stage
    board = _serial_board(rig, clock) if table.port is None else _board_at(table.port, table.baud, clock, Layout(1, 1))
    with on_failure(board.close):
        return BoardStage(board, clock, steps_per_unit=table.steps, unit=table.motion_unit)


def _serial_board(rig: "Rig", clock: Clock) -> "SerialBoard":
    from solen.bench.frames import Layout

    table, layout = rig.board, Layout(rig.emitters, rig.inputs)
    period_s = 1.0 / table.rate_hz
    return _board_at(table.port, table.baud, clock, layout, period_s=period_s, volts_per_count=table.step)


def _board_at(
    port: str | None, baud: int, clock: Clock, layout: "Layout", *, period_s: float = 0.02, volts_per_count: float = 1.0
) -> "SerialBoard":
    from solen.bench.board import SerialBoard

    with _serial_link(port, baud) as link:
        return SerialBoard(link, clock, layout, period_s=period_s, volts_per_count=volts_per_count)


def _nidaqmx(rig: "Rig", clock: Clock) -> Daq:
    from solen.bench.nidaq import NiDaq

    if rig.daq is None or (setup := rig.setup) is None:
        raise BenchError("daq", limit="is missing", remedy="add [daq] to the rig file")
    return NiDaq(clock, str(rig.daq.device), setup)


def _meter_table(rig: "Rig") -> "MeterTable":
    if rig.meter is None:
        raise BenchError("meter", limit="is missing", remedy="add [meter] to the rig file")
    return rig.meter


def _multimeters(rig: "Rig", clock: Clock) -> Meter:
    from solen.bench.multimeter import Multimeters

    table = _meter_table(rig)
    return Multimeters(
        clock,
        table.addresses,
        query=table.ask,
        setup=table.setup,
        unit=table.unit,
        backend=table.backend,
        timeout_s=table.answer_s,
    )


def _oscilloscope(rig: "Rig", clock: Clock) -> Meter:
    from solen.bench.oscilloscope import Oscilloscope

    table = _meter_table(rig)
    return Oscilloscope(
        clock,
        table.addresses[0],
        table.channels or tuple(str(number) for number in range(1, rig.inputs + 1)),
        sync=table.sync,
        setup=table.setup,
        switch_hz=table.switch_hz,
        settle_us=table.settle_us,
        backend=table.backend,
        timeout_s=table.answer_s,
    )


DRIVERS: registry.Registry[Driver] = registry.Registry(
    registry.INSTRUMENTS,
    {
        "gcs2": Driver("stage", _gcs2, needs="port", takes=(*_SERIAL_KEYS, "model", "address")),
        "grbl": Driver("stage", _grbl, needs="port", takes=_SERIAL_KEYS),
        "hand": Driver("stage", _hand, takes=(), stops=True),
        "kinesis": Driver("stage", _kinesis, needs="port", takes=("port", "steps_per_unit")),
        "marlin": Driver("stage", _marlin, needs="port", takes=_SERIAL_KEYS, stops=True),
        "board": Driver("stage", _board_motor, takes=("port", "baud", "steps_per_unit")),
        "zaber": Driver("stage", _zaber, needs="port", takes=(*_SERIAL_KEYS, "address", "steps_per_unit")),
        "serial": Driver("board", _serial_board, needs="port"),
        "nidaqmx": Driver("daq", _nidaqmx, needs="device"),
        "multimeter": Driver("meter", _multimeters, needs="address", takes=("ask", "unit")),
        "oscilloscope": Driver("meter", _oscilloscope, needs="address", takes=_OSCILLOSCOPE_KEYS),
    },
    Driver,
)
"""Drivers keyed by name, without ``simulated``: all instruments of a simulated rig are created together."""


def open_instruments(rig: "Rig", clock: Clock) -> tuple[dict[str, Stage], Sampler]:
    """Open the stages, keyed by motion, and the sampler of a real rig.

    If an instrument cannot be opened, those already open are closed. A stage that is the motor of the sampling board
    also provides that board as the sampler.
    """
    stages: dict[str, Stage] = {}
    sampler: Sampler | None = None
    with ExitStack() as opened:
        for motion, table in rig.axes.items():
            single = rig.with_single_stage(table) if rig.stages else rig
            stages[motion] = cast("Stage", DRIVERS[table.driver].open(single, clock))  # the rig has checked the roles
            opened.callback(stages[motion].close)
            if table.port is None:
                sampler = getattr(stages[motion], "board", sampler)
        sampler = sampler or cast("Sampler", DRIVERS[rig.sampler.driver].open(rig, clock))
        opened.pop_all()
    return stages, sampler

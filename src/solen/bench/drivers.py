"""Drivers of real instruments, by the name used in a rig file.

A driver plays one of the roles of `solen.bench.roles`. To open an instrument, the driver needs the rig, which specifies
the connection, and the clock of the run. Another package adds a `Driver` with an entry point of ``solen.instruments``.

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

if TYPE_CHECKING:  # the rig's tables name drivers of this module
    from solen.bench.board import SerialBoard
    from solen.bench.frames import Layout
    from solen.bench.link import Link
    from solen.bench.rig import Rig
    from solen.bench.rig_instruments import MeterOf, StageOf


KINDS = {
    "stage": ("model", "port", "baud", "axis", "address", "steps_per_unit"),
    "meter": ("ask", "unit", "channels", "sync", "switch_hz", "settle_us"),
}
"""Keys of a rig-file table that only some drivers of that table use."""
_LINE, _SCOPE = ("port", "baud", "axis"), ("channels", "sync", "switch_hz", "settle_us")


@dataclass(frozen=True)
class Driver:
    """How to open an instrument of a rig.

    Attributes
    ----------
    role
        The rig-file table that may name this driver.
    open
        Opens the instrument of a rig with the clock used for waiting; raises `BenchError` if the instrument cannot be
        opened.
    needs
        Key of that table which the driver requires: ``port``, ``device``, ``address``, or none.
    takes
        Keys of `KINDS` that the driver uses; None for all.
    stops
        Whether the stage position is known only at rest.
    """

    role: Literal["stage", "board", "daq", "meter"]
    open: "Callable[[Rig, Clock], Stage | Sampler]"
    needs: str = ""
    takes: tuple[str, ...] | None = None
    stops: bool = False


@contextmanager
def on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Undo the setup if the body fails."""
    try:
        yield
    except BaseException:
        undo()
        raise


def _on_its_line(rig: "Rig", made: "Callable[[StageOf, Link], Stage]") -> Stage:
    """Return a stage with a line of its own, which is closed if the stage cannot be driven."""
    from solen.bench.link import open_link

    link = open_link(str(rig.stage.port), baud=rig.stage.baud)
    with on_failure(link.close):
        return made(rig.stage, link)


def _gcs2(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.gcs2 import Gcs2Stage

    def made(table: "StageOf", link: "Link") -> Stage:
        return Gcs2Stage(link, clock, stage=table.model, unit=table.unit, axis=table.axis, address=table.address)

    return _on_its_line(rig, made)


def _letter(table: "StageOf") -> str:
    """Return the axis of a stepper board, which is a letter."""
    return table.axis if "axis" in table.model_fields_set else "X"


def _grbl(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.grbl import GrblStage

    return _on_its_line(rig, lambda table, link: GrblStage(link, clock, unit=table.moves_in, axis=_letter(table)))


def _marlin(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.marlin import MarlinStage

    return _on_its_line(rig, lambda table, link: MarlinStage(link, clock, unit=table.moves_in, axis=_letter(table)))


def _zaber(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.zaber import ZaberStage

    def made(table: "StageOf", link: "Link") -> Stage:
        steps, unit = table.steps, table.moves_in
        return ZaberStage(link, clock, steps_per_unit=steps, unit=unit, axis=table.axis, address=table.address or 1)

    return _on_its_line(rig, made)


def _kinesis(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.kinesis import KinesisStage

    return _on_its_line(
        rig, lambda table, link: KinesisStage(link, clock, counts_per_unit=table.steps, unit=table.moves_in)
    )


def _hand(rig: "Rig", clock: Clock) -> Stage:  # noqa: ARG001  a stage turned by hand needs no clock
    from solen.bench.manual_stage import ManualStage

    return ManualStage(rig.stage.moves_in)


def _motor(rig: "Rig", clock: Clock) -> Stage:
    """Open the motor of the sampling board, or of a separate board whose emitters and inputs stay unused."""
    from solen.bench.board import BoardStage
    from solen.bench.frames import Layout

    table = rig.stage
    board = _serial(rig, clock) if table.port is None else _board_at(table.port, table.baud, clock, Layout(1, 1))
    with on_failure(board.close):
        return BoardStage(board, clock, steps_per_unit=table.steps, unit=table.moves_in)


def _serial(rig: "Rig", clock: Clock) -> "SerialBoard":
    from solen.bench.frames import Layout

    board = rig.board
    by = {"period_s": 1.0 / board.rate_hz, "volts_per_count": board.step}
    return _board_at(str(board.port), board.baud, clock, Layout(rig.emitters, rig.inputs), **by)


def _board_at(
    port: str, baud: int, clock: Clock, layout: "Layout", *, period_s: float = 0.02, volts_per_count: float = 1.0
) -> "SerialBoard":
    from solen.bench.board import SerialBoard
    from solen.bench.link import open_link

    link = open_link(port, baud=baud)
    with on_failure(link.close):
        return SerialBoard(link, clock, layout, period_s=period_s, volts_per_count=volts_per_count)


def _nidaqmx(rig: "Rig", clock: Clock) -> Daq:
    from solen.bench.nidaq import NiDaq

    if rig.daq is None or (setup := rig.setup) is None:
        raise BenchError("daq", limit="missing", remedy="add [daq] to the rig file")
    return NiDaq(clock, str(rig.daq.device), setup)


def _meter_of(rig: "Rig") -> "MeterOf":
    if rig.meter is None:
        raise BenchError("meter", limit="missing", remedy="add [meter] to the rig file")
    return rig.meter


def _multimeters(rig: "Rig", clock: Clock) -> Meter:
    from solen.bench.multimeter import Multimeters

    table = _meter_of(rig)
    by = {"ask": table.ask, "unit": table.unit, "backend": table.backend}
    return Multimeters(clock, table.addresses, setup=table.setup, answer_s=table.answer_s, **by)


def _oscilloscope(rig: "Rig", clock: Clock) -> Meter:
    from solen.bench.oscilloscope import Oscilloscope

    table = _meter_of(rig)
    return Oscilloscope(
        clock,
        table.addresses[0],
        table.channels or tuple(str(number) for number in range(1, rig.inputs + 1)),
        sync=table.sync,
        setup=table.setup,
        switch_hz=table.switch_hz,
        settle_us=table.settle_us,
        backend=table.backend,
        answer_s=table.answer_s,
    )


DRIVERS: registry.Registry[Driver] = registry.Registry(
    registry.INSTRUMENTS,
    {
        "gcs2": Driver("stage", _gcs2, needs="port", takes=(*_LINE, "model", "address")),
        "grbl": Driver("stage", _grbl, needs="port", takes=_LINE),
        "hand": Driver("stage", _hand, takes=(), stops=True),
        "kinesis": Driver("stage", _kinesis, needs="port", takes=("port", "steps_per_unit")),
        "marlin": Driver("stage", _marlin, needs="port", takes=_LINE, stops=True),
        "board": Driver("stage", _motor, takes=("port", "baud", "steps_per_unit")),
        "zaber": Driver("stage", _zaber, needs="port", takes=(*_LINE, "address", "steps_per_unit")),
        "serial": Driver("board", _serial, needs="port"),
        "nidaqmx": Driver("daq", _nidaqmx, needs="device"),
        "multimeter": Driver("meter", _multimeters, needs="address", takes=("ask", "unit")),
        "oscilloscope": Driver("meter", _oscilloscope, needs="address", takes=_SCOPE),
    },
    Driver,
)
"""Drivers by name, without ``simulated``: a simulated rig is created together with all its instruments."""


def open_instruments(rig: "Rig", clock: Clock) -> tuple[dict[str, Stage], Sampler]:
    """Open the stages, by motion, and the sampler of a real rig.

    If an instrument cannot be opened, those already open are closed.

    A stage that is the motor of the sampling board also provides that board as the sampler.
    """
    stages: dict[str, Stage] = {}
    sampler: Sampler | None = None
    with ExitStack() as opened:
        for motion, table in rig.axes.items():
            own = rig.as_one(table) if rig.stages else rig
            stages[motion] = cast("Stage", DRIVERS[table.driver].open(own, clock))  # the rig has checked the roles
            opened.callback(stages[motion].close)
            if table.port is None:
                sampler = getattr(stages[motion], "board", sampler)
        sampler = sampler or cast("Sampler", DRIVERS[rig.sampler.driver].open(rig, clock))
        opened.pop_all()
    return stages, sampler

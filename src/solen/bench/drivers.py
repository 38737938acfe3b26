"""Drivers of real instruments, by the name that a rig file gives them.

The idea: a driver plays one of the roles of `solen.bench.roles`. Opening it needs the rig, which says what it is
connected to, and the clock of the run. Another package adds a `Driver` by an entry point of ``solen.instruments``.

The interface: `Driver`; `DRIVERS`; `open_instruments` of a rig.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

from solen import registry
from solen.bench.clock import Clock
from solen.bench.roles import Daq, EmitterBoard, Stage
from solen.errors import BenchError

if TYPE_CHECKING:  # the rig's tables name drivers of this module
    from solen.bench.board import SerialBoard
    from solen.bench.rig import Rig


@dataclass(frozen=True)
class Driver:
    """How an instrument of a rig is opened.

    Attributes
    ----------
    role
        The table of the rig file that may name it.
    open
        Opens the instrument of a rig, with the clock that its waiting follows; raises `BenchError` where it cannot.
    needs
        Key of that table which the driver cannot do without: ``port``, ``device``, or none.
    """

    role: Literal["stage", "board", "daq"]
    open: "Callable[[Rig, Clock], Stage | EmitterBoard | Daq]"
    needs: str = ""


@contextmanager
def on_failure(undo: Callable[[], object]) -> Iterator[None]:
    """Undo what was begun where the body fails."""
    try:
        yield
    except BaseException:
        undo()
        raise


def _gcs2(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.gcs2 import Gcs2Stage
    from solen.bench.link import open_link

    table = rig.stage
    link = open_link(str(table.port), baud=table.baud)
    with on_failure(link.close):
        return Gcs2Stage(link, clock, stage=table.model, unit=table.unit, axis=table.axis, address=table.address)


def _grbl(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.grbl import GrblStage
    from solen.bench.link import open_link

    table = rig.stage
    link = open_link(str(table.port), baud=table.baud)
    with on_failure(link.close):
        axis = table.axis if "axis" in table.model_fields_set else "X"
        return GrblStage(link, clock, unit=table.moves_in, axis=axis)


def _marlin(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.link import open_link
    from solen.bench.marlin import MarlinStage

    table = rig.stage
    link = open_link(str(table.port), baud=table.baud)
    with on_failure(link.close):
        axis = table.axis if "axis" in table.model_fields_set else "X"
        return MarlinStage(link, clock, unit=table.moves_in, axis=axis)


def _zaber(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.link import open_link
    from solen.bench.zaber import ZaberStage

    table = rig.stage
    link = open_link(str(table.port), baud=table.baud)
    with on_failure(link.close):
        return ZaberStage(
            link,
            clock,
            steps_per_unit=table.steps_per_unit or 1.0,  # the rig has checked that it is stated
            unit=table.moves_in,
            axis=table.axis,
            address=table.address or 1,
        )


def _hand(rig: "Rig", clock: Clock) -> Stage:  # noqa: ARG001  a hand needs no clock
    from solen.bench.hand import HandStage

    return HandStage(rig.stage.moves_in)


def _motor(rig: "Rig", clock: Clock) -> Stage:
    from solen.bench.board import BoardStage

    table = rig.stage
    board = _serial(rig, clock)
    with on_failure(board.close):
        # the rig has checked that there is such a board, and that the steps are stated
        return BoardStage(board, clock, steps_per_unit=table.steps_per_unit or 1.0, unit=table.moves_in)


def _serial(rig: "Rig", clock: Clock) -> "SerialBoard":
    from solen.bench.board import SerialBoard
    from solen.bench.frames import Layout
    from solen.bench.link import open_link

    board = rig.board
    per_count = board.range_v / math.ldexp(1.0, board.bits)
    layout = Layout(rig.emitters, rig.inputs)
    link = open_link(str(board.port), baud=board.baud)
    with on_failure(link.close):
        return SerialBoard(link, clock, layout, period_s=1.0 / board.rate_hz, volts_per_count=per_count)


def _nidaqmx(rig: "Rig", clock: Clock) -> Daq:
    from solen.bench.nidaq import NiDaq

    if rig.daq is None or (setup := rig.setup) is None:
        raise BenchError("daq", limit="missing", remedy="add [daq] to the rig file")
    return NiDaq(clock, str(rig.daq.device), setup)


DRIVERS: registry.Registry[Driver] = registry.Registry(
    registry.INSTRUMENTS,
    {
        "gcs2": Driver("stage", _gcs2, needs="port"),
        "grbl": Driver("stage", _grbl, needs="port"),
        "hand": Driver("stage", _hand),
        "marlin": Driver("stage", _marlin, needs="port"),
        "board": Driver("stage", _motor),
        "zaber": Driver("stage", _zaber, needs="port"),
        "serial": Driver("board", _serial, needs="port"),
        "nidaqmx": Driver("daq", _nidaqmx, needs="device"),
    },
    Driver,
)
"""Drivers by name; ``simulated`` is none of them, as a simulated rig is made as a whole."""


def open_instruments(rig: "Rig", clock: Clock) -> tuple[Stage, EmitterBoard | Daq]:
    """Stage and sampler of a real rig; where the second cannot be opened, the first is closed.

    A stage that is the motor of the board brings the board with it.
    """
    stage = cast("Stage", DRIVERS[rig.stage.driver].open(rig, clock))  # the rig has checked the roles
    if (board := getattr(stage, "board", None)) is not None:
        return stage, board
    with on_failure(stage.close):
        return stage, cast("EmitterBoard | Daq", DRIVERS[rig.sampler.driver].open(rig, clock))

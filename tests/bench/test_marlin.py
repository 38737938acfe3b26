"""The driver of Marlin, with a scripted dialogue and with a simulated board, also over a socket."""

import math
import re
from dataclasses import dataclass, field

import pytest

from solen.bench.clock import Clock, SimulatedClock, WallClock
from solen.bench.drivers import DRIVERS
from solen.bench.homing import ensure_zero
from solen.bench.marlin import MarlinStage
from solen.bench.roles import HomingStage
from solen.bench.simulated.stage import Axis
from solen.errors import BenchError
from tests.bench.stage_support import Dialogue, rig_with, wait_for_arrival
from tests.bench.wire_support import Served, Wire


@dataclass
class MarlinBoard:
    """A simulated board, written from the G-code reference; its reply to M400 waits until the axis is at rest.

    Attributes
    ----------
    clock, axis
        Clock and axis.
    offset
        Position of the axis at the zero of the work coordinates.
    soft_limit
        Largest distance from zero; a move ends there.
    """

    clock: Clock
    axis: Axis = field(default_factory=lambda: Axis(100.0))
    offset: float = 0.0
    soft_limit: float = 180.0
    _waiting: bool = False
    _line: bytes = b""

    def reply(self, data: bytes) -> bytes:
        reply = b""
        for byte in data:
            self._line += bytes([byte])
            if byte == 10:
                line, self._line = self._line.decode().strip(), b""
                reply += self._execute(line)
        if self._waiting and not self.axis.moving(self.clock.now_s()):
            self._waiting = False
            reply += b"ok\n"
        return reply

    def _execute(self, line: str) -> bytes:
        now = self.clock.now_s()
        if line == "M115":
            return b"FIRMWARE_NAME:Marlin 2.1.2 (simulated) PROTOCOL_VERSION:1.0\nCap:EMERGENCY_PARSER:1\nok\n"
        if line == "M114":
            position = self.axis.at(now) - self.offset
            return f"X:{position:.2f} Y:0.00 Z:0.00 E:0.00 Count X:{round(80 * position)} Y:0 Z:0\nok\n".encode()
        if line == "M400":
            self._waiting = True
            return b""
        if line == "M410":
            self.axis.halt(now)
        elif define := re.match(r"G92 X(-?[\d.]+)", line):
            self.offset = self.axis.at(now) - float(define[1])
        elif move := re.match(r"G1 X(-?[\d.]+) F([\d.]+)", line):
            target = max(-self.soft_limit, min(self.soft_limit, float(move[1])))
            self.axis.send(now, target + self.offset, float(move[2]) / 60.0)
        elif line == "G28 X":
            self.axis, self.offset = Axis(100.0), 0.0
        elif line != "G90":
            return f'echo:Unknown command: "{line}"\nok\n'.encode()
        return b"ok\n"


def wired_stage() -> tuple[MarlinStage, MarlinBoard, SimulatedClock, Wire]:
    clock = SimulatedClock()
    board = MarlinBoard(clock)
    wire = Wire(board, clock)
    return MarlinStage(wire, clock), board, clock, wire


def test_dialogue_follows_reference() -> None:
    exchanges = [
        (b"M115\n", b"FIRMWARE_NAME:Marlin bugfix-2.1.x\nok\n"),
        (b"G90\n", b"ok\n"),
        (b"G92 X0.0000\n", b"ok P15 B3\n"),
        (b"G1 X-3.0000 F900.000\n", b"ok\n"),
        (b"M400\n", b"echo:busy: processing\nok\n"),
        (b"M114\n", b"X:-3.00 Y:0.00 Z:0.00 E:0.00 Count X:-240 Y:0 Z:0\nok\n"),
        (b"G1 X3.0000 F900.000\n", b"Error:Printer halted. kill() called!\n"),
        (b"M410\n", b"ok\n"),
    ]
    stage = MarlinStage(Dialogue(exchanges), SimulatedClock())
    ensure_zero(stage, "here", 0.0)
    stage.begin_move(-3.0, 15.0)
    assert stage.on_target()
    with pytest.raises(BenchError, match="kill"):
        stage.begin_move(3.0, 15.0)
    stage.close()


def test_refuses_board_that_cannot_stop() -> None:
    reply = b"FIRMWARE_NAME:Marlin 2.1.2\nCap:EMERGENCY_PARSER:0\nok\n"
    with pytest.raises(BenchError, match="EMERGENCY_PARSER"):
        MarlinStage(Dialogue([(b"M115\n", reply)]), SimulatedClock())


def test_position_is_known_only_at_rest() -> None:
    stage, board, clock, _ = wired_stage()
    homing_stage: HomingStage = stage
    with pytest.raises(BenchError, match="has no zero"):
        stage.begin_move(1.0, 15.0)
    board.axis.initial = 12.0
    ensure_zero(stage, "here", 0.5)
    assert (homing_stage.referenced, stage.position(), board.axis.moves) == (True, 0.5, [])
    stage.begin_move(3.5, 15.0)
    assert math.isnan(stage.position())
    assert wait_for_arrival(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 100.0, abs=0.02)
    assert stage.position() == 3.5
    stage.stop()
    assert stage.referenced  # it was at rest
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    position = board.axis.at(clock.now_s())
    clock.sleep(1.0)
    assert board.axis.at(clock.now_s()) == position
    assert not stage.referenced
    ensure_zero(stage, True, 0.0)
    board.soft_limit = 2.0
    stage.begin_move(3.0, 15.0)
    with pytest.raises(BenchError, match=r"stopped at 2 instead of 3; .*M211"):
        wait_for_arrival(stage, clock)


def test_rig_opens_stage() -> None:
    with Served(MarlinBoard(WallClock())) as served:
        stage = DRIVERS["marlin"].open(rig_with(driver="marlin", port=served.url, home="here"), WallClock())
        assert isinstance(stage, MarlinStage)
        stage.close()


def test_refuses_other_instruments() -> None:
    with pytest.raises(BenchError, match="not Marlin"):
        MarlinStage(Dialogue([(b"M115\n", b"FIRMWARE_NAME:Klipper\nok\n")]), SimulatedClock())
    _, _, clock, wire = wired_stage()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no reply within 2 s"):
        MarlinStage(wire, clock)
    with pytest.raises(BenchError, match="must be X, Y or Z"):
        MarlinStage(wire, clock, axis="E")

"""The driver of Marlin: by a written conversation, and against a simulated board, also behind a socket."""

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
from tests.bench.stage_support import Dialogue, wait_for_arrival, rig_with
from tests.bench.wire_support import Served, Wire


@dataclass
class MarlinBoard:
    """A board whose answer to M400 waits for its axis, written after the G-code reference."""

    clock: Clock
    axis: Axis = field(default_factory=lambda: Axis(100.0))
    shift: float = 0.0
    soft: float = 180.0
    _waits: bool = False
    _line: bytes = b""

    def answer(self, data: bytes) -> bytes:
        said = b""
        for byte in data:
            self._line += bytes([byte])
            if byte == 10:
                line, self._line = self._line.decode().strip(), b""
                said += self._obey(line)
        if self._waits and not self.axis.moving(self.clock.now_s()):
            self._waits = False
            said += b"ok\n"
        return said

    def _obey(self, line: str) -> bytes:
        now = self.clock.now_s()
        if line == "M115":
            return b"FIRMWARE_NAME:Marlin 2.1.2 (simulated) PROTOCOL_VERSION:1.0\nCap:EMERGENCY_PARSER:1\nok\n"
        if line == "M114":
            at = self.axis.at(now) - self.shift
            return f"X:{at:.2f} Y:0.00 Z:0.00 E:0.00 Count X:{round(80 * at)} Y:0 Z:0\nok\n".encode()
        if line == "M400":
            self._waits = True
            return b""
        if line == "M410":
            self.axis.halt(now)
        elif found := re.match(r"G92 X(-?[\d.]+)", line):
            self.shift = self.axis.at(now) - float(found[1])
        elif found := re.match(r"G1 X(-?[\d.]+) F([\d.]+)", line):
            to = max(-self.soft, min(self.soft, float(found[1])))
            self.axis.send(now, to + self.shift, float(found[2]) / 60.0)
        elif line == "G28 X":
            self.axis, self.shift = Axis(100.0), 0.0
        elif line != "G90":
            return f'echo:Unknown command: "{line}"\nok\n'.encode()
        return b"ok\n"


def driven() -> tuple[MarlinStage, MarlinBoard, SimulatedClock, Wire]:
    clock = SimulatedClock()
    board = MarlinBoard(clock)
    wire = Wire(board, clock)
    return MarlinStage(wire, clock), board, clock, wire


def test_what_is_said_is_the_reference_s() -> None:
    turns = [
        (b"M115\n", b"FIRMWARE_NAME:Marlin bugfix-2.1.x\nok\n"),
        (b"G90\n", b"ok\n"),
        (b"G92 X0.0000\n", b"ok P15 B3\n"),
        (b"G1 X-3.0000 F900.000\n", b"ok\n"),
        (b"M400\n", b"echo:busy: processing\nok\n"),
        (b"M114\n", b"X:-3.00 Y:0.00 Z:0.00 E:0.00 Count X:-240 Y:0 Z:0\nok\n"),
        (b"G1 X3.0000 F900.000\n", b"Error:Printer halted. kill() called!\n"),
        (b"M410\n", b"ok\n"),
    ]
    stage = MarlinStage(Dialogue(turns), SimulatedClock())
    ensure_zero(stage, "here", 0.0)
    stage.begin_move(-3.0, 15.0)
    assert stage.on_target()
    with pytest.raises(BenchError, match="kill"):
        stage.begin_move(3.0, 15.0)
    stage.close()


def test_a_board_that_could_not_stop_is_refused() -> None:
    said = b"FIRMWARE_NAME:Marlin 2.1.2\nCap:EMERGENCY_PARSER:0\nok\n"
    with pytest.raises(BenchError, match="EMERGENCY_PARSER"):
        MarlinStage(Dialogue([(b"M115\n", said)]), SimulatedClock())


def test_it_has_a_position_at_rest_only_and_stops() -> None:
    stage, board, clock, _ = driven()
    homes: HomingStage = stage
    with pytest.raises(BenchError, match="does not know its zero"):
        stage.begin_move(1.0, 15.0)
    board.axis.initial = 12.0
    ensure_zero(stage, "here", 0.5)
    assert (homes.referenced, stage.position(), board.axis.moves) == (True, 0.5, [])
    stage.begin_move(3.5, 15.0)
    assert math.isnan(stage.position())
    assert wait_for_arrival(stage, clock) == pytest.approx(3.0 / 15.0 + 15.0 / 100.0, abs=0.02)
    assert stage.position() == 3.5
    stage.stop()
    assert stage.referenced  # it stood
    stage.begin_move(-3.0, 15.0)
    clock.sleep(0.2)
    stage.stop()
    here = board.axis.at(clock.now_s())
    clock.sleep(1.0)
    assert board.axis.at(clock.now_s()) == here
    assert not stage.referenced
    ensure_zero(stage, True, 0.0)
    board.soft = 2.0
    stage.begin_move(3.0, 15.0)
    with pytest.raises(BenchError, match=r"rests at 2, but was sent to 3; .*M211"):
        wait_for_arrival(stage, clock)


def test_a_rig_opens_it_and_what_is_no_marlin_is_refused() -> None:
    with Served(MarlinBoard(WallClock())) as served:
        stage = DRIVERS["marlin"].open(rig_with(driver="marlin", port=served.url, home="here"), WallClock())
        assert isinstance(stage, MarlinStage)
        stage.close()
    with pytest.raises(BenchError, match="it is not Marlin"):
        MarlinStage(Dialogue([(b"M115\n", b"FIRMWARE_NAME:Klipper\nok\n")]), SimulatedClock())
    _, _, clock, wire = driven()
    wire.faults.deaf = True
    with pytest.raises(BenchError, match="no answer within 2 s"):
        MarlinStage(wire, clock)
    with pytest.raises(BenchError, match="must be X, Y or Z"):
        MarlinStage(wire, clock, axis="E")

"""A GRBL 1.1 controller with a simulated axis, written from the GRBL wiki."""

import re
from dataclasses import dataclass, field

from solen.bench.clock import Clock
from solen.bench.simulated.stage import Axis

JOG = re.compile(r"\$J=G21 G90 G53 X(-?[\d.]+) F([\d.]+)$")


@dataclass
class GrblController:
    """A simulated controller.

    Attributes
    ----------
    clock
        Clock of the axis.
    homing
        Whether it has a switch, and is locked until it has been homed.
    steps
        Steps per unit; reported positions are multiples of a step.
    rate
        Highest velocity, in units per minute.
    moved
        Jog commands that it has executed.
    """

    clock: Clock
    homing: bool = False
    steps: float = 250.0
    rate: float = 1800.0
    locked: bool = False
    alarm: str = ""
    axis: Axis = field(default_factory=lambda: Axis(100.0, 0.0))
    moved: list[str] = field(default_factory=list)
    _unsolicited: bytes = b"\r\nGrbl 1.1h ['$' for help]\r\n"
    _line: bytes = b""
    _homed_s: float | None = None

    def __post_init__(self) -> None:
        self.locked = self.homing

    def reply(self, data: bytes) -> bytes:
        """Return the reply to some bytes; ``?`` and 85h are removed from the stream and executed at once."""
        reply, self._unsolicited = self._unsolicited, b""
        for byte in data:
            if byte == ord("?"):
                reply += self._status()
            elif byte == 0x85:
                self.axis.halt(self.clock.now_s())
            elif byte == 10:
                line, self._line = self._line, b""
                reply += self._execute(line.decode())
            else:
                self._line += bytes([byte])
        if self._homed_s is not None and self.clock.now_s() >= self._homed_s:
            self._homed_s, self.locked, self.axis = None, False, Axis(100.0, -1.0)
            reply += b"ok\r\n"
        return reply

    def _status(self) -> bytes:
        now = self.clock.now_s()
        position = round(self.axis.at(now) * self.steps) / self.steps
        state = "Alarm" if self.locked else "Jog" if self.axis.moving(now) else "Idle"
        return f"<{state}|MPos:{position:.3f},0.000,0.000|FS:0,0>\r\n".encode()

    def _execute(self, line: str) -> bytes:
        if line == "$I":
            return b"[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"
        if line == "$$":
            values = {10: 1, 22: int(self.homing), 100: self.steps, 110: self.rate, 130: 200.0}
            return "".join(f"${number}={value}\r\n" for number, value in values.items()).encode() + b"ok\r\n"
        if line == "$X":
            self.locked = False
            return b"[MSG:Caution: Unlocked]\r\nok\r\n"
        if line == "$H":
            if not self.homing:
                return b"error:5\r\n"
            self._homed_s = self.clock.now_s() + 2.5
            return b""
        if (jog := JOG.match(line)) and not self.locked:
            self.moved.append(line)
            self.axis.send(self.clock.now_s(), float(jog[1]), min(float(jog[2]), self.rate) / 60.0)
            return b"ok\r\n"
        return b"error:9\r\n" if jog else b"error:3\r\n"

"""A device with the Zaber ASCII protocol and a simulated axis, written from the protocol manual."""

from dataclasses import dataclass, field

from solen.bench.clock import Clock
from solen.bench.simulated.stage import Axis


@dataclass
class ZaberDevice:
    """A simulated device with one axis, whose position is in microsteps.

    Attributes
    ----------
    clock
        Clock of the axis.
    highest
        Highest ``maxspeed`` that it accepts.
    warning
        Its warning: ``WR`` until it is homed or its position is set.
    alert
        Unsolicited line that it sends before the next reply.
    """

    clock: Clock
    highest: int = 500_000
    warning: str = "WR"
    axis: Axis = field(default_factory=lambda: Axis(1e6, 4_000.0))
    maxspeed: int = 100_000
    alert: bytes = b""
    _line: bytes = b""

    def reply(self, data: bytes) -> bytes:
        reply = b""
        for byte in data:
            self._line += bytes([byte])
            if byte == 10:
                line, self._line = self._line.decode().strip(), b""
                reply += self.alert + self._reply_line(line)
                self.alert = b""
        return reply

    def _reply_line(self, line: str) -> bytes:
        head, axis, *words = line.split()
        if (head, axis) != ("/1", "1"):
            return b""
        now = self.clock.now_s()
        data = self._execute(words, now)
        flag = "RJ" if data.startswith("BAD") else "OK"
        state = "BUSY" if self.axis.moving(now) else "IDLE"
        return f"@01 1 {flag} {state} {self.warning} {data}\r\n".encode()

    def _execute(self, words: list[str], now: float) -> str:
        match words:
            case ["get", "pos"]:
                return str(round(self.axis.at(now)))
            case ["get", "limit.min"]:
                return "-200000"
            case ["get", "limit.max"]:
                return "200000"
            case ["set", "pos", value]:
                self.axis, self.warning = Axis(1e6, float(value)), "--"
            case ["set", "maxspeed", value]:
                if int(value) > self.highest:
                    return "BADDATA"
                self.maxspeed = int(value)
            case ["home"]:
                self.axis.send(now, 0.0, 20_000.0)
                self.warning = "--"
            case ["move", "abs", value]:
                if abs(int(value)) > 200_000:
                    return "BADDATA"
                self.axis.send(now, float(value), self.maxspeed / 1.6384)
            case ["stop"]:
                self.axis.halt(now)
            case _:
                return "BADCOMMAND"
        return "0"

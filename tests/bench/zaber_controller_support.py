"""A device that speaks the Zaber ASCII protocol and has a simulated axis, written after its manual."""

from dataclasses import dataclass, field

from solen.bench.clock import Clock
from solen.bench.simulated.stage import Axis


@dataclass
class ZaberDevice:
    """A simulated device with one axis; its axis is in microsteps.

    Attributes
    ----------
    clock
        Whose time the axis moves by.
    highest
        Highest ``maxspeed`` that it takes.
    warning
        What it warns of: ``WR`` until it is homed or given a position.
    """

    clock: Clock
    highest: int = 500_000
    warning: str = "WR"
    axis: Axis = field(default_factory=lambda: Axis(1e6, 4_000.0))
    maxspeed: int = 100_000
    alert: bytes = b""
    _line: bytes = b""

    def answer(self, data: bytes) -> bytes:
        """What it says to bytes that came."""
        said = b""
        for byte in data:
            self._line += bytes([byte])
            if byte == 10:
                line, self._line = self._line.decode().strip(), b""
                said += self.alert + self._obey(line)
                self.alert = b""
        return said

    def _obey(self, line: str) -> bytes:
        head, axis, *words = line.split()
        if (head, axis) != ("/1", "1"):
            return b""
        now = self.clock.now_s()
        answer = self._does(words, now)
        taken = "RJ" if answer.startswith("BAD") else "OK"
        state = "BUSY" if self.axis.moving(now) else "IDLE"
        return f"@01 1 {taken} {state} {self.warning} {answer}\r\n".encode()

    def _does(self, words: list[str], now: float) -> str:
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

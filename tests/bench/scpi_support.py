"""Multimeters and oscilloscopes that speak SCPI, simulated, written after SCPI-1999 and programming guides."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from solen.bench.clock import Clock
from tests.bench.wire_support import Served

OVERLOAD = "+9.90000000E+37"


def address_of(served: Served) -> str:
    """VISA's name of what is served."""
    host, port = served.url.removeprefix("socket://").split(":")
    return f"TCPIP::{host}::{port}::SOCKET"


@dataclass
class ScpiDevice:
    """What answers lines.

    Attributes
    ----------
    maker
        As it states itself.
    said
        Lines that came.
    errors
        Codes and words that the next ``SYST:ERR?`` are answered with.
    """

    maker: str = "SIMULATED"
    said: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    _line: bytes = b""

    def answer(self, data: bytes) -> bytes:
        self._line += data
        answers = b""
        while b"\n" in self._line:
            line, _, self._line = self._line.partition(b"\n")
            self.said.append(line.decode())
            for one in line.decode().split(";"):
                answers += self._obey(one)
        return answers

    def _obey(self, line: str) -> bytes:
        if line == "*IDN?":
            return f"{self.maker},a model,a number,1.0\n".encode()
        if line == "SYST:ERR?":
            return (self.errors.pop(0) if self.errors else '+0,"No error"').encode() + b"\n"
        if not line.endswith("?"):
            return b""
        found = self.ask(line)
        return found if isinstance(found, bytes) else f"{found}\n".encode()

    def ask(self, line: str) -> str | bytes:
        raise NotImplementedError


@dataclass
class Multimeter(ScpiDevice):
    """One that reads what a function of no argument gives; beyond its range it says so."""

    reads: Callable[[], float] = lambda: 0.0
    highest: float = 10.0

    def ask(self, line: str) -> str:
        if line not in {"READ?", "MEAS:VOLT:DC?"}:
            return "what?"
        value = self.reads()
        return f"{value:+.8E}" if abs(value) <= self.highest else OVERLOAD


@dataclass
class Scope(ScpiDevice):
    """One whose record is of functions of time, a channel each, sampled when it was told to.

    Attributes
    ----------
    clock
        Of the run.
    waves
        Volts of each channel at times.
    step_s, points
        Of a record.
    low, high
        Ends of the screen.
    short
        By how many points the record of channel 2 is shorter.
    arming
        So many questions it answers by its last state when it was told to wait for a trigger.
    """

    clock: Clock = None  # type: ignore[assignment]  # it is always given
    waves: dict[str, Callable[[np.ndarray], np.ndarray]] = field(default_factory=dict)
    step_s: float = 50e-6
    points: int = 1200
    low: float = 0.0
    high: float = 5.0
    short: int = 0
    arming: int = 0
    _late: int = 0
    _armed: bool = False
    _taken_s: float = 0.0
    _channel: str = ""

    def _obey(self, line: str) -> bytes:
        if line == ":SING":
            self._armed, self._late = True, self.arming
        if line.startswith(":DIG") or (line == ":TFOR" and self._armed and not self._late):
            self._taken_s = self.clock.now_s()
        if line in {":STOP", ":TFOR"} and not self._late:
            self._armed = False
        if line.startswith(":WAV:SOUR CHAN"):
            self._channel = line.removeprefix(":WAV:SOUR CHAN")
        return super()._obey(line)

    def ask(self, line: str) -> str | bytes:
        rigol = self.maker.startswith("RIGOL")
        step_V = (self.high - self.low) / 253.0
        match line:
            case "*OPC?":
                return "1"
            case ":TRIG:STAT?":
                last, self._late = self._late > 0, max(0, self._late - 1)
                return "WAIT" if self._armed and not last else "STOP"
            case ":WAV:PRE?":
                # Rigol: volts = (byte - origin - reference) * step; Keysight: (byte - reference) * step + origin
                origin, reference = (2.0 - self.low / step_V - 128.0, 128.0) if rigol else (self.low, 2.0)
                return f"0,0,{self.points},1,{self.step_s:.6e},0.0,0,{step_V:.8e},{origin:.8e},{reference:g}"
            case ":WAV:DATA?":
                points = self.points - (self.short if self._channel == "2" else 0)
                time_s = self._taken_s + self.step_s * np.arange(points)
                volts = self.waves[self._channel](time_s)
                data = np.clip(np.rint((volts - self.low) / step_V + 2.0), 1, 255).astype(np.uint8).tobytes()
                return f"#8{len(data):08d}".encode() + data + b"\n"
        return "what?"

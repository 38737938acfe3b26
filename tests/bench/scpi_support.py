"""Simulated multimeters and oscilloscopes with SCPI, written from SCPI-1999 and programming guides."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from solen.bench.clock import Clock
from tests.bench.wire_support import Served

OVERLOAD = "+9.90000000E+37"


def address_of(served: Served) -> str:
    """Return the VISA address of a served instrument."""
    host, port = served.url.removeprefix("socket://").split(":")
    return f"TCPIP::{host}::{port}::SOCKET"


@dataclass
class ScpiDevice:
    """An instrument that executes lines.

    Attributes
    ----------
    manufacturer
        Name of the manufacturer that it reports.
    lines
        Lines that it has received.
    errors
        Replies to the next ``SYST:ERR?`` queries.
    """

    manufacturer: str = "SIMULATED"
    lines: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    _received: bytes = b""

    def reply(self, data: bytes) -> bytes:
        self._received += data
        reply = b""
        while b"\n" in self._received:
            line, _, self._received = self._received.partition(b"\n")
            self.lines.append(line.decode())
            for command in line.decode().split(";"):
                reply += self.execute(command)
        return reply

    def execute(self, command: str) -> bytes:
        if command == "*IDN?":
            return f"{self.manufacturer},a model,a number,1.0\n".encode()
        if command == "SYST:ERR?":
            return (self.errors.pop(0) if self.errors else '+0,"No error"').encode() + b"\n"
        if not command.endswith("?"):
            return b""
        reply = self.query(command)
        return reply if isinstance(reply, bytes) else f"{reply}\n".encode()

    def query(self, query: str) -> str | bytes:
        raise NotImplementedError


@dataclass
class Multimeter(ScpiDevice):
    """A multimeter that reads the value of a function.

    Attributes
    ----------
    volts, range_V
        The function, and the range beyond which it reports an overload.
    duration_s
        Duration of a reading in real time.
    """

    volts: Callable[[], float] = lambda: 0.0
    range_V: float = 10.0
    duration_s: float = 0.0

    def query(self, query: str) -> str:
        if query not in {"READ?", "MEAS:VOLT:DC?"}:
            return "what?"
        time.sleep(self.duration_s)
        value = self.volts()
        return f"{value:+.8E}" if abs(value) <= self.range_V else OVERLOAD


@dataclass
class Scope(ScpiDevice):
    """An oscilloscope whose channels record functions of time.

    Attributes
    ----------
    clock
        Clock of the run.
    waves
        Voltage of each channel as a function of time, keyed by channel.
    step_s, points
        Sampling interval and length of a record.
    low, high
        Voltages at the bottom and the top of the screen.
    missing_points
        Number of points by which the record of channel 2 is shorter.
    arming
        Number of queries of its state to which it replies with the last state after it was armed.
    duration_s
        Duration of an acquisition in real time.
    """

    clock: Clock = None  # type: ignore[assignment]  # always given
    waves: dict[str, Callable[[np.ndarray], np.ndarray]] = field(default_factory=dict)
    step_s: float = 50e-6
    points: int = 1200
    low: float = 0.0
    high: float = 5.0
    missing_points: int = 0
    arming: int = 0
    duration_s: float = 0.0
    _remaining_arming: int = 0
    _armed: bool = False
    _record_s: float = 0.0
    _channel: str = ""

    def execute(self, command: str) -> bytes:
        if command == ":SING":
            self._armed, self._remaining_arming = True, self.arming
        if command.startswith(":DIG") or (command == ":TFOR" and self._armed and not self._remaining_arming):
            self._record_s = self.clock.now_s()
            time.sleep(self.duration_s)
        if command in {":STOP", ":TFOR"} and not self._remaining_arming:
            self._armed = False
        if command.startswith(":WAV:SOUR CHAN"):
            self._channel = command.removeprefix(":WAV:SOUR CHAN")
        return super().execute(command)

    def query(self, query: str) -> str | bytes:
        rigol = self.manufacturer.startswith("RIGOL")
        step_V = (self.high - self.low) / 253.0
        match query:
            case "*OPC?":
                return "1"
            case ":TRIG:STAT?":
                arming, self._remaining_arming = self._remaining_arming > 0, max(0, self._remaining_arming - 1)
                return "WAIT" if self._armed and not arming else "STOP"
            case ":WAV:PRE?":
                # Rigol: volts = (byte - origin - reference) * step; Keysight: (byte - reference) * step + origin
                origin, reference = (2.0 - self.low / step_V - 128.0, 128.0) if rigol else (self.low, 2.0)
                return f"0,0,{self.points},1,{self.step_s:.6e},0.0,0,{step_V:.8e},{origin:.8e},{reference:g}"
            case ":WAV:DATA?":
                points = self.points - (self.missing_points if self._channel == "2" else 0)
                time_s = self._record_s + self.step_s * np.arange(points)
                volts = self.waves[self._channel](time_s)
                data = np.clip(np.rint((volts - self.low) / step_V + 2.0), 1, 255).astype(np.uint8).tobytes()
                return f"#8{len(data):08d}".encode() + data + b"\n"
        return "what?"

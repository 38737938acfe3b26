"""A controller that speaks Thorlabs' APT protocol and has a simulated axis, written after the protocol's document."""

import struct
from dataclasses import dataclass, field

from solen.bench.clock import Clock
from solen.bench.simulated.stage import Axis

HEADER = struct.Struct("<HBBBB")


def said(number: int, data: bytes = b"", first: int = 0, second: int = 0) -> bytes:
    """A message of the controller."""
    if not data:
        return HEADER.pack(number, first, second, 0x01, 0x50)
    return HEADER.pack(number, len(data) % 256, len(data) // 256, 0x81, 0x50) + data


@dataclass
class KinesisController:
    """A simulated controller with one axis; its axis is in counts.

    Attributes
    ----------
    clock
        Whose time the axis moves by.
    model, scale
        What it says it is, and its value of a velocity for one count per second.
    per_unit
        Counts per degree.
    highest
        Highest velocity that it takes, in degrees per second.
    bits
        Of its status, beside those of motion: enabled, homed, faults.
    backlash
        How far a move to lower positions passes its target, in counts, until told otherwise.
    """

    clock: Clock
    model: bytes = b"KDC101"
    scale: float = 65536 * 2048 / 6e6
    per_unit: float = 1919.6418578623391
    highest: float = 25.0
    bits: int = 0
    backlash: int = 1920
    stuck: bool = False
    axis: Axis = field(init=False)
    unasked: bytes = b""
    _velocity: tuple[int, int, int] = (0, 123, 1000)
    _homing: bool = False
    _coming: bytes = b""

    def __post_init__(self) -> None:
        self.axis = Axis(200.0 * self.per_unit, 37.0 * self.per_unit)

    def answer(self, data: bytes) -> bytes:
        """What it says to bytes that came."""
        self._coming += data
        answer, self.unasked = self.unasked, b""
        while len(self._coming) >= HEADER.size:
            number, first, second, to, _ = HEADER.unpack_from(self._coming)
            whole = HEADER.size + (first + 256 * second if to & 0x80 else 0)
            if len(self._coming) < whole:
                break
            body, self._coming = self._coming[HEADER.size : whole], self._coming[whole:]
            answer += self._obey(number, first, second, body)
        return answer

    def _obey(self, number: int, first: int, second: int, data: bytes) -> bytes:
        now = self.clock.now_s()
        match number:
            case 0x0005:
                return said(0x0006, struct.pack("<I8s72x", 27_000_001, self.model))
            case 0x0210:
                self.bits = self.bits & 0x7FFF_FFFF | (0x8000_0000 if second == 1 else 0)
            case 0x0413:
                _, low, ramp, top = struct.unpack("<Hiii", data)
                self._velocity = (low, ramp, min(top, round(self.highest * self.per_unit * self.scale)))
            case 0x0414:
                return said(0x0415, struct.pack("<Hiii", 1, *self._velocity))
            case 0x043A:
                self.backlash = struct.unpack("<Hi", data)[1]
            case 0x0443:
                self._homing = True
                self.axis.send(now, 0.0, 10.0 * self.per_unit)
            case 0x0453:
                self._move(now, struct.unpack("<Hi", data)[1])
            case 0x0465:
                assert (first, second) == (1, 2)
                self._homing = False
                self.axis.halt(now)
            case 0x0480 | 0x0490:
                return said(number + 1, self._status(now))
        return b""

    def _move(self, now: float, to: int) -> None:
        if self.stuck or not self.bits & 0x8000_0000:
            return
        if to < self.axis.at(now):
            to -= self.backlash
        self.axis.send(now, float(to), self._velocity[2] / self.scale)

    def _status(self, now: float) -> bytes:
        moving = self.axis.moving(now)
        if self._homing and not moving:
            self._homing, self.bits = False, self.bits | 0x400
        bits = self.bits | (0x10 if moving else 0) | (0x200 if self._homing else 0)
        return struct.pack("<HihhI", 1, round(self.axis.at(now)), 0, 0, bits)

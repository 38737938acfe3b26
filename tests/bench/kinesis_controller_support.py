"""A controller with Thorlabs' APT protocol and a simulated axis, written from the protocol specification."""

import struct
from dataclasses import dataclass, field

from solen.bench.clock import Clock
from solen.bench.simulated.stage import Axis

HEADER = struct.Struct("<HBBBB")


def message(number: int, data: bytes = b"", first: int = 0, second: int = 0) -> bytes:
    """Return a message from the controller."""
    if not data:
        return HEADER.pack(number, first, second, 0x01, 0x50)
    return HEADER.pack(number, len(data) % 256, len(data) // 256, 0x81, 0x50) + data


@dataclass
class KinesisController:
    """A simulated controller with one axis, whose position is in counts.

    Attributes
    ----------
    clock
        Clock of the axis.
    model, scale
        Model that it reports, and velocity value of one count per second.
    per_unit
        Counts per degree.
    highest
        Highest velocity that it accepts, in degrees per second.
    bits
        Status bits other than those of motion: enabled, homed, faults.
    backlash
        Distance in counts by which moves to lower positions overshoot; the correction can be switched off.
    unsolicited
        Messages that it sends before the next reply.
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
    unsolicited: bytes = b""
    _velocity: tuple[int, int, int] = (0, 123, 1000)
    _homing: bool = False
    _received: bytes = b""

    def __post_init__(self) -> None:
        self.axis = Axis(200.0 * self.per_unit, 37.0 * self.per_unit)

    def reply(self, data: bytes) -> bytes:
        self._received += data
        reply, self.unsolicited = self.unsolicited, b""
        while len(self._received) >= HEADER.size:
            number, first, second, destination, _ = HEADER.unpack_from(self._received)
            length = HEADER.size + (first + 256 * second if destination & 0x80 else 0)
            if len(self._received) < length:
                break
            body, self._received = self._received[HEADER.size : length], self._received[length:]
            reply += self._execute(number, first, second, body)
        return reply

    def _execute(self, number: int, first: int, second: int, data: bytes) -> bytes:
        now = self.clock.now_s()
        match number:
            case 0x0005:
                return message(0x0006, struct.pack("<I8s72x", 27_000_001, self.model))
            case 0x0210:
                self.bits = self.bits & 0x7FFF_FFFF | (0x8000_0000 if second == 1 else 0)
            case 0x0413:
                _, low, ramp, top = struct.unpack("<Hiii", data)
                self._velocity = (low, ramp, min(top, round(self.highest * self.per_unit * self.scale)))
            case 0x0414:
                return message(0x0415, struct.pack("<Hiii", 1, *self._velocity))
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
                return message(number + 1, self._status(now))
        return b""

    def _move(self, now: float, target: int) -> None:
        if self.stuck or not self.bits & 0x8000_0000:
            return
        if target < self.axis.at(now):
            target -= self.backlash
        self.axis.send(now, float(target), self._velocity[2] / self.scale)

    def _status(self, now: float) -> bytes:
        moving = self.axis.moving(now)
        if self._homing and not moving:
            self._homing, self.bits = False, self.bits | 0x400
        bits = self.bits | (0x10 if moving else 0) | (0x200 if self._homing else 0)
        return struct.pack("<HihhI", 1, round(self.axis.at(now)), 0, 0, bits)

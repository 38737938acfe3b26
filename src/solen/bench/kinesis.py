"""Motorised Thorlabs stages with the APT protocol: one axis of a K-Cube, a T-Cube or an integrated controller.

Messages are binary. Six bytes contain the message number, two parameters or the length of the data that follow, the
destination and the source. Some messages are queries. Unsolicited messages from the controller, for example that a move
has ended, are ignored; the status is queried instead. Positions are encoder counts of the stage or microsteps of its
motor; velocities are counts per second multiplied by a factor that depends on the kind of controller, which reports its
model. Messages, factors and counts per degree or mm: Thorlabs Motion Controllers, Host-Controller Communications
Protocol, sections 3 and 8.

A move with backlash correction would overshoot its target and return; this correction is disabled while the stage is
driven, and the recording shows the backlash.

Public name: `KinesisStage`.
"""

import struct
from typing import Any, Literal

from solen.bench.clock import Clock
from solen.bench.line_stage import LineStage
from solen.bench.link import Link
from solen.errors import BenchError

USB, HOST = 0x50, 0x01
INFO, ENABLE, NO_UPDATES = 0x0005, 0x0210, 0x0012
SET_VELOCITY, ASK_VELOCITY, SET_BACKLASH = 0x0413, 0x0414, 0x043A
HOME, MOVE, STOP = 0x0443, 0x0453, 0x0465
ASK_STATUS, ASK_SERVO_STATUS = 0x0480, 0x0490
BAD, BAD_WITH_WORDS = 0x0080, 0x0081
PROFILED = 2
"""Stop mode with deceleration."""
_HEADER, _INFO, _STATUS = struct.Struct("<HBBBB"), struct.Struct("<I8s72s"), struct.Struct("<Hi4xI")
_VELOCITY, _POSITION = struct.Struct("<Hiii"), struct.Struct("<Hi")

MOVING, HOMING, HOMED = 0xF0, 0x200, 0x400
FAULTS = {
    0x4000: "motion error: it does not follow, or cannot move",
    0x2_0000: "it is overheated",
    0x4_0000: "its supply voltage is out of range",
    0x8_0000: "commutation error",
    0x100_0000: "its current is at the limit",
}
"""Meanings of the status bits that end a move."""

SERVO, BRUSHLESS, STEPPER = 65536 * 2048 / 6e6, 65536 * 102.4e-6, 53.68
"""Velocity value for one count per second: 65536 times the servo period; for a stepper, as specified in the
protocol.
"""
CONTROLLERS = {
    "TDC001": SERVO,
    "KDC101": SERVO,
    "TBD001": BRUSHLESS,
    "KBD101": BRUSHLESS,
    "KST101": STEPPER,
    "K10CR1": STEPPER,
    "LTS150": STEPPER,
    "LTS300": STEPPER,
}
"""Controllers with a known factor, by the beginning of the model name that they report."""
BEGINS_S = 0.25
"""Time in s after a command during which the move may not have begun yet."""
NEAR = 0.01
"""Largest distance in deg or mm from its target at which a servo may rest."""
CLOSE = 2.0
"""Distance in counts from the target within which a move has ended even if nothing shows that it began."""


def message_of(data: bytes) -> tuple[bytes, bytes] | None:
    """Return the first complete message, and the remaining bytes."""
    if len(data) < _HEADER.size:
        return None
    _, low, high, to, _ = _HEADER.unpack_from(data)
    whole = _HEADER.size + (low + 256 * high if to & 0x80 else 0)
    return (data[:whole], data[whole:]) if len(data) >= whole else None


class KinesisStage(LineStage):
    """One stage.

    Parameters
    ----------
    link, clock
        Line to the controller, and the clock that time-outs follow.
    counts_per_unit
        Counts of its encoder, or microsteps, per deg or mm, by the protocol's section 8.
    unit
        Unit of its positions.
    answer_s, home_s
        Longest duration of an answer, and of homing.

    Raises
    ------
    BenchError
        If the controller does not answer, is not one of `CONTROLLERS`, rejects a command, or reports a fault.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        counts_per_unit: float,
        unit: Literal["deg", "mm"] = "deg",
        answer_s: float = 1.0,
        home_s: float = 120.0,
    ) -> None:
        super().__init__(f"Thorlabs stage at {link.name}", link, clock, answer_s, message_of)
        self.unit: Literal["deg", "mm"] = unit
        self._per_unit, self._home_s = counts_per_unit, home_s
        self._zero: float | None = None
        self._target, self._begun_s = 0, 0.0
        self._lines.forget()
        self._tell(NO_UPDATES)
        serial, model, _ = self._asked(_INFO, INFO)
        self.identity = f"{model.split(bytes(1))[0].decode('ascii', 'replace')} {serial}"
        known = [name for name in CONTROLLERS if self.identity.startswith(name)]
        if not known:
            raise self._refusal(f"is a {self.identity}; supported are {', '.join(CONTROLLERS)}", "use one of these")
        self._scale = CONTROLLERS[known[0]]
        self._tell(ENABLE, 1, 1)
        self._tell(SET_BACKLASH, data=_POSITION.pack(1, 0))

    @property
    def referenced(self) -> bool:
        """Whether the stage was homed since it was switched on, or its zero set since it was connected."""
        return self._zero is not None or bool(self._status()[1] & HOMED)

    @property
    def search(self) -> str:
        """Range of the move that finds the zero."""
        far = "by up to 360 deg" if self.unit == "deg" else "over an unknown distance"
        return f"It moves to its home switch, {far}."

    def reference(self) -> None:
        """Move to the home switch, unless the zero is known."""
        if self.referenced:
            return
        self._tell(HOME, 1)
        self._come_home(self._homed, self._home_s)

    def set_position(self, position: float) -> None:
        """Define the current position as a given value, until the line is closed; nothing moves."""
        self._zero = self._status()[0] - position * self._per_unit

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        self._set_velocity(velocity)
        self._target = round(target * self._per_unit + (self._zero or 0.0))
        self._begun_s = self._clock.now_s()
        self._tell(MOVE, data=_POSITION.pack(1, self._whole(self._target)))

    def position(self) -> float:
        """Return the position in deg or mm: from the encoder, or for a stepper from the steps that were sent to it."""
        return (self._status()[0] - (self._zero or 0.0)) / self._per_unit

    def on_target(self) -> bool:
        """Whether the stage has come to rest at its target.

        Raises `BenchError` if it rests elsewhere or reports a fault.
        """
        at, bits = self._status()
        self._check(bits)
        if bits & (MOVING | HOMING):
            return False
        away = (at - self._target) / self._per_unit
        begun = self._clock.now_s() > self._begun_s + BEGINS_S
        if abs(away) <= max(NEAR if begun else 0.0, CLOSE / self._per_unit):
            return True
        if begun:
            raise self._refusal(
                f"rests {away:g} {self.unit} from its target", "check whether a limit switch stopped it"
            )
        return False

    def stop(self) -> None:
        """Stop with the stage's deceleration."""
        self._cut_in(_HEADER.pack(STOP, 1, PROFILED, USB, HOST))
        self._tell(STOP, 1, PROFILED)
        self._come_to_rest(lambda: not self._status()[1] & (MOVING | HOMING))

    def _set_velocity(self, velocity: float) -> None:
        """Set a velocity at the present acceleration; raise `BenchError` if the controller rejects it."""
        value = self._whole(round(self._scale * velocity * self._per_unit))
        _, lowest, acceleration, now = self._asked(_VELOCITY, ASK_VELOCITY)
        if value == now:
            return
        self._tell(SET_VELOCITY, data=_VELOCITY.pack(1, lowest, acceleration, value))
        taken = self._asked(_VELOCITY, ASK_VELOCITY)[3]
        if abs(taken - value) > 1e-3 * value:
            highest = taken / (self._scale * self._per_unit)
            raise self._refusal(
                f"sets {highest:g} {self.unit}/s instead of {velocity:g} {self.unit}/s", "move more slowly"
            )

    def _whole(self, value: int) -> int:
        if abs(value) >= 1 << 31:
            raise self._refusal(f"{value} does not fit in 32 bits", "check steps_per_unit in [stage]")
        return value

    def _homed(self) -> bool:
        _, bits = self._status()
        self._check(bits)
        return bool(bits & HOMED) and not bits & (MOVING | HOMING)

    def _status(self) -> tuple[int, int]:
        """Return the position in counts, and the status bits."""
        question = ASK_STATUS if self._scale == STEPPER else ASK_SERVO_STATUS
        _, at, bits = self._asked(_STATUS, question)
        return at, bits

    def _check(self, bits: int) -> None:
        for bit, meaning in FAULTS.items():
            if bits & bit:
                raise self._refusal(meaning, "check that it is free to move; switch its controller off and on")

    def _tell(self, what: int, first: int = 0, second: int = 0, *, data: bytes = b"") -> None:
        to = USB
        if data:
            (first, second), to = divmod(len(data), 256)[::-1], USB | 0x80
        self._send(_HEADER.pack(what, first, second, to, HOST) + data)

    def _asked(self, values: struct.Struct, question: int) -> tuple[Any, ...]:
        """Return the values of the answer, whose message number is the question's plus one.

        Unsolicited messages are ignored.
        """
        self._tell(question, 0 if question == INFO else 1)
        data = self._answer(question + 1)
        if len(data) != values.size:
            raise self._refusal(
                f"answered {len(data)} bytes instead of {values.size}", "check that its firmware is up to date"
            )
        return values.unpack(data)

    def _answer(self, expected: int) -> bytes:
        while True:
            answer = self._lines.next_bytes()
            number, _, _, _, who = _HEADER.unpack_from(answer)
            if number == expected and who == USB:
                self._lines.owed = False
                return answer[_HEADER.size :]
            if number in {BAD, BAD_WITH_WORDS} or who != USB:
                raise self._complaint(number, answer)

    def _complaint(self, number: int, said: bytes) -> BenchError:
        if number not in {BAD, BAD_WITH_WORDS}:
            return self._refusal(f"sent {said[:20]!r}, which is not APT", "check that it is the right port")
        words = said[_HEADER.size + 4 :].split(bytes(1))[0].decode("ascii", "replace")
        return self._refusal(f"reports an error: {words or 'without description'}", "see its manual")

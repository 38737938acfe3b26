"""Motorised Thorlabs stages with the APT protocol: one axis of a K-Cube, a T-Cube or an integrated controller.

Messages are binary. A header of six bytes contains the message number, two parameters or the length of the data that
follow, the destination and the source. Unsolicited messages from the controller, for example that a move has ended, are
ignored; the status is queried instead. Positions are encoder counts of the stage or microsteps of its motor; velocities
are counts per second multiplied by a factor that depends on the model of the controller. Messages, factors and counts
per degree or mm: Thorlabs Motion Controllers, Host-Controller Communications Protocol, sections 3 and 8.

With backlash correction, a move would overshoot its target and return. The correction is therefore disabled, and the
backlash of the stage remains in the recording.

Public name: `KinesisStage`.
"""

import struct
from typing import Any, Literal

from solen.bench.clock import Clock
from solen.bench.line_stage import LineStage
from solen.bench.link import Link

USB, HOST = 0x50, 0x01
INFO, ENABLE, NO_UPDATES = 0x0005, 0x0210, 0x0012
SET_VELOCITY, GET_VELOCITY, SET_BACKLASH = 0x0413, 0x0414, 0x043A
HOME, MOVE, STOP = 0x0443, 0x0453, 0x0465
GET_STATUS, GET_SERVO_STATUS = 0x0480, 0x0490
ERROR, ERROR_WITH_TEXT = 0x0080, 0x0081
PROFILED = 2
"""Stop mode with deceleration."""
_HEADER, _INFO, _STATUS = struct.Struct("<HBBBB"), struct.Struct("<I8s72s"), struct.Struct("<Hi4xI")
_VELOCITY, _POSITION = struct.Struct("<Hiii"), struct.Struct("<Hi")

MOVING, HOMING, HOMED = 0xF0, 0x200, 0x400
FAULTS = {
    0x4000: "motion error: the stage does not follow, or cannot move",
    0x2_0000: "the controller is overheated",
    0x4_0000: "the supply voltage is out of range",
    0x8_0000: "commutation error",
    0x100_0000: "the motor current is at its limit",
}
"""Meanings of the status bits that end a move."""

SERVO, BRUSHLESS, STEPPER = 65536 * 2048 / 6e6, 65536 * 102.4e-6, 53.68
"""Velocity value of one count per second: 65536 times the servo period; for a stepper, as the protocol specifies."""
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
"""Velocity values of the supported controllers, keyed by the beginning of the model name that they report."""
MAX_START_DELAY_S = 0.25
"""Longest time in s from a command to the beginning of the move."""
MAX_SERVO_ERROR = 0.01
"""Largest distance in deg or mm from its target at which a servo is considered to have arrived."""
MAX_ERROR_COUNTS = 2.0
"""Distance in counts from the target within which a move has ended, even if it was not seen to begin."""


def message_of(data: bytes) -> tuple[bytes, bytes] | None:
    """Return the first message, and the remaining bytes; None if no message is complete."""
    if len(data) < _HEADER.size:
        return None
    _, low, high, destination, _ = _HEADER.unpack_from(data)
    length = _HEADER.size + (low + 256 * high if destination & 0x80 else 0)
    return (data[:length], data[length:]) if len(data) >= length else None


class KinesisStage(LineStage):
    """One stage.

    Parameters
    ----------
    link, clock
        Line to the controller, and the clock used for time-outs.
    counts_per_unit
        Encoder counts or microsteps per deg or mm, as listed in section 8 of the protocol specification.
    unit
        Unit of the positions.
    timeout_s, home_s
        Time limits in s for a reply and for homing.

    Raises
    ------
    BenchError
        If the controller does not reply, is not one of `CONTROLLERS`, rejects a command, or reports a fault.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        counts_per_unit: float,
        unit: Literal["deg", "mm"] = "deg",
        timeout_s: float = 1.0,
        home_s: float = 120.0,
    ) -> None:
        super().__init__(f"Thorlabs stage at {link.name}", link, clock, timeout_s, message_of)
        self.unit: Literal["deg", "mm"] = unit
        self._per_unit, self._home_s = counts_per_unit, home_s
        self._zero: float | None = None
        self._target, self._begun_s = 0, 0.0
        self._replies.discard()
        self._send_message(NO_UPDATES)
        serial, model, _ = self._query(_INFO, INFO)
        self.identity = f"{model.split(bytes(1))[0].decode('ascii', 'replace')} {serial}"
        scale = next((scale for name, scale in CONTROLLERS.items() if self.identity.startswith(name)), None)
        if scale is None:
            limit = f"{self.identity} is not a supported controller"
            raise self._bench_error(limit, f"use one of {', '.join(CONTROLLERS)}")
        self._scale = scale
        self._send_message(ENABLE, 1, 1)
        self._send_message(SET_BACKLASH, data=_POSITION.pack(1, 0))

    @property
    def referenced(self) -> bool:
        """Whether the stage was homed since it was switched on, or its zero was defined since it was connected."""
        return self._zero is not None or bool(self._status()[1] & HOMED)

    @property
    def search(self) -> str:
        """Description of the homing move and its range."""
        distance = "by up to 360 deg" if self.unit == "deg" else "over an unknown distance"
        return f"It moves to its home switch, {distance}."

    def reference(self) -> None:
        """Move to the home switch, unless the zero is known."""
        if self.referenced:
            return
        self._send_message(HOME, 1)
        self._wait_for_homing(self._homed, self._home_s)

    def set_position(self, position: float) -> None:
        """Define the current position as a given value, valid until the line is closed; nothing moves."""
        self._zero = self._status()[0] - position * self._per_unit

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        self._set_velocity(velocity)
        self._target = round(target * self._per_unit + (self._zero or 0.0))
        self._begun_s = self._clock.now_s()
        self._send_message(MOVE, data=_POSITION.pack(1, self._checked(self._target)))

    def position(self) -> float:
        """Return the position in deg or mm, from the encoder, or for a stepper from the steps of its motor."""
        return (self._status()[0] - (self._zero or 0.0)) / self._per_unit

    def on_target(self) -> bool:
        """Whether the stage is at rest at its target.

        Raises `BenchError` if it is at rest elsewhere or reports a fault.
        """
        counts, bits = self._status()
        self._check(bits)
        if bits & (MOVING | HOMING):
            return False
        error = (counts - self._target) / self._per_unit
        begun = self._clock.now_s() > self._begun_s + MAX_START_DELAY_S
        if abs(error) <= max(MAX_SERVO_ERROR if begun else 0.0, MAX_ERROR_COUNTS / self._per_unit):
            return True
        if begun:
            limit = f"stopped {error:g} {self.unit} from its target"
            raise self._bench_error(limit, "check whether a limit switch stopped it")
        return False

    def stop(self) -> None:
        """Stop with the deceleration configured in the controller."""
        self._stop_pending_query(_HEADER.pack(STOP, 1, PROFILED, USB, HOST))
        self._send_message(STOP, 1, PROFILED)
        self._wait_for_rest(lambda: not self._status()[1] & (MOVING | HOMING))

    def _set_velocity(self, velocity: float) -> None:
        """Set the velocity without changing the acceleration; raise `BenchError` if the controller limits it."""
        value = self._checked(round(self._scale * velocity * self._per_unit))
        _, lowest, acceleration, current = self._query(_VELOCITY, GET_VELOCITY)
        if value == current:
            return
        self._send_message(SET_VELOCITY, data=_VELOCITY.pack(1, lowest, acceleration, value))
        accepted = self._query(_VELOCITY, GET_VELOCITY)[3]
        if abs(accepted - value) > 1e-3 * value:
            highest = accepted / (self._scale * self._per_unit)
            limit = f"the velocity {velocity:g} is above its maximum, {highest:g} {self.unit}/s"
            raise self._bench_error(limit, "reduce the velocity")

    def _checked(self, value: int) -> int:
        """Return an integer that fits in a message; raise `BenchError` if it does not."""
        if abs(value) >= 1 << 31:
            raise self._bench_error(f"{value} counts do not fit in 32 bits", "check steps_per_unit in [stage]")
        return value

    def _homed(self) -> bool:
        _, bits = self._status()
        self._check(bits)
        return bool(bits & HOMED) and not bits & (MOVING | HOMING)

    def _status(self) -> tuple[int, int]:
        """Return the position in counts, and the status bits."""
        query = GET_STATUS if self._scale == STEPPER else GET_SERVO_STATUS
        _, counts, bits = self._query(_STATUS, query)
        return counts, bits

    def _check(self, bits: int) -> None:
        for bit, meaning in FAULTS.items():
            if bits & bit:
                remedy = "check that the stage is free to move; switch its controller off and on"
                raise self._bench_error(meaning, remedy)

    def _send_message(self, number: int, first: int = 0, second: int = 0, *, data: bytes = b"") -> None:
        destination = USB
        if data:
            (first, second), destination = divmod(len(data), 256)[::-1], USB | 0x80
        self._send(_HEADER.pack(number, first, second, destination, HOST) + data)

    def _query(self, values: struct.Struct, number: int) -> tuple[Any, ...]:
        """Return the values in the reply to a query; the reply has the next message number."""
        self._send_message(number, 0 if number == INFO else 1)
        data = self._reply(number + 1)
        if len(data) != values.size:
            limit = f"replied with {len(data)} bytes instead of {values.size}"
            raise self._bench_error(limit, "update the firmware of the controller")
        return values.unpack(data)

    def _reply(self, expected: int) -> bytes:
        """Return the data of a message; unsolicited messages that arrive first are ignored."""
        while True:
            message = self._replies.message()
            number, _, _, _, source = _HEADER.unpack_from(message)
            if source != USB:
                raise self._bench_error(f"sent {message[:20]!r}, which is not an APT message", "check the port")
            if number in {ERROR, ERROR_WITH_TEXT}:
                text = message[_HEADER.size + 4 :].split(bytes(1))[0].decode("ascii", "replace")
                raise self._bench_error(f"reports an error: {text or 'no description'}", "see the manual")
            if number == expected:
                self._replies.pending = False
                return message[_HEADER.size :]

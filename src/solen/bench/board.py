"""The emitter board on a serial line: commands to the board, frames from it.

The host sets the number of emitters and inputs and the period, and starts and stops the board. Each command is a frame
(`solen.bench.frames`), and the reply is a frame that contains the kind of the command, a status and a text. Frames of
samples arrive unsolicited between replies. If the line is closed, or the host is silent for a second, the board
switches its emitters off. A board may also drive a motor (`BoardStage`), timed by the clock that stamps its periods.

Kinds of frames, with their payloads:

- 2, reply: kind of the command (1 byte), status (1 byte; 0 for success, else an error), text
- 16, identify: none; the text of the reply is the board's name in UTF-8
- 17, configure: period in µs (4 bytes), number of emitters and of inputs (1 byte each)
- 18, start: none
- 19, stop: none; the emitters are switched off
- 20, alive: none; resets the watchdog and has no reply
- 21, time: none; the reply contains the board clock in µs (4 bytes, wraps), which also stamps periods
- 22, move: target in steps (4 bytes, signed), velocity in steps per 1000 s, acceleration in steps/s² (4 bytes each)
- 23, halt: none; the motor decelerates and stops
- 24, where: none; the reply contains the board clock in µs, the position in steps (4 bytes each), and whether the motor
  moves (1 byte)
- 25, place: the value to assign to the current position, in steps (4 bytes, signed)

Public names: `SerialBoard` and `BoardStage`.
"""

import math
import struct
from typing import Literal

from solen.bench.clock import Clock
from solen.bench.firmware.solen_board import ALIVE, CONFIGURE, HALT, IDENTIFY, MOVE, PLACE, START, STOP, TIME, WHERE
from solen.bench.frames import FrameReader, Layout, Losses, Periods, frame
from solen.bench.link import Link
from solen.errors import BenchError

CONFIGURATION = struct.Struct("<IBB")
_TIME, _MOVE, _WHERE, _PLACE = struct.Struct("<I"), struct.Struct("<iII"), struct.Struct("<IiB"), struct.Struct("<i")
STATUSES = {
    1: "unknown command",
    2: "impossible with these settings",
    3: "not configured",
    4: "an emitter is faulty",
    5: "the board has no motor",
}
ALIVE_INTERVAL_S = 0.25
MAX_BOOT_S = 3.0
"""Longest time in s for which an Arduino does not reply after its port has been opened."""
_NAMES = {
    IDENTIFY: "identify",
    CONFIGURE: "configure",
    START: "start",
    STOP: "stop",
    MOVE: "move",
    HALT: "halt",
    WHERE: "where",
    PLACE: "place",
}


class SerialBoard:
    """A real board.

    Parameters
    ----------
    link, clock
        Line to the board, and the clock of time-outs.
    layout, period_s
        Numbers of emitters and inputs, and the period.
    volts_per_count
        Voltage step of the board's ADC.
    timeout_s
        Longest time to wait for a reply.

    Raises
    ------
    BenchError
        If the board does not reply, or cannot do what is requested.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        layout: Layout,
        *,
        period_s: float,
        volts_per_count: float,
        timeout_s: float = 1.0,
    ) -> None:
        self.layout, self.period_s, self.volts_per_count = layout, period_s, volts_per_count
        self.name = f"board at {link.name}"
        self._link, self._clock, self._timeout_s = link, clock, timeout_s
        self._reader = FrameReader(layout)
        self._sent, self._alive_s = 0, 0.0
        self._received: list[Periods] = []
        self._has_clock = True
        self._stop_previous_run()
        self._discard_input()
        self.identity = self.command(IDENTIFY).decode("utf-8", "replace")
        period_us = round(1e6 * period_s)
        self.command(CONFIGURE, CONFIGURATION.pack(period_us, layout.emitters, layout.receivers))

    @property
    def losses(self) -> Losses:
        """Counts of lost and discarded data since the last start."""
        return self._reader.losses

    def start(self) -> None:
        """Start switching the emitters and sampling."""
        self._discard_input()
        self.command(START)
        self._alive_s = self._clock.now_s()

    def read(self) -> Periods:
        """Return the periods that arrived since the last call."""
        now = self._clock.now_s()
        if now - self._alive_s >= ALIVE_INTERVAL_S:
            self._send(ALIVE)
            self._alive_s = now
        while data := self._link.read(65_536, 0.0):
            self._received.append(self._reader.feed(data))
        self._reader.replies.clear()
        parts, self._received = self._received, []
        return Periods.joined(parts, self.layout)

    def time_s(self) -> float | None:
        """Return the time of the board clock in s; NaN if the board does not know the command, None without a reply.

        Even a reply without a time bounds the delay of the line. A board that does not reply is not queried again.
        """
        reply = self._reply(TIME) if self._has_clock else None
        if reply is None:
            self._has_clock = False
            return None
        status, data = reply
        if status != 0 or len(data) != _TIME.size:
            return math.nan
        return 1e-6 * self._reader.unwrapped_us(_TIME.unpack(data)[0])

    def stop(self) -> None:
        """Switch the emitters off and stop sampling."""
        self.command(STOP)

    def close(self) -> None:
        """Switch the emitters off and close the line."""
        try:
            self.stop()
        finally:
            self._link.close()

    def _stop_previous_run(self) -> None:
        """Stop the board, which may still be sampling.

        If opening the port has reset it, it replies only after booting.
        """
        due = self._clock.now_s() + MAX_BOOT_S
        while self._reply(STOP) is None:
            if self._clock.now_s() > due:
                self.command(STOP)

    def _discard_input(self) -> None:
        """Discard the data in transit, and reset the loss counts."""
        while self._link.read(65_536, 0.0):
            pass
        self._reader, self._received = FrameReader(self.layout), []

    def _send(self, kind: int, payload: bytes = b"") -> None:
        self._link.write(frame(kind, self._sent, payload))
        self._sent += 1

    def command(self, kind: int, payload: bytes = b"") -> bytes:
        """Return the data of the reply to a command; raise `BenchError` if the board did not execute the command."""
        reply = self._reply(kind, payload)
        if reply is None:
            limit = f"no reply to {_NAMES[kind]} within {self._timeout_s:g} s"
            raise BenchError(self.name, limit=limit, remedy="check the cable, the power and the baud rate")
        status, data = reply
        if status != 0:
            meaning = data.decode("utf-8", "replace") or STATUSES.get(status, f"status {status}")
            raise BenchError(self.name, limit=f"{_NAMES[kind]}: {meaning}", remedy="check [board] in the rig file")
        return data

    def _reply(self, kind: int, payload: bytes = b"") -> tuple[int, bytes] | None:
        """Return status and data of the reply to a command, or None after a time-out.

        Periods that arrive before the reply are kept.
        """
        self._send(kind, payload)
        due = self._clock.now_s() + self._timeout_s
        while (remaining_s := due - self._clock.now_s()) > 0.0:
            self._received.append(self._reader.feed(self._link.read(65_536, remaining_s)))
            for reply in self._reader.replies:
                if len(reply) >= 2 and reply[0] == kind:
                    self._reader.replies.clear()
                    return reply[1], reply[2:]
        return None


class BoardStage:
    """The motor on a board: a stepper, or a hobby servo whose steps are microseconds of pulse width.

    Only the commanded position is known; nothing measures the actual position.

    Parameters
    ----------
    board, clock
        The board, and the clock of the run.
    steps_per_unit, unit
        Steps per deg or mm, and the unit.
    acceleration
        Acceleration in the stage's unit per s².
    """

    def __init__(
        self,
        board: SerialBoard,
        clock: Clock,
        *,
        steps_per_unit: float,
        unit: Literal["deg", "mm"] = "deg",
        acceleration: float = 100.0,
    ) -> None:
        self.name = f"motor of the {board.name}"
        self.unit: Literal["deg", "mm"] = unit
        self.board, self._clock = board, clock
        self._per_unit, self._acceleration = steps_per_unit, acceleration
        self._target, self._referenced = 0, False
        self._state()

    @property
    def referenced(self) -> bool:
        """Whether a zero has been set since the board was connected."""
        return self._referenced

    @property
    def search(self) -> str:
        """Sentence shown to the user before homing: the motor has no reference switch."""
        return "It has no reference switch."

    def reference(self) -> None:
        """Raise `BenchError`: there is no reference switch."""
        raise BenchError(self.name, limit="has no reference switch", remedy='set home = "here" in [stage]')

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""
        self.board.command(PLACE, _PLACE.pack(self._steps("position", position, self._per_unit)))
        self._referenced = True

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        target_steps = self._steps("position", target, self._per_unit)
        milli_steps_per_s = self._steps("velocity", velocity, 1e3 * self._per_unit, signed=False)
        acceleration = max(1, self._steps("acceleration", self._acceleration, self._per_unit, signed=False))
        self.board.command(MOVE, _MOVE.pack(target_steps, milli_steps_per_s, acceleration))
        self._target = target_steps

    def position(self) -> float:
        """Return the position in deg or mm, computed from the motor's step count."""
        return self._state()[0] / self._per_unit

    def on_target(self) -> bool:
        """Whether the motor has stopped at its target; raise `BenchError` if it has stopped elsewhere."""
        position, moving = self._state()
        if not moving and position != self._target:
            limit = f"stopped at step {position} instead of step {self._target}"
            raise BenchError(self.name, limit=limit, remedy="check whether the board was reset")
        return not moving

    def stop(self) -> None:
        """Decelerate and stop."""
        self.board.command(HALT)
        due = self._clock.now_s() + 2.0
        while self._state()[1]:
            if self._clock.now_s() > due:
                raise BenchError(self.name, limit="does not stop", remedy="switch its supply off")
            self._clock.sleep(0.01)

    def close(self) -> None:
        """Stop, and close the line to the board."""
        try:
            self.stop()
        finally:
            self.board.close()

    def _steps(self, what: str, value: float, scale: float, *, signed: bool = True) -> int:
        """Return a quantity as an integer number of steps; raise `BenchError` if it does not fit in 32 bits."""
        low, high = (-(2**31), 2**31 - 1) if signed else (0, 2**32 - 1)
        if not low <= value * scale <= high:
            limit = f"must be {low / scale:.6g} to {high / scale:.6g} {self.unit} to fit in 32 bits as steps"
            what = f"{self.name}: {what}"
            raise BenchError(what, value=value, limit=limit, remedy="check steps_per_unit in [stage]")
        return round(value * scale)

    def _state(self) -> tuple[int, bool]:
        """Return the position in steps, and whether the motor moves."""
        _, position, moving = _WHERE.unpack(self.board.command(WHERE))
        return int(position), bool(moving)

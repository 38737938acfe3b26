"""The emitter board over a serial line: commands out, frames in.

The host sets the number of emitters and inputs and the period, and starts and stops the board. Each command is a frame
(`solen.bench.frames`), answered by a frame with the command's kind, a status and a text. Between answers, periods
arrive unsolicited. If the line is closed, or the host is silent for a second, the board switches its emitters off. A
board may also drive a motor (`BoardStage`), timed by the clock that stamps its periods.

====== ========= ============================================================== kind   name      payload ======
========= ============================================================== 16     identify  none; answered by the board's
name in UTF-8 17     configure period in µs (4 bytes), emitters, inputs (1 byte each) 18     start     none 19     stop
none; emitters off 20     alive     none; resets the watchdog, not answered 21     time      none; answered by the
board's clock in µs (4 bytes, wraps), which also stamps periods 22     move      steps (4 bytes, signed), steps per 1000
s, steps/s² (4 bytes each) 23     halt      none; the motor slows down and stops 24     where     none; answered by the
board's clock in µs, steps (4 bytes each), and whether it moves (1 byte) 25     place     the value to assign to the
current position, in steps (4 bytes, signed) 2      answer    kind of the command, status (0 done, else an error), text
====== ========= ==============================================================

Public names: `SerialBoard` and `BoardStage`.
"""

import math
import struct
from typing import Literal, cast

from solen.bench.clock import Clock
from solen.bench.firmware.solen_board import ALIVE, CONFIGURE, HALT, IDENTIFY, MOVE, PLACE, START, STOP, TIME, WHERE
from solen.bench.frames import FrameReader, Layout, Losses, Periods, frame
from solen.bench.link import Link
from solen.errors import BenchError

CONFIGURATION = struct.Struct("<IBB")
_TIME, _MOVE, _WHERE, _PLACE = struct.Struct("<I"), struct.Struct("<iII"), struct.Struct("<IiB"), struct.Struct("<i")
STATUSES = {
    1: "unknown command",
    2: "cannot be done with these settings",
    3: "not configured",
    4: "an emitter is faulty",
    5: "has no motor",
}
ALIVE_EVERY_S = 0.25
WAKES_S = 3.0
"""Time in s for which an Arduino may fail to answer after its port has been opened."""
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
        Emitters and inputs used, and their period.
    volts_per_count
        Voltage step of the board's converter.
    answer_s
        Longest time to wait for an answer.

    Raises
    ------
    BenchError
        If the board does not answer, or cannot do what is requested.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        layout: Layout,
        *,
        period_s: float,
        volts_per_count: float,
        answer_s: float = 1.0,
    ) -> None:
        self.layout, self.period_s, self.volts_per_count = layout, period_s, volts_per_count
        self.name = f"board at {link.name}"
        self._link, self._clock, self._answer_s = link, clock, answer_s
        self._reader = FrameReader(layout)
        self._sent, self._fed_s = 0, 0.0
        self._waiting: list[Periods] = []
        self._keeps_time = True
        self._wake()
        self._renew()
        self.identity = self.command(IDENTIFY).decode("utf-8", "replace")
        period_us = round(1e6 * period_s)
        self.command(CONFIGURE, CONFIGURATION.pack(period_us, layout.emitters, layout.receivers))

    @property
    def losses(self) -> Losses:
        """Losses since the last start."""
        return self._reader.losses

    def start(self) -> None:
        """Start switching the emitters and sampling."""
        self._renew()
        self.command(START)
        self._fed_s = self._clock.now_s()

    def read(self) -> Periods:
        """Return the periods that arrived since the last call."""
        now = self._clock.now_s()
        if now - self._fed_s >= ALIVE_EVERY_S:
            self._send(ALIVE)
            self._fed_s = now
        while data := self._link.read(65_536, 0.0):
            self._waiting.append(self._reader.feed(data))
        self._reader.answers.clear()
        parts, self._waiting = self._waiting, []
        return Periods.joined(parts, self.layout)

    def time_s(self) -> float | None:
        """Return the board's own time in s; NaN if the board does not know the command, None if it does not answer.

        Even an answer without a time bounds the line's delay. A board that does not answer at all is not asked again.
        """
        answer = self._answer(TIME) if self._keeps_time else None
        if answer is None:
            self._keeps_time = False
            return None
        stated = answer[0] == 0 and len(answer[1]) == _TIME.size
        return 1e-6 * self._reader.unwrapped_us(_TIME.unpack(answer[1])[0]) if stated else math.nan

    def stop(self) -> None:
        """Switch the emitters off and stop sampling."""
        self.command(STOP)

    def close(self) -> None:
        """Switch the emitters off and close the line."""
        try:
            self.stop()
        finally:
            self._link.close()

    def _wake(self) -> None:
        """Stop the board, which may still be running.

        A board that was reset when its port was opened answers after a while.
        """
        due = self._clock.now_s() + WAKES_S
        while self._answer(STOP) is None:
            if self._clock.now_s() > due:
                self.command(STOP)

    def _renew(self) -> None:
        """Discard the data in transit, and start counting losses."""
        while self._link.read(65_536, 0.0):
            pass
        self._reader, self._waiting = FrameReader(self.layout), []

    def _send(self, kind: int, payload: bytes = b"") -> None:
        self._link.write(frame(kind, self._sent, payload))
        self._sent += 1

    def command(self, kind: int, payload: bytes = b"") -> bytes:
        """Return the answer to a command; raise `BenchError` if the board did not execute it."""
        answer = self._answer(kind, payload)
        if answer is None:
            limit = f"no answer to {_NAMES[kind]} within {self._answer_s:g} s"
            raise BenchError(self.name, limit=limit, remedy="check the cable, the power and the baud rate")
        status, words = answer
        if status != 0:
            meaning = words.decode("utf-8", "replace") or STATUSES.get(status, f"status {status}")
            raise BenchError(self.name, limit=f"{_NAMES[kind]}: {meaning}", remedy="see the rig file's [board]")
        return words

    def _answer(self, kind: int, payload: bytes = b"") -> tuple[int, bytes] | None:
        """Return status and text of the answer to a command, or None if there was none.

        Periods that arrive first are kept.
        """
        self._send(kind, payload)
        due = self._clock.now_s() + self._answer_s
        while (left := due - self._clock.now_s()) > 0.0:
            self._waiting.append(self._reader.feed(self._link.read(65_536, left)))
            for answer in self._reader.answers:
                if len(answer) >= 2 and answer[0] == kind:
                    self._reader.answers.clear()
                    return answer[1], answer[2:]
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
        self._where()

    @property
    def referenced(self) -> bool:
        """Whether a zero has been set since the board was connected."""
        return self._referenced

    @property
    def search(self) -> str:
        """Sentence for the user: the motor has no reference switch."""
        return "It has no switch that marks its zero."

    def reference(self) -> None:
        """Raise `BenchError`: there is no reference switch."""
        raise BenchError(self.name, limit="has no switch that marks its zero", remedy='home = "here" in [stage]')

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""
        self.board.command(PLACE, _PLACE.pack(self._steps("position", position, self._per_unit)))
        self._referenced = True

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        to = self._steps("position", target, self._per_unit)
        speed = self._steps("velocity", velocity, 1e3 * self._per_unit, signed=False)
        ramp = max(1, self._steps("acceleration", self._acceleration, self._per_unit, signed=False))
        self.board.command(MOVE, _MOVE.pack(to, speed, ramp))
        self._target = to

    def position(self) -> float:
        """Return the position in deg or mm, computed from the motor's step count."""
        return self._where()[1] / self._per_unit

    def on_target(self) -> bool:
        """Whether the motor has come to rest at its target; raise `BenchError` if it has come to rest elsewhere."""
        _, at, moving = self._where()
        if not moving and at != self._target:
            raise BenchError(
                self.name, limit=f"rests at step {at}, but was sent to step {self._target}", remedy="was it reset?"
            )
        return not moving

    def stop(self) -> None:
        """Slow down and stop."""
        self.board.command(HALT)
        due = self._clock.now_s() + 2.0
        while self._where()[2]:
            if self._clock.now_s() > due:
                raise BenchError(self.name, limit="does not stop", remedy="cut its supply")
            self._clock.sleep(0.01)

    def close(self) -> None:
        """Stop, and close the board's line."""
        try:
            self.stop()
        finally:
            self.board.close()

    def _steps(self, what: str, value: float, scale: float, *, signed: bool = True) -> int:
        """Return a number as an integer for the board; raise `BenchError` if the number does not fit in 32 bits."""
        low, high = (-(2**31), 2**31 - 1) if signed else (0, 2**32 - 1)
        if not low <= value * scale <= high:
            limit = f"{what} must be {low / scale:.6g} to {high / scale:.6g} {self.unit}: steps have 32 bits"
            raise BenchError(self.name, value=value, limit=limit, remedy="check steps_per_unit in [stage]")
        return round(value * scale)

    def _where(self) -> tuple[int, int, int]:
        return cast("tuple[int, int, int]", _WHERE.unpack(self.board.command(WHERE)))

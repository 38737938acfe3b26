"""The emitter board over a serial line: commands out, frames in.

The idea: the host configures how many emitters and inputs take part and how often, and starts and stops; each command
is a frame (`solen.bench.frames`) and is answered by one, which carries the command's kind, a status and words. Between
answers, periods come unasked. When the line is closed, or the host was silent for `WATCHDOG_S`, the board is to switch
its emitters off by itself.

====== ========= ==============================================================
kind   name      payload
====== ========= ==============================================================
16     identify  none; answered by the board's name in UTF-8
17     configure period in µs (4 bytes), emitters, inputs (1 byte each)
18     start     none
19     stop      none; emitters off
20     alive     none; the watchdog's food, not answered
21     time      none; answered by the board's clock in µs (4 bytes, wraps), as it stamps periods
2      answer    kind of the command, status (0 done, else an error), words
====== ========= ==============================================================

The interface: `SerialBoard`, an `EmitterBoard`.
"""

import math
import struct

from solen.bench.clock import Clock
from solen.bench.frames import FrameReader, Layout, Losses, Periods, frame
from solen.bench.link import Link
from solen.errors import BenchError

IDENTIFY, CONFIGURE, START, STOP, ALIVE, TIME = 16, 17, 18, 19, 20, 21
CONFIGURATION = struct.Struct("<IBB")
_TIME = struct.Struct("<I")
STATUSES = {1: "unknown command", 2: "cannot be configured so", 3: "not configured", 4: "an emitter is at fault"}
WATCHDOG_S = 2.0
ALIVE_EVERY_S = 0.5
_NAMES = {IDENTIFY: "identify", CONFIGURE: "configure", START: "start", STOP: "stop"}


class SerialBoard:
    """A real board.

    Parameters
    ----------
    link, clock
        Line to the board, and the clock that time-outs follow.
    layout, period_s
        Emitters and inputs that take part, and how often.
    volts_per_count
        Of its converter.
    answer_s
        How long an answer may take.

    Raises
    ------
    BenchError
        Where the board does not answer, or cannot do what it is asked.
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
        self._command(STOP)  # it may be running from before
        self._renew()
        self.identity = self._command(IDENTIFY)
        period_us = round(1e6 * period_s)
        self._command(CONFIGURE, CONFIGURATION.pack(period_us, layout.emitters, layout.receivers))

    @property
    def losses(self) -> Losses:
        """What did not come."""
        return self._reader.losses

    def start(self) -> None:
        """Begin to light and to sample."""
        self._renew()
        self._command(START)
        self._fed_s = self._clock.now_s()

    def read(self) -> Periods:
        """Periods that came since the last call."""
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
        """Its own time; NaN of a board that does not know the question, whose answer still bounds the line's delay.

        A board that does not answer at all is not asked again.
        """
        answer = self._answer(TIME) if self._keeps_time else None
        if answer is None:
            self._keeps_time = False
            return None
        stated = answer[0] == 0 and len(answer[1]) == _TIME.size
        return 1e-6 * self._reader.unwrapped_us(_TIME.unpack(answer[1])[0]) if stated else math.nan

    def stop(self) -> None:
        """Emitters off, no more samples."""
        self._command(STOP)

    def close(self) -> None:
        """Emitters off, and the line closed."""
        try:
            self.stop()
        finally:
            self._link.close()

    def _renew(self) -> None:
        """Drop what is in transit, and count losses from here."""
        while self._link.read(65_536, 0.0):
            pass
        self._reader, self._waiting = FrameReader(self.layout), []

    def _send(self, kind: int, payload: bytes = b"") -> None:
        self._link.write(frame(kind, self._sent, payload))
        self._sent += 1

    def _command(self, kind: int, payload: bytes = b"") -> str:
        """Words of the answer to a command that was obeyed."""
        answer = self._answer(kind, payload)
        if answer is None:
            limit = f"no answer to {_NAMES[kind]} within {self._answer_s:g} s"
            raise BenchError(self.name, limit=limit, remedy="check cable, power and baud rate")
        return self._words(kind, answer[0], answer[1].decode("utf-8", "replace"))

    def _answer(self, kind: int, payload: bytes = b"") -> tuple[int, bytes] | None:
        """Status and words of the answer to a command, None for no answer; periods that come before it are kept."""
        self._send(kind, payload)
        due = self._clock.now_s() + self._answer_s
        while (left := due - self._clock.now_s()) > 0.0:
            self._waiting.append(self._reader.feed(self._link.read(65_536, left)))
            for answer in self._reader.answers:
                if len(answer) >= 2 and answer[0] == kind:
                    self._reader.answers.clear()
                    return answer[1], answer[2:]
        return None

    def _words(self, kind: int, status: int, words: str) -> str:
        if status != 0:
            meaning = words or STATUSES.get(status, f"status {status}")
            raise BenchError(self.name, limit=f"{_NAMES[kind]}: {meaning}", remedy="see the rig file's [board]")
        return words

"""A board on the wire: the frames of `solen.bench.frames`, commands and all, with what `SimulatedBoard` samples.

It is for trying the driver with a real line between, and with every fault of one.
"""

import struct
from dataclasses import dataclass, field
from typing import Protocol

from solen.bench.board import ALIVE, CONFIGURATION, CONFIGURE, IDENTIFY, START, STOP, TIME, WATCHDOG_S
from solen.bench.clock import Clock
from solen.bench.frames import ANSWER, FrameReader, Layout, Periods, frame, sample_frames


class Samples(Protocol):
    """What a controller samples with: a simulated board."""

    layout: Layout
    period_s: float

    def start(self) -> None:
        """Begin."""

    def read(self) -> Periods:
        """What is new."""

    def time_s(self) -> float:
        """Its own time."""

    def stop(self) -> None:
        """Emitters off."""


@dataclass
class BoardController:
    """A board that answers on a wire.

    Attributes
    ----------
    clock, board
        Its time, and what it samples with.
    lit
        Whether its emitters take turns.
    lose
        Numbers of periods that it samples and whose frames never leave it.
    double
        Numbers of periods whose frames leave it twice.
    restart
        Set, it begins anew at once while its emitters take turns: number and clock from 0.
    keeps_time
        Whether it knows the command that asks for its time.
    """

    clock: Clock
    board: Samples
    name: str = "solen emitter board (simulated)"
    lit: bool = False
    lose: set[int] = field(default_factory=set)
    double: set[int] = field(default_factory=set)
    restart: bool = False
    keeps_time: bool = True
    _commands: FrameReader = field(init=False)
    _configured: bool = False
    _heard_s: float = 0.0

    def __post_init__(self) -> None:
        self._commands = FrameReader(Layout(1, 1), every_kind=True)

    def answer(self, data: bytes) -> bytes:
        """What it says to bytes that came, and the periods since the last call."""
        self._commands.feed(data)
        if data:
            self._heard_s = self.clock.now_s()
        periods = self._sampled()
        answers = b"".join(self._answered(kind, payload) for kind, payload in self._commands.others)
        self._commands.others.clear()
        return periods + answers

    def _sampled(self) -> bytes:
        if self.lit and self.clock.now_s() - self._heard_s > WATCHDOG_S:
            self._dark()
        if not self.lit:
            return b""
        if self.restart:
            self.restart = False
            self.board.start()
        periods = self.board.read()
        kept = [
            place
            for place, number in enumerate(periods.number.tolist())
            for _ in range(1 + (number in self.double))
            if number not in self.lose
        ]
        columns = (getattr(periods, name)[kept] for name in ("number", "board_us", "flags", "counts"))
        return sample_frames(self.board.layout, Periods(*columns))

    def _answered(self, kind: int, payload: bytes) -> bytes:
        status, words = 0, ""
        if kind == IDENTIFY:
            words = self.name
        elif kind == CONFIGURE:
            status = 0 if self._fits(payload) else 2
        elif kind == START:
            status = 0 if self._configured else 3
            if self._configured and not self.lit:
                self.lit = True
                self.board.start()
        elif kind == STOP:
            self._dark()
        elif kind == ALIVE:
            return b""
        elif kind == TIME and self.keeps_time:
            return frame(ANSWER, 0, struct.pack("<BBI", kind, 0, round(1e6 * self.board.time_s()) % (1 << 32)))
        else:
            status = 1
        return frame(ANSWER, 0, bytes([kind, status]) + words.encode())

    def _fits(self, payload: bytes) -> bool:
        if len(payload) != CONFIGURATION.size:
            return False
        period_us, emitters, inputs = CONFIGURATION.unpack(payload)
        layout = self.board.layout
        asked = (period_us, emitters, inputs)
        self._configured = asked == (round(1e6 * self.board.period_s), layout.emitters, layout.receivers)
        return self._configured

    def _dark(self) -> None:
        self.lit = False
        self.board.stop()

"""A board on the wire: the firmware's own core on simulated hardware.

It is for trying the driver with a real line between, and with every fault of one.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.bench.clock import Clock
from solen.bench.firmware.solen_board import ANSWER, HEAD_BYTES, START, TIME, UNKNOWN, Board, Hardware
from solen.bench.frames import HEAD, frame

Counts = Callable[[FloatArray, IntArray], NDArray[np.uint16]]
"""What inputs read at times (N,) of the run with an emitter lit, from 0, or none, -1: (N, inputs)."""


class SimulatedHardware(Hardware):
    """Hardware whose time is that of a clock, up to which its core is run; what it sends is kept."""

    def __init__(self, counts: Counts, period_us: int, emitters: int, inputs: int) -> None:
        self.counts, self._asked = counts, (period_us // (2 * emitters), emitters, inputs)
        self.at_us, self.lit, self.sent = 0, -1, bytearray()
        self.began_s = 0.0  # on the clock of the run
        self.most_steps_per_s = 20_000
        self.switched: list[tuple[int, int]] = []
        self.steps: list[tuple[int, int]] = []

    def now_us(self) -> int:
        return self.at_us

    def light(self, emitter: int) -> None:
        self.lit = emitter
        self.switched.append((self.at_us, emitter))

    def sample(self, buffer: bytearray, at: int, inputs: int) -> None:
        read = self.counts(np.array([self.began_s + 1e-6 * self.at_us]), np.array([self.lit]))[0]
        buffer[at : at + 2 * inputs] = read[:inputs].astype("<u2").tobytes()

    def send(self, data: bytearray) -> None:
        self.sent += data

    def fits(self, half_us: int, emitters: int, inputs: int) -> bool:
        return (half_us, emitters, inputs) == self._asked

    def step(self, position: int, forward: bool) -> None:  # noqa: ARG002  by its position
        self.steps.append((self.at_us, position))


@dataclass
class BoardController:
    """A board that answers on a wire.

    Attributes
    ----------
    clock, hardware
        Its time, and what it samples with.
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
    hardware: SimulatedHardware
    lose: set[int] = field(default_factory=set)
    double: set[int] = field(default_factory=set)
    restart: bool = False
    keeps_time: bool = True
    core: Board = field(init=False)
    _answering: bool = False

    def __post_init__(self) -> None:
        self.core = Board(self.hardware, "solen emitter board (simulated)")
        self.hardware.began_s = self.clock.now_s()
        setattr(self.hardware, "send", self._send)  # noqa: B010  the line's faults stand behind it

    @property
    def lit(self) -> bool:
        """Whether its emitters take turns."""
        return self.core.lit

    def answer(self, data: bytes) -> bytes:
        """What it says to bytes that came, and the periods since the last call.

        A call within another one's, from another thread, finds nothing new.
        """
        until_us = round(1e6 * (self.clock.now_s() - self.hardware.began_s))
        self._run(until_us)
        self.core.hear(data)
        said, self.hardware.sent = bytes(self.hardware.sent), bytearray()
        return said

    def _run(self, until_us: int) -> None:
        """All that is due until then."""
        if self.restart and self.lit:
            self.restart = False
            self.core.lit = False
            self.core.hear(frame(START, 0, b""))
        while (due := self._due_us(until_us)) <= until_us:
            self.hardware.at_us = max(due, self.hardware.at_us)
            self.core.work()
        self.hardware.at_us = max(until_us, self.hardware.at_us)

    def _due_us(self, until_us: int) -> int:
        due = self.core.next_us()
        if self.core.axis.moving:  # ten looks at the ramp in a millisecond
            return min(self.hardware.at_us + 100, until_us + 1 if due is None else due)
        return until_us + 1 if due is None else due

    def _send(self, data: bytearray) -> None:
        _, _, kind, _, number = HEAD.unpack_from(data)
        if kind == ANSWER:
            if data[HEAD_BYTES] == TIME and not self.keeps_time:
                data = bytearray(frame(ANSWER, 0, struct.pack("BB", TIME, UNKNOWN)))
            self.hardware.sent += data
        else:
            self.hardware.sent += (0 if number in self.lose else 1 + (number in self.double)) * data

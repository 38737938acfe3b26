"""A board on a line: the core of the firmware on simulated hardware, with lost, repeated and restarted frames."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.bench.clock import Clock
from solen.bench.firmware.solen_board import HEAD_BYTES, REPLY, START, TIME, UNKNOWN, Board, Hardware
from solen.bench.frames import HEAD, frame

Counts = Callable[[FloatArray, IntArray], NDArray[np.uint16]]
"""Counts (N, inputs) at times (N,) of the run with an emitter on, from 0, or none, -1."""


class SimulatedHardware(Hardware):
    """Hardware whose time is set by the controller, and which keeps what it sends."""

    def __init__(self, counts: Counts, period_us: int, emitters: int, inputs: int) -> None:
        self.counts, self._supported = counts, (period_us // (2 * emitters), emitters, inputs)
        self.at_us, self.lit, self.sent = 0, -1, bytearray()
        self.begin_s = 0.0  # on the clock of the run
        self.max_steps_per_s = 20_000
        self.switched: list[tuple[int, int]] = []
        self.steps: list[tuple[int, int]] = []

    def now_us(self) -> int:
        return self.at_us

    def light(self, emitter: int) -> None:
        self.lit = emitter
        self.switched.append((self.at_us, emitter))

    def sample(self, buffer: bytearray, at: int, inputs: int) -> None:
        counts = self.counts(np.array([self.begin_s + 1e-6 * self.at_us]), np.array([self.lit]))[0]
        buffer[at : at + 2 * inputs] = counts[:inputs].astype("<u2").tobytes()

    def send(self, data: bytearray) -> None:
        self.sent += data

    def supports(self, half_us: int, emitters: int, inputs: int) -> bool:
        return (half_us, emitters, inputs) == self._supported

    def step(self, position: int, forward: bool) -> None:  # noqa: ARG002  the position shows the direction
        self.steps.append((self.at_us, position))


@dataclass
class BoardController:
    """A board at the end of a line.

    Attributes
    ----------
    clock, hardware
        Clock of the run, and simulated hardware.
    lose
        Numbers of periods whose frames it does not send.
    double
        Numbers of periods whose frames it sends twice.
    restart
        If set, it restarts at once while it samples: number and clock begin at 0.
    has_clock
        Whether it knows the command that queries its clock.
    """

    clock: Clock
    hardware: SimulatedHardware
    lose: set[int] = field(default_factory=set)
    double: set[int] = field(default_factory=set)
    restart: bool = False
    has_clock: bool = True
    core: Board = field(init=False)

    def __post_init__(self) -> None:
        self.core = Board(self.hardware, "solen emitter board (simulated)")
        self.hardware.begin_s = self.clock.now_s()
        setattr(self.hardware, "send", self._send)  # noqa: B010  faults are injected between hardware and line

    @property
    def sampling(self) -> bool:
        """Whether its emitters alternate."""
        return self.core.sampling

    def reply(self, data: bytes) -> bytes:
        """Return the reply to some bytes, and the periods since the last call."""
        until_us = round(1e6 * (self.clock.now_s() - self.hardware.begin_s))
        self._run(until_us)
        self.core.receive(data)
        sent, self.hardware.sent = bytes(self.hardware.sent), bytearray()
        return sent

    def _run(self, until_us: int) -> None:
        """Do all work that is due until a time."""
        if self.restart and self.sampling:
            self.restart = False
            self.core.sampling = False
            self.core.receive(frame(START, 0, b""))
        while (due := self._due_us(until_us)) <= until_us:
            self.hardware.at_us = max(due, self.hardware.at_us)
            self.core.work()
        self.hardware.at_us = max(until_us, self.hardware.at_us)

    def _due_us(self, until_us: int) -> int:
        due = self.core.next_us()
        if self.core.axis.moving:  # the ramp is followed every 0.1 ms
            return min(self.hardware.at_us + 100, until_us + 1 if due is None else due)
        return until_us + 1 if due is None else due

    def _send(self, data: bytearray) -> None:
        _, _, kind, _, number = HEAD.unpack_from(data)
        if kind == REPLY:
            if data[HEAD_BYTES] == TIME and not self.has_clock:
                data = bytearray(frame(REPLY, 0, struct.pack("BB", TIME, UNKNOWN)))
            self.hardware.sent += data
        else:
            self.hardware.sent += (0 if number in self.lose else 1 + (number in self.double)) * data

"""A simulated board: it alternates the emitters of simulated sensors and samples their receivers.

A period has one slot for each emitter, which is on for the first half of its slot and off for the second; every input
is sampled at the end of both halves. The position of the stage at that moment determines the received fractions of the
light, which the circuit converts to voltages and the ADC to counts. All periods since the last reading are computed at
once; a test compares them with the core of the firmware (`solen.bench.firmware.solen_board`).

Public name: `SimulatedBoard`.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.bench.frames import Layout, Losses, Periods
from solen.bench.simulated.sampler import SimulatedSampler
from solen.bench.simulated.sensors import ambient_mw_cm2
from solen.readout import volts

CHUNK_PERIODS = 2000
"""Number of periods that are computed at once, which limits the memory if the board is rarely read."""


@dataclass(kw_only=True)
class SimulatedBoard(SimulatedSampler):
    """A simulated `EmitterBoard`.

    Attributes
    ----------
    layout, period_s, volts_per_count, losses
        As in `EmitterBoard`.
    per_count
        Size of one count in a unit other than V; None for V.
    """

    layout: Layout
    period_s: float
    per_count: float | None = None
    name: str = "simulated board"
    losses: Losses = field(default_factory=Losses)

    @property
    def volts_per_count(self) -> float:
        """Size of one count in V, or in another unit."""
        return self._step_V if self.per_count is None else self.per_count

    def read(self) -> Periods:
        """Return the periods that were completed since the last call."""
        if self._begun_s is None:
            return self._periods(0)
        complete = math.floor((self.clock.now_s() - self._begun_s) / self.period_s + 1e-9)
        parts: list[Periods] = []
        while self._next < complete or not parts:
            parts.append(self._periods(min(complete - self._next, CHUNK_PERIODS)))
        return Periods.joined(parts, self.layout)

    def time_s(self) -> float:
        """Return the time in s of the clock that stamps periods."""
        now_s = self.clock.now_s()
        elapsed_s = now_s - (now_s if self._begun_s is None else self._begun_s)
        return elapsed_s * (1.0 + 1e-6 * self.ppm)

    def _periods(self, n: int) -> Periods:
        """Compute the next periods."""
        number = self._next + np.arange(n)
        self._next += n
        begun = self._begun_s or 0.0
        start = begun + number * self.period_s
        halves = 2 * self.layout.emitters
        half = np.arange(halves)
        # every input is sampled at the end of each half of a slot
        time = (start[:, None] + (half + 1.0) / halves * self.period_s).ravel()
        counts = self.counts(time, np.tile(np.where(half % 2, -1, half // 2), n))
        board_us = np.rint((start - begun) * 1e6 * (1.0 + 1e-6 * self.ppm)).astype(np.int64)
        shape = (n, self.layout.emitters, 2, self.layout.receivers)
        return Periods(number, board_us, np.zeros(n, np.uint8), counts.reshape(shape))

    def counts(self, time_s: FloatArray, lit: IntArray) -> NDArray[np.uint16]:
        """Return ADC counts (N, inputs) at ascending times (N,), with an emitter on, from 0, or none, -1."""
        counts = np.zeros((len(time_s), self.layout.receivers), np.uint16)
        if len(time_s) == 0:
            return counts
        angle, room = self.angle_deg(time_s), ambient_mw_cm2(self.room, time_s, self._flicker)
        for sensor in self.sensors:
            read_V = volts(sensor.received(angle, lit), sensor.circuit, room, rng=self.rng)
            counts[:, sensor.input_indices] = np.rint(read_V / sensor.circuit.adc.step_V).astype(np.uint16)
        if self.cell is not None:
            cell_V = self.cell.volts(angle, self.rng)
            counts[:, self.cell.input_index] = np.rint(cell_V / self._step_V).astype(np.uint16)
        return counts

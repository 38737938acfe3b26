"""A simulated data acquisition: it samples simulated sensors continuously while their emitters switch.

Emitters alternate; each is on for the first half of its slot and off for the second. A receiver follows with its
first-order time constant: within a phase its voltage relaxes from its previous value to that of the phase's light, and
the previous value is that of periodic switching (`settling`). One converter samples the inputs in sequence, each
slightly later than the one before. The switching runs by the instrument's clock or by its own, and neither is the run's
clock.

Public names: `SimulatedDaq` and `settling`.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.bench.daq import MODELS, DaqLosses, Samples, Setup
from solen.bench.simulated.networks import SimulatedNetwork
from solen.bench.simulated.sampler import SimulatedSampler
from solen.bench.simulated.sensors import SimulatedSensor, room_light_mw_cm2
from solen.readout import noisy_readings
from solen.readout.emitter import REFERENCE_C

AT_ONCE = 20_000
"""Number of samples that are computed at once, which limits the memory if the instrument is seldom read."""
CONVERT_S = 14e-6
"""Interval between inputs if the rate allows: that of the slowest converter plus 10 µs to settle."""
SYNC_V = 3.3
LONG = 20.0
"""Number of time constants after which a switch is settled."""


@dataclass(kw_only=True)
class SimulatedDaq(SimulatedSampler):
    """A simulated `Daq`.

    Attributes
    ----------
    setup
        Its settings.
    outside_ppm
        How much faster the clock of an external switching source runs than the run's.
    """

    setup: Setup
    outside_ppm: float = -60.0
    name: str = "simulated data acquisition"
    losses: DaqLosses = field(default_factory=DaqLosses)
    _turn: float = 0.0

    def __post_init__(self) -> None:
        self.rate_hz, self.switch_hz = self.setup.rate_hz, self.setup.switch_hz
        spread_s = 1.0 / (self.rate_hz * len(self.setup.channels))
        self.convert_s = max(1.0 / MODELS[self.setup.model].rate_hz, min(CONVERT_S, spread_s))

    @property
    def coefficients(self) -> FloatArray:
        """Calibration of a converter without error: one step in V for each count."""
        return np.tile([0.0, self._step_V], (len(self.setup.channels), 1))

    def start(self) -> None:
        """Start sampling; an external switching source is at a random phase."""
        super().start()
        self._turn = float(self.rng.uniform()) if self.setup.switching == "external" else 0.0

    def read(self) -> Samples:
        """Return the samples taken since the last call."""
        first, parts = self._next, [np.zeros((0, len(self.setup.channels)), np.int16)]
        if self._begun_s is not None:
            since_s = self.clock.now_s() - self._begun_s
            taken = math.floor(since_s * self.rate_hz * (1.0 + 1e-6 * self.ppm) + 1e-9)
            while self._next < taken:
                parts.append(self._samples(min(taken - self._next, AT_ONCE)))
        return Samples(0, first, np.concatenate(parts))

    def _samples(self, n: int) -> NDArray[np.int16]:
        """Compute the next samples."""
        number = self._next + np.arange(n)
        self._next += n
        time = (self._begun_s or 0.0) + number / (self.rate_hz * (1.0 + 1e-6 * self.ppm))
        counts = np.zeros((n, len(self.setup.channels)), np.int16)
        for sensor in self.sensors:
            if isinstance(sensor, SimulatedNetwork):
                read_V = self._in_turn(sensor, time)
            else:
                read_V = self._read(sensor, sensor.places, time)
            counts[:, sensor.places] = np.rint(read_V / self._step_V)
        if self.cell is not None:
            depth = self.angle_deg(time + self.convert_s * self.cell.place)
            counts[:, self.cell.place] = np.rint(self.cell.volts(depth, self.rng) / self._step_V)
        if self.setup.synced:
            adc = self.sensors[0].circuit.adc
            high = self._since_on(time + self.convert_s * self.setup.inputs, 1) < self._on_share
            read = adc.read(SYNC_V * high + adc.noise_V * self.rng.standard_normal(n))
            counts[:, -1] = np.rint(read / self._step_V)
        return counts

    @property
    def _on_share(self) -> float:
        return 0.5 / self.setup.emitters

    def _since_on(self, time_s: FloatArray, emitter: int) -> FloatArray:
        """Time since an emitter was last switched on, as a fraction of the period, in [0, 1)."""
        ppm = self.outside_ppm if self.setup.switching == "external" else self.ppm
        turns = (time_s - (self._begun_s or 0.0)) * self.switch_hz * (1.0 + 1e-6 * ppm) + self._turn
        return np.asarray((turns - (emitter - 1) / self.setup.emitters) % 1.0)

    def _read(self, sensor: SimulatedSensor, inputs: list[int], time_s: FloatArray) -> FloatArray:
        """Return the volts (N, 2) that the converter reads from a sensor's receivers."""
        circuit = replace(sensor.circuit, samples=1)
        shares = sensor.at(self.angle_deg(time_s + self.convert_s * float(np.mean(inputs))))
        light = room_light_mw_cm2(self.room, time_s, self._flicker)
        emitter = next(iter(sensor.wires.lit_by.values()))
        since = np.stack([self._since_on(time_s + self.convert_s * place, emitter) for place in inputs], axis=1)
        lit = since < self._on_share
        line = circuit.load_line(circuit.current_mA(np.where(lit, shares, 0.0), light))
        settling_s = 1e-6 * circuit.time_constant_us
        after_s = np.where(lit, since, since - self._on_share) / self.switch_hz
        moving = (after_s < LONG * settling_s).any(axis=1)
        other = circuit.load_line(circuit.current_mA(np.where(lit, 0.0, shares)[moving], light[moving])).volts
        before_s = np.where(lit, 1.0 - self._on_share, self._on_share)[moving] / self.switch_hz
        volts = line.volts.copy()
        volts[moving] = settling(volts[moving], other, after_s[moving], before_s, 1.0 / self.switch_hz, settling_s)
        return noisy_readings(circuit, replace(line, volts=volts), REFERENCE_C, self.rng)

    def _in_turn(self, network: SimulatedNetwork, time_s: FloatArray) -> FloatArray:
        """Return the volts (N, R) that the converter reads from a network's receivers, with one slot for each emitter.

        A phase begins at the voltage with which periodic switching within the slot would end, plus the remainder of the
        previous slot's signal that has not decayed after a complete off phase.
        """
        circuit, emitters, inputs = replace(network.circuit, samples=1), self.setup.emitters, network.places
        states = self.angle_deg(time_s + self.convert_s * float(np.mean(inputs)))
        every = np.stack([network.shares(states, np.full(len(states), one)) for one in range(emitters)], axis=1)
        turns = np.stack([self._since_on(time_s + self.convert_s * place, 1) for place in inputs], axis=1) * emitters
        slot = np.minimum(turns.astype(int), emitters - 1)
        shares, since = np.take_along_axis(every, slot[:, None, :], axis=1)[:, 0], turns - slot
        light, lit = room_light_mw_cm2(self.room, time_s, self._flicker), since < 0.5
        on, off = (circuit.load_line(circuit.current_mA(each, light)) for each in (shares, np.zeros_like(shares)))
        slot_s = 1.0 / (self.switch_hz * emitters)
        after_s, settling_s = np.where(lit, since, since - 0.5) * slot_s, 1e-6 * circuit.time_constant_us
        here, other = np.where(lit, on.volts, off.volts), np.where(lit, off.volts, on.volts)
        half_s = np.full_like(after_s, 0.5 * slot_s)
        line = circuit.load_line(circuit.current_mA(np.where(lit, shares, 0.0), light))
        settled = settling(here, other, after_s, half_s, slot_s, settling_s)
        return noisy_readings(circuit, replace(line, volts=settled), REFERENCE_C, self.rng)


def settling(
    volts: FloatArray,
    other: FloatArray,
    after_s: FloatArray,
    before_s: FloatArray,
    period_s: float,
    settling_s: FloatArray,
) -> FloatArray:
    """Voltage of a first-order system switched periodically between two levels.

    Parameters
    ----------
    volts, other
        Levels of this phase and of the previous one, shape (N, R).
    after_s, before_s
        Time since the switch, and duration of the previous phase, shape (N, R).
    period_s, settling_s
        Total duration of both phases, and time constants (R,).

    Returns
    -------
    array
        Shape (N, R). At the switch it is (other - volts) (1 - e^(-before/τ)) / (1 - e^(-period/τ)) away from its level,
        a factor of 1 for long phases.
    """
    whole = np.expm1(-before_s / settling_s) / np.expm1(-period_s / settling_s)
    return np.asarray(volts + (other - volts) * whole * np.exp(-after_s / settling_s))

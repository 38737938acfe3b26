"""A simulated DAQ device: it samples simulated sensors continuously while their emitters switch.

Emitters alternate; each is on for the first half of its slot and off for the second. A receiver follows with a
first-order time constant: within a phase its voltage relaxes from its initial value to the level of that phase, where
the initial value is that of periodic switching (`settling`). One ADC samples the inputs in sequence, each slightly
later than the one before. The switching follows the device's clock or that of an external source; neither is the run's
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
from solen.bench.simulated.sensors import SimulatedSensor, ambient_mw_cm2
from solen.readout import noisy_readings
from solen.readout.emitter import REFERENCE_C

CHUNK_SAMPLES = 20_000
"""Number of samples that are computed at once, which limits the memory if the device is rarely read."""
CONVERT_S = 14e-6
"""Interval in s between inputs if the rate allows it: 4 µs of the ADC plus 10 µs to settle."""
SYNC_V = 3.3
SETTLED = 20.0
"""Number of time constants after which a receiver has settled."""


@dataclass(kw_only=True)
class SimulatedDaq(SimulatedSampler):
    """A simulated `Daq`.

    Attributes
    ----------
    setup
        Its settings.
    external_ppm
        Excess rate of the clock of an external switching source, relative to the run's clock, in ppm.
    """

    setup: Setup
    external_ppm: float = -60.0
    name: str = "simulated DAQ device"
    losses: DaqLosses = field(default_factory=DaqLosses)
    _initial_phase: float = 0.0

    def __post_init__(self) -> None:
        self.rate_hz, self.switch_hz = self.setup.rate_hz, self.setup.switch_hz
        spread_s = 1.0 / (self.rate_hz * len(self.setup.channels))
        self.convert_s = max(1.0 / MODELS[self.setup.model].rate_hz, min(CONVERT_S, spread_s))

    @property
    def coefficients(self) -> FloatArray:
        """Coefficients of an ADC without error: one step in V for each count."""
        return np.tile([0.0, self._step_V], (len(self.setup.channels), 1))

    def start(self) -> None:
        """Start sampling; an external switching source is at a random phase."""
        super().start()
        self._initial_phase = float(self.rng.uniform()) if self.setup.switching == "external" else 0.0

    def read(self) -> Samples:
        """Return the samples taken since the last call."""
        first, parts = self._next, [np.zeros((0, len(self.setup.channels)), np.int16)]
        if self._begun_s is not None:
            elapsed_s = self.clock.now_s() - self._begun_s
            end = math.floor(elapsed_s * self.rate_hz * (1.0 + 1e-6 * self.ppm) + 1e-9)
            while self._next < end:
                parts.append(self._samples(min(end - self._next, CHUNK_SAMPLES)))
        return Samples(0, first, np.concatenate(parts))

    def _samples(self, n: int) -> NDArray[np.int16]:
        """Compute the next samples."""
        number = self._next + np.arange(n)
        self._next += n
        time = (self._begun_s or 0.0) + number / (self.rate_hz * (1.0 + 1e-6 * self.ppm))
        counts = np.zeros((n, len(self.setup.channels)), np.int16)
        for sensor in self.sensors:
            if isinstance(sensor, SimulatedNetwork):
                read_V = self._network_volts(sensor, time)
            else:
                read_V = self._sensor_volts(sensor, time)
            counts[:, sensor.input_indices] = np.rint(read_V / self._step_V)
        if self.cell is not None:
            index = self.cell.input_index
            depth = self.angle_deg(time + self.convert_s * index)
            counts[:, index] = np.rint(self.cell.volts(depth, self.rng) / self._step_V)
        if self.setup.synced:
            adc = self.sensors[0].circuit.adc
            high = self._phase(time + self.convert_s * self.setup.inputs, 1) < self._on_fraction
            sync_V = adc.read(SYNC_V * high + adc.noise_V * self.rng.standard_normal(n))
            counts[:, -1] = np.rint(sync_V / self._step_V)
        return counts

    @property
    def _on_fraction(self) -> float:
        return 0.5 / self.setup.emitters

    def _phase(self, time_s: FloatArray, emitter: int) -> FloatArray:
        """Return the time since an emitter was last switched on, as a fraction of the period, in [0, 1)."""
        ppm = self.external_ppm if self.setup.switching == "external" else self.ppm
        elapsed_s = time_s - (self._begun_s or 0.0)
        periods = elapsed_s * self.switch_hz * (1.0 + 1e-6 * ppm) + self._initial_phase
        return np.asarray((periods - (emitter - 1) / self.setup.emitters) % 1.0)

    def _phases(self, time_s: FloatArray, inputs: list[int], emitter: int) -> FloatArray:
        """Return the phase at the conversion of each input, (N, inputs)."""
        return np.stack([self._phase(time_s + self.convert_s * index, emitter) for index in inputs], axis=1)

    def _sensor_volts(self, sensor: SimulatedSensor, time_s: FloatArray) -> FloatArray:
        """Return the voltages (N, 2) that the ADC reads from the receivers of a sensor."""
        circuit, inputs = replace(sensor.circuit, samples=1), sensor.input_indices
        fractions = sensor.at(self.angle_deg(time_s + self.convert_s * float(np.mean(inputs))))
        ambient = ambient_mw_cm2(self.room, time_s, self._flicker)
        phase = self._phases(time_s, inputs, next(iter(sensor.wiring.emitter_numbers.values())))
        lit = phase < self._on_fraction
        line = circuit.load_line(circuit.current_mA(np.where(lit, fractions, 0.0), ambient))
        settling_s = 1e-6 * circuit.time_constant_us
        after_s = np.where(lit, phase, phase - self._on_fraction) / self.switch_hz
        unsettled = (after_s < SETTLED * settling_s).any(axis=1)
        opposite = np.where(lit, 0.0, fractions)[unsettled]
        other = circuit.load_line(circuit.current_mA(opposite, ambient[unsettled])).volts
        before_s = np.where(lit, 1.0 - self._on_fraction, self._on_fraction)[unsettled] / self.switch_hz
        volts, period_s = line.volts.copy(), 1.0 / self.switch_hz
        volts[unsettled] = settling(volts[unsettled], other, after_s[unsettled], before_s, period_s, settling_s)
        return noisy_readings(circuit, replace(line, volts=volts), REFERENCE_C, self.rng)

    def _network_volts(self, network: SimulatedNetwork, time_s: FloatArray) -> FloatArray:
        """Return the voltages (N, R) that the ADC reads from the receivers of a network, with a slot for each emitter.

        The previous slot is neglected: a phase begins at the voltage of periodic switching within its own slot.
        """
        circuit, emitters, inputs = replace(network.circuit, samples=1), self.setup.emitters, network.input_indices
        states = self.angle_deg(time_s + self.convert_s * float(np.mean(inputs)))
        by_emitter = [network.received(states, np.full(len(states), emitter)) for emitter in range(emitters)]
        phase = self._phases(time_s, inputs, 1) * emitters
        slot = np.minimum(phase.astype(int), emitters - 1)
        fractions = np.take_along_axis(np.stack(by_emitter, axis=1), slot[:, None, :], axis=1)[:, 0]
        phase_in_slot = phase - slot
        ambient, lit = ambient_mw_cm2(self.room, time_s, self._flicker), phase_in_slot < 0.5
        on, off = (circuit.load_line(circuit.current_mA(light, ambient)) for light in (fractions, 0.0 * fractions))
        slot_s = 1.0 / (self.switch_hz * emitters)
        after_s = np.where(lit, phase_in_slot, phase_in_slot - 0.5) * slot_s
        level, other = np.where(lit, on.volts, off.volts), np.where(lit, off.volts, on.volts)
        half_s = np.full_like(after_s, 0.5 * slot_s)
        volts = settling(level, other, after_s, half_s, slot_s, 1e-6 * circuit.time_constant_us)
        line = circuit.load_line(circuit.current_mA(np.where(lit, fractions, 0.0), ambient))
        return noisy_readings(circuit, replace(line, volts=volts), REFERENCE_C, self.rng)


def settling(
    level: FloatArray,
    other: FloatArray,
    after_s: FloatArray,
    before_s: FloatArray,
    period_s: float,
    settling_s: FloatArray,
) -> FloatArray:
    """Return the voltage of a first-order system that is switched periodically between two levels.

    Parameters
    ----------
    level, other
        Levels of this phase and of the previous one, (N, R).
    after_s, before_s
        Time since the switch, and duration of the previous phase, (N, R).
    period_s, settling_s
        Total duration of both phases, and time constants (R,).

    Returns
    -------
    array
        Shape (N, R). At the switch it differs from its level by (other - level) (1 - e^(-before/τ)) /
        (1 - e^(-period/τ)), which is (other - level) for long phases.
    """
    remaining = np.expm1(-before_s / settling_s) / np.expm1(-period_s / settling_s)
    return np.asarray(level + (other - level) * remaining * np.exp(-after_s / settling_s))

"""A simulated load cell under the finger of a simulated stage.

The cell has the characteristics in the rig file, with a scale error sampled at random from its uncertainty, and a
deviation from a straight line of at most its nonlinearity.

Public name: `SimulatedCell`.
"""

from dataclasses import dataclass

import numpy as np

from solen.analysis.load_cell import LoadCell
from solen.arrays import FloatArray
from solen.bench.simulated.sensors import SimulatedSensor

ZERO_V = 0.5
"""Voltage without load, if the rig file does not specify it."""


@dataclass(frozen=True)
class SimulatedCell:
    """A load cell on an input.

    Attributes
    ----------
    input_index
        Index of its input, from 0.
    sensor
        The sensor on which the force acts.
    nominal
        The load cell in the rig file.
    scale_error, bow_N
        Relative error of its scale, and deviation from a straight line at half its capacity.
    """

    input_index: int
    sensor: SimulatedSensor
    nominal: LoadCell
    scale_error: float
    bow_N: float

    @classmethod
    def drawn(cls, nominal: LoadCell, sensor: SimulatedSensor, rng: np.random.Generator) -> "SimulatedCell":
        """Return a load cell whose errors are random samples within its uncertainty and nonlinearity."""
        scale_error = 0.01 * (nominal.u_sensitivity_percent or 0.0) * float(rng.standard_normal())
        bow_N = 0.01 * nominal.nonlinearity_percent * (nominal.capacity_N or 0.0) * float(rng.uniform(-1.0, 1.0))
        return cls((nominal.input or 1) - 1, sensor, nominal, scale_error, bow_N)

    def volts(self, depth_mm: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the voltages (n,) that the ADC reads at depths (n,)."""
        force_N = self.sensor.force_at_N(depth_mm)
        fraction = force_N / (self.nominal.capacity_N or 1.0)
        shown_N = force_N * (1.0 + self.scale_error) + 4.0 * self.bow_N * fraction * (1.0 - fraction)
        zero_V = ZERO_V if self.nominal.zero_V is None else self.nominal.zero_V
        adc = self.sensor.circuit.adc
        level = zero_V + shown_N / self.nominal.sensitivity_N_per_V
        return adc.read(level + adc.noise_V * rng.standard_normal(level.shape))

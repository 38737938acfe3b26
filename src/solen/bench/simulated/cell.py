"""A simulated load cell under the finger of a simulated stage.

The cell follows the rig file, except for errors whose size the file states. Its scale has an error drawn from the
stated uncertainty, and its curve deviates from a straight line by at most the stated nonlinearity.

Public name: `SimulatedCell`.
"""

from dataclasses import dataclass

import numpy as np

from solen.analysis.load_cell import LoadCell
from solen.arrays import FloatArray
from solen.bench.simulated.sensors import SimulatedSensor

REST_V = 0.5
"""Voltage without load, if the rig file states none."""


@dataclass(frozen=True)
class SimulatedCell:
    """A load cell on an input.

    Attributes
    ----------
    place
        Index of its input, from 0.
    sensor
        The sensor on which the force acts.
    stated
        Load cell as stated in the rig file.
    scale, bow_N
        Relative error of its scale, and deviation from a straight line at half its capacity.
    """

    place: int
    sensor: SimulatedSensor
    stated: LoadCell
    scale: float
    bow_N: float

    @classmethod
    def drawn(cls, stated: LoadCell, sensor: SimulatedSensor, rng: np.random.Generator) -> "SimulatedCell":
        """Draw a load cell within the uncertainty that the rig file states."""
        scale = 0.01 * (stated.u_sensitivity_percent or 0.0) * float(rng.standard_normal())
        bow_N = 0.01 * stated.nonlinearity_percent * (stated.capacity_N or 0.0) * float(rng.uniform(-1.0, 1.0))
        return cls((stated.input or 1) - 1, sensor, stated, scale, bow_N)

    def volts(self, depth_mm: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return the volts of the load cell, in the range of the sensor's converter, at depths (n,)."""
        force_N = self.sensor.pressed_N(depth_mm)
        share = force_N / (self.stated.capacity_N or 1.0)
        shown = force_N * (1.0 + self.scale) + 4.0 * self.bow_N * share * (1.0 - share)
        rest_V = REST_V if self.stated.zero_V is None else self.stated.zero_V
        adc = self.sensor.circuit.adc
        level = rest_V + shown / self.stated.sensitivity_N_per_V
        return adc.read(level + adc.noise_V * rng.standard_normal(level.shape))

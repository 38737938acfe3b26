"""Noise of a reading: formulas for each source.

- Shot noise: the transistor amplifies the shot noise of the photocurrent as it amplifies the current, so that
  i² = 2 q I_C (1 + g) B for a collector current I_C and a gain g; a photodiode has g = 0.
- Thermal noise of the load (Johnson, Nyquist): i² = 4 k T B / R.
- Both noise currents flow through the load in parallel with the transistor's output resistance, and give v = i r, where
  r equals the load, or less in saturation.
- Intrinsic noise of the ADC, and its quantisation: step/√12.

B is the receiver's first-order noise bandwidth, π/2 times its corner frequency. Samples that are farther apart than the
time constant are independent, and the mean of n such samples has 1/√n of the noise.

Not included: supply ripple and noise of the emitter current, which affect all receivers alike.
"""

import numpy as np

from solen.arrays import FloatArray
from solen.readout.circuit import Circuit, Floats
from solen.readout.emitter import REFERENCE_C
from solen.readout.transistor import LoadLine
from solen.results import Result, reported

CHARGE_C = 1.602176634e-19
BOLTZMANN_J_PER_K = 1.380649e-23
ZERO_K = 273.15


class Noise(Result):
    """Standard deviations of a sample (..., R) in V, by source; a reading is the mean of ``samples`` samples."""

    shot_V: FloatArray
    thermal_V: FloatArray
    converter_V: FloatArray
    quantisation_V: FloatArray
    samples: int = 1

    @property
    def before_V(self) -> FloatArray:
        """Noise before quantisation."""
        return np.asarray(np.sqrt(self.shot_V**2 + self.thermal_V**2 + self.converter_V**2))

    @reported
    def reading_V(self) -> FloatArray:
        """Noise of a reading.

        Quantisation errors average out only if noise dithers the voltage; this is assumed if the noise is at least half
        a step.
        """
        step = np.sqrt(12.0) * self.quantisation_V
        rounding = np.where(self.before_V >= 0.5 * step, self.quantisation_V**2 / self.samples, self.quantisation_V**2)
        return np.asarray(np.sqrt(self.before_V**2 / self.samples + rounding))


def noise(
    circuit: Circuit,
    power_fraction: FloatArray,
    ambient_mW_cm2: Floats = 0.0,
    temperature_C: Floats = REFERENCE_C,
) -> Noise:
    """Return the noise at power fractions (..., R).

    ``ambient_mW_cm2`` and ``temperature_C`` are a single number, one per row (...,), or one per reading (..., R).
    """
    line = circuit.load_line(circuit.current_mA(power_fraction, ambient_mW_cm2, temperature_C))
    shot, thermal = analogue_V(circuit, line, temperature_C)
    ones = np.ones_like(line.volts)
    return Noise(shot, thermal, circuit.adc.noise_V * ones, circuit.adc.quantisation_V * ones, circuit.samples)


def analogue_V(circuit: Circuit, line: LoadLine, temperature_C: Floats) -> tuple[FloatArray, FloatArray]:
    """Return the shot and the thermal noise (..., R) in V at the operating points ``line``."""
    bandwidth_hz, load = circuit.noise_bandwidth_hz, np.array(circuit.load_ohm)
    shot_A = np.sqrt(2.0 * CHARGE_C * 1e-3 * line.collector_mA * (1.0 + circuit.transistor.gain) * bandwidth_hz)
    kelvin = np.asarray(temperature_C, dtype=float) + ZERO_K
    kelvin = kelvin[..., None] if 0 < kelvin.ndim < line.volts.ndim else kelvin
    thermal_A = np.sqrt(4.0 * BOLTZMANN_J_PER_K * kelvin * bandwidth_hz / load)
    return np.asarray(shot_A * line.output_ohm), np.asarray(thermal_A * line.output_ohm)

"""Time series: ADC readings for varying powers, with seeded noise.

Public names: `volts`, `noisy_readings` and `lagged`.
"""

import math

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.readout.circuit import Circuit, Floats
from solen.readout.emitter import REFERENCE_C
from solen.readout.noise import analogue_V
from solen.readout.transistor import LoadLine

CHUNK_ROWS = 1 << 16
"""Number of rows processed at a time, so that an hour of samples needs little more memory than the result."""


def volts(
    power_fraction: FloatArray,
    circuit: Circuit,
    ambient_mW_cm2: Floats = 0.0,
    temperature_C: Floats = REFERENCE_C,
    rng: np.random.Generator | None = None,
) -> FloatArray:
    """Return the ADC readings of the receivers.

    Parameters
    ----------
    power_fraction
        Fraction of the emitted power at each receiver, (T, R) or (R,); 0 while the emitter is off.
    circuit
        Circuit with R receivers.
    ambient_mW_cm2, temperature_C
        A single number, one for each row (T,), or one for each reading (T, R).
    rng
        Random generator for the noise; if None, readings are the exact voltages.

    Returns
    -------
    array
        Voltages in the shape of ``power_fraction``; brighter is lower.

    Raises
    ------
    SpecError
        If a power or ambient light is negative or not a number, or the columns do not match the receivers.
    """
    fractions = np.asarray(power_fraction, dtype=float)
    _check(fractions, circuit, ambient_mW_cm2)
    if fractions.ndim < 2:
        return volts(fractions[None, :], circuit, ambient_mW_cm2, temperature_C, rng).reshape(fractions.shape)
    readings = np.empty_like(fractions)
    conditions = [np.asarray(values, dtype=float) for values in (ambient_mW_cm2, temperature_C)]
    for start in range(0, len(fractions), CHUNK_ROWS):
        rows = slice(start, start + CHUNK_ROWS)
        ambient, temperature = (values[rows] if values.ndim else values for values in conditions)
        line = circuit.load_line(circuit.current_mA(fractions[rows], ambient, temperature))
        readings[rows] = line.volts if rng is None else noisy_readings(circuit, line, temperature, rng)
    return readings


def noisy_readings(circuit: Circuit, line: LoadLine, temperature_C: Floats, rng: np.random.Generator) -> FloatArray:
    """Return readings (T, R) at operating points: means of samples, each with noise, quantised and clipped."""
    shot, thermal = analogue_V(circuit, line, temperature_C)
    sd = np.sqrt(shot**2 + thermal**2 + circuit.adc.noise_V**2)
    total = np.zeros_like(line.volts)
    for _ in range(circuit.samples):
        total += circuit.adc.read(line.volts + sd * rng.standard_normal(line.volts.shape))
    return np.asarray(total / circuit.samples)


def lagged(volts: FloatArray, circuit: Circuit, rate_hz: float) -> FloatArray:
    """Return voltages (T, R), sampled at a high rate, with the first-order lag of the receivers.

    A sample is the value at the end of its interval, in which the light is constant; for light that is switched at
    sample times, this is exact.
    """
    from scipy.signal import lfilter

    if not 0.0 < rate_hz < math.inf:
        raise SpecError("rate_hz", value=rate_hz, limit="must be greater than 0")
    readings = np.empty_like(volts)
    for column, tau_us in enumerate(circuit.time_constant_us.tolist()):
        decay = math.exp(-1e6 / (rate_hz * tau_us))
        start = [decay * volts[0, column]]
        readings[:, column] = lfilter([1.0 - decay], [1.0, -decay], volts[:, column], zi=start)[0]
    return readings


def _check(fractions: FloatArray, circuit: Circuit, ambient_mW_cm2: Floats) -> None:
    if fractions.ndim not in (1, 2) or fractions.shape[-1] != len(circuit.names):
        limit = f"must have {len(circuit.names)} columns, one for each receiver"
        raise SpecError("power_fraction", value=fractions.shape, limit=limit)
    for name, values in (("power_fraction", fractions), ("ambient_mW_cm2", np.asarray(ambient_mW_cm2))):
        if not (np.isfinite(values).all() and (values >= 0.0).all()):
            raise SpecError(name, limit="must contain only numbers that are at least 0")

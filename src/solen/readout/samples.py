"""Samples over time: converter readings for varying powers, with seeded noise.

Public names: `volts`, `noisy` and `settled`.
"""

import math

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.readout.circuit import Circuit, Floats
from solen.readout.emitter import REFERENCE_C
from solen.readout.noise import analogue_V
from solen.readout.transistor import LoadLine

ROWS = 1 << 16
"""Number of rows processed at a time, so that an hour of samples requires little more memory than the result."""


def volts(
    power_fraction: FloatArray,
    circuit: Circuit,
    ambient_mW_cm2: Floats = 0.0,
    temperature_C: Floats = REFERENCE_C,
    rng: np.random.Generator | None = None,
) -> FloatArray:
    """Converter readings of the receivers.

    Parameters
    ----------
    power_fraction
        Fraction of the emitted power at each receiver, (T, R) or (R,); 0 while the emitter is off.
    circuit
        Circuit with R receivers.
    ambient_mW_cm2, temperature_C
        A number, one for each row (T,), or one for each reading (T, R).
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
    found = np.empty_like(fractions)
    ambient, temperature = (np.asarray(one, dtype=float) for one in (ambient_mW_cm2, temperature_C))
    for start in range(0, len(fractions), ROWS):
        rows = slice(start, start + ROWS)
        here = temperature[rows] if temperature.ndim else temperature
        light = ambient[rows] if ambient.ndim else ambient
        line = circuit.load_line(circuit.current_mA(fractions[rows], light, here))
        found[rows] = line.volts if rng is None else noisy(circuit, line, here, rng)
    return found


def noisy(circuit: Circuit, line: LoadLine, temperature_C: Floats, rng: np.random.Generator) -> FloatArray:
    """Readings (T, R) on a load line: means of the circuit's samples, each with noise, quantised and clipped."""
    shot, thermal = analogue_V(circuit, line, temperature_C)
    sd = np.sqrt(shot**2 + thermal**2 + circuit.adc.noise_V**2)
    total = np.zeros_like(line.volts)
    for _ in range(circuit.samples):
        total += circuit.adc.read(line.volts + sd * rng.standard_normal(line.volts.shape))
    return np.asarray(total / circuit.samples)


def settled(volts: FloatArray, circuit: Circuit, rate_hz: float) -> FloatArray:
    """Voltages (T, R) after the receivers' first-order lag, sampled far faster than the readings.

    Light is constant between samples, and each sample is the value at the end of its interval. This is exact for light
    that is switched at sample times.
    """
    from scipy.signal import lfilter

    if not 0.0 < rate_hz < math.inf:
        raise SpecError("rate_hz", value=rate_hz, limit="must be greater than 0")
    found = np.empty_like(volts)
    for column, tau_us in enumerate(circuit.time_constant_us.tolist()):
        kept = math.exp(-1e6 / (rate_hz * tau_us))
        start = [kept * volts[0, column]]
        found[:, column] = lfilter([1.0 - kept], [1.0, -kept], volts[:, column], zi=start)[0]
    return found


def _check(fractions: FloatArray, circuit: Circuit, ambient_mW_cm2: Floats) -> None:
    if fractions.ndim not in (1, 2) or fractions.shape[-1] != len(circuit.names):
        limit = f"must have {len(circuit.names)} columns, one for each receiver"
        raise SpecError("power_fraction", value=fractions.shape, limit=limit)
    for name, values in (("power_fraction", fractions), ("ambient_mW_cm2", np.asarray(ambient_mW_cm2))):
        if not (np.isfinite(values).all() and (values >= 0.0).all()):
            raise SpecError(name, limit="must contain only numbers that are at least 0")

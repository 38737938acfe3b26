"""Simulated samples and waveforms of receivers with switched emitters and known light."""

from collections.abc import Callable

import numpy as np

from solen.arrays import FloatArray, IntArray

PERIOD_S = 1.0 / 200.0


def stream(
    readings: int, ambient: Callable[[FloatArray], FloatArray], emitters: int = 1, signal: float = -1.0
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return times, values and states with one sample per slot; the signal of emitter k is k times ``signal``.

    Each emitter is on, followed by an off slot, once per period.
    """
    slots = 2 * emitters
    time = np.arange(readings * slots) * PERIOD_S / slots
    slot = np.arange(len(time)) % slots
    state = np.where(slot % 2 == 0, slot // 2 + 1, 0)
    return time, (signal * state + ambient(time))[:, None], state.astype(np.int64)


def waveform(
    seconds: float,
    rate_hz: float = 200.0,
    *,
    sampled_hz: float = 10_000.0,
    ppm: float = 0.0,
    start: float = 0.3,
    emitters: int = 1,
    noise: float = 0.0,
    seed: int = 1,
    drift_s: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, values of two channels, and the true phase of the switching.

    The light of emitter k lowers the channels by k times 1 V and 0.5 V.
    """
    time = np.arange(round(seconds * sampled_hz)) / sampled_hz
    emitter_time = time if drift_s is None else time - drift_s(time)
    phase = emitter_time * rate_hz * emitters * (1.0 + 1e-6 * ppm) - start
    period = np.floor(phase).astype(np.int64)
    on = phase - period < 0.5
    strength = 1.0 + np.where(period >= 0, period % emitters, 0)
    drop = np.where(on, strength, 0.0)
    rng = np.random.default_rng(seed)
    values = 4.0 - drop[:, None] * np.array([1.0, 0.5]) + noise * rng.standard_normal((len(time), 2))
    return time, values, phase

"""Streams and waveforms of switching emitters, of known light."""

from collections.abc import Callable

import numpy as np

from solen.arrays import FloatArray, IntArray

PERIOD_S = 1.0 / 200.0


def stream(
    readings: int, ambient: Callable[[FloatArray], FloatArray], emitters: int = 1, signal: float = -1.0
) -> tuple[FloatArray, FloatArray, IntArray]:
    """One sample in every slot, each emitter on and off once in a period; emitter k gives k times the signal."""
    slots = 2 * emitters
    time = np.arange(readings * slots) * PERIOD_S / slots
    place = np.arange(len(time)) % slots
    state = np.where(place % 2 == 0, place // 2 + 1, 0)
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
    """Times, values of two channels that light pulls down by 1 V and 0.5 V, and the true phase of the switching."""
    time = np.arange(round(seconds * sampled_hz)) / sampled_hz
    moved = time if drift_s is None else time - drift_s(time)
    phase = moved * rate_hz * emitters * (1.0 + 1e-6 * ppm) - start
    turn = np.floor(phase).astype(np.int64)
    on = phase - turn < 0.5
    strength = 1.0 + np.where(turn >= 0, turn % emitters, 0)
    drop = np.where(on, strength, 0.0)
    rng = np.random.default_rng(seed)
    values = 4.0 - drop[:, None] * np.array([1.0, 0.5]) + noise * rng.standard_normal((len(time), 2))
    return time, values, phase

"""Training data for calibrations of simulated sensors: with cycles that differ, clipping, or ambiguous curves."""

from dataclasses import replace

import numpy as np

from solen.analysis import AnalysisOptions, sensor_response
from solen.analysis.calibration import Training, training_of
from tests.analysis.simulated_support import Protocol, Truth, simulated

SHORT = Protocol(hold_s=0.2)


def training(truth: Truth, *, seed: int = 1, cycle_V: float = 0.0, shape: str = "", label: str = "S1") -> Training:
    """Return the training data of a simulated recording.

    The voltages of each cycle are shifted by random offsets with the standard deviation ``cycle_V``. With the shape
    ``fold``, the right voltage has a maximum at an angle at which the left voltage is saturated.
    """
    signals = simulated(replace(truth, seed=seed), label)
    if shape == "fold":
        clean = np.column_stack([np.clip(signals.angle_deg, -10.0, 0.5), -np.abs(signals.angle_deg - 1.5)])
        signals = replace(
            signals, volts=clean + truth.noise_V * np.random.default_rng(seed).standard_normal(clean.shape)
        )
    if cycle_V:
        starts = truth.protocol.starts_s()
        shifts = cycle_V * np.random.default_rng(seed + 1000).standard_normal((len(starts), 2))
        cycle = np.clip(np.searchsorted(starts, signals.time_s) - 1, 0, None)
        signals = replace(signals, volts=signals.volts + shifts[cycle])
    return training_of(sensor_response([signals], AnalysisOptions()))

"""Sensors whose truth is known, made ready for calibration: cycles that differ, clipping, curves that fold."""

from dataclasses import replace

import numpy as np

from solen.analysis import AnalysisOptions, sensor_response
from solen.analysis.calibration import Training, training_of
from tests.analysis.made_support import Protocol, Truth, made

SHORT = Protocol(hold_s=0.2)


def trained(truth: Truth, *, seed: int = 1, cycle_V: float = 0.0, shape: str = "", label: str = "S1") -> Training:
    """Training of a made recording; ``cycle_V`` shifts each cycle's voltages by so much (standard deviation).

    ``shape`` is ``fold`` for a right receiver that turns back where the left one has saturated.
    """
    signals = made(replace(truth, seed=seed), label)
    if shape == "fold":
        bent = np.column_stack([np.clip(signals.angle_deg, -10.0, 0.5), -np.abs(signals.angle_deg - 1.5)])
        signals = replace(signals, volts=bent + truth.noise_V * np.random.default_rng(seed).standard_normal(bent.shape))
    if cycle_V:
        starts = truth.protocol.starts_s()
        shifts = cycle_V * np.random.default_rng(seed + 1000).standard_normal((len(starts), 2))
        cycle = np.clip(np.searchsorted(starts, signals.time_s) - 1, 0, None)
        signals = replace(signals, volts=signals.volts + shifts[cycle])
    return training_of(sensor_response([signals], AnalysisOptions()))

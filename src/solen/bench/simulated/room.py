"""Light of a simulated room: a mean that drifts and flickers.

The interface: `light_mw_cm2` at times.
"""

import math

import numpy as np

from solen.arrays import FloatArray
from solen.bench.rig import RoomLight


def light_mw_cm2(room: RoomLight, time_s: FloatArray, phase: float) -> FloatArray:
    """Light of the room in mW/cm² at times, shape as given, its flicker beginning at a phase; never below 0."""
    drift = 1.0 + 1e-2 * room.drift_percent_per_min * time_s / 60.0
    flicker = 1e-2 * room.flicker_percent * np.sin(2.0 * math.pi * room.flicker_hz * time_s + phase)
    return np.asarray(np.maximum(0.0, room.mean_mw_cm2 * drift * (1.0 + flicker)))

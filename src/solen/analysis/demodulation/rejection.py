"""Ambient light that a subtraction leaves, by its frequency.

The idea: an on slot of width W every period P with the off slots half a period before and after. Light a cos(ωt) leaves
behind, in readings taken at all phases, at most a times

    one-sided   2 |sin(ωP/4)| · |sinc|          two-sided   (1 − cos(ωP/2)) · |sinc| = 2 sin²(ωP/4) · |sinc|

with sinc = sin(ωW/2)/(ωW/2) from averaging inside a slot. Both let no constant light through; two-sided falls with ω²
towards 0 and one-sided with ω, so that only the first takes a ramp out. At ωP = π, 100 Hz flicker at 200 readings a
second, one-sided raises it by 3 dB and two-sided leaves it as it is, both but for the sinc: there no choice of off
slots helps, and a mean over whole periods of the mains does. At ωP = 2π, the rate itself, ambient light looks like the
emitter's.

The interface: `gain` and `rejection_dB`; `mean_gain` of the mean of readings.
"""

from typing import Literal, get_args

import numpy as np

from solen.arrays import FloatArray

Kernel = Literal["two-sided", "one-sided"]
KERNELS: tuple[Kernel, ...] = get_args(Kernel)


def gain(
    frequency_hz: FloatArray | float, period_s: float, window_s: float, kernel: Kernel = "two-sided"
) -> FloatArray:
    """Remaining amplitude of ambient light of amplitude 1, at the worst phase.

    Parameters
    ----------
    frequency_hz
        Frequency of the light, any shape.
    period_s
        Time between on slots; the off slots are midway between them.
    window_s
        Over which a slot is averaged; 0 for a single sample.
    kernel
        Which off slots are subtracted.
    """
    turn = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
    inside = np.abs(np.sinc(turn * window_s / (2.0 * np.pi)))
    quarter = np.abs(np.sin(turn * period_s / 4.0))
    return np.asarray(2.0 * (quarter if kernel == "one-sided" else quarter**2) * inside)


def mean_gain(frequency_hz: FloatArray | float, period_s: float, readings: int) -> FloatArray:
    """Amplitude left by the mean of successive readings of an amplitude 1: sin(nωP/2)/(n sin(ωP/2))."""
    half = np.pi * np.asarray(frequency_hz, dtype=float) * period_s
    bottom = readings * np.sin(half)
    flat = np.abs(bottom) < 1e-9
    return np.where(flat, 1.0, np.abs(np.sin(readings * half) / np.where(flat, 1.0, bottom)))


def rejection_dB(gains: FloatArray | float) -> FloatArray:
    """Rejection in dB: 20 dB for a tenth of the amplitude; inf where nothing is left, negative where it is raised."""
    with np.errstate(divide="ignore"):
        return np.asarray(-20.0 * np.log10(gains))

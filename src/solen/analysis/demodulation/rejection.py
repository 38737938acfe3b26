"""Ambient light that remains after subtraction, as a function of its frequency.

Let an "on" slot of width W be repeated with period P, and let the "off" slots be half a period before and after it. Of
ambient light a cos(ωt), the readings then contain an amplitude of at most a times

    one-sided   2 |sin(ωP/4)| · |sinc|          two-sided   (1 − cos(ωP/2)) · |sinc| = 2 sin²(ωP/4) · |sinc|

with sinc = sin(ωW/2)/(ωW/2) from averaging within a slot. Both remove constant light. As ω approaches 0, the two-sided
amplitude falls as ω² and the one-sided as ω, so only two-sided subtraction also removes a linear change. At ωP = π,
e.g. for flicker of 100 Hz at 200 readings per second, one-sided subtraction amplifies the light by 3 dB and two-sided
subtraction leaves it unchanged, apart from the sinc factor: neither removes it, but a mean over whole mains periods
does. At ωP = 2π, the switching rate, ambient light looks like the emitter's light.

Public names: `gain`, `rejection_dB` and `mean_gain`.
"""

from typing import Literal, get_args

import numpy as np

from solen.arrays import FloatArray

Kernel = Literal["two-sided", "one-sided"]
KERNELS: tuple[Kernel, ...] = get_args(Kernel)


def gain(
    frequency_hz: FloatArray | float, period_s: float, window_s: float, kernel: Kernel = "two-sided"
) -> FloatArray:
    """Return the remaining amplitude of ambient light of amplitude 1, at the worst phase.

    Parameters
    ----------
    frequency_hz
        Frequency of the light, as an array of any shape.
    period_s
        Time between "on" slots; the "off" slots are midway between them.
    window_s
        Averaging time of a slot; 0 for a single sample.
    kernel
        "Off" slots that are subtracted.
    """
    frequency = np.asarray(frequency_hz, dtype=float)
    sinc = np.abs(np.sinc(frequency * window_s))
    sine = np.abs(np.sin(0.5 * np.pi * frequency * period_s))
    return np.asarray(2.0 * (sine if kernel == "one-sided" else sine**2) * sinc)


def mean_gain(frequency_hz: FloatArray | float, period_s: float, readings: int) -> FloatArray:
    """Return the amplitude that the mean of n successive readings retains, |sin(nωP/2)/(n sin(ωP/2))|."""
    half_phase = np.pi * np.asarray(frequency_hz, dtype=float) * period_s
    denominator = readings * np.sin(half_phase)
    singular = np.abs(denominator) < 1e-9
    return np.where(singular, 1.0, np.abs(np.sin(readings * half_phase) / np.where(singular, 1.0, denominator)))


def rejection_dB(gains: FloatArray | float) -> FloatArray:
    """Return the rejection in dB: 20 for a tenth of the amplitude, inf if nothing remains, negative for a gain."""
    with np.errstate(divide="ignore"):
        return np.asarray(-20.0 * np.log10(gains))

"""Processing of samples and their states into readings, common to all commands.

Samples at a limit are marked in the recorded values, before anything is subtracted. Lamp flicker is subtracted if the
samples inside slots show it. Slots of a single sample do not show flicker; on request, their readings are averaged over
whole mains periods. Slots are then averaged, and a reading is the "on" slot minus the "off" slots. Other recorded
columns, e.g. a stage angle, are averaged over the same samples as the reading.

Public names: `switched`, `Switched` and `limits_of`.
"""

from dataclasses import dataclass

import numpy as np

from solen.analysis.demodulation.average import Averaged, averaged, readings_per_mains
from solen.analysis.demodulation.flicker import MAINS_HZ, Flicker, find_flicker
from solen.analysis.demodulation.rejection import Kernel
from solen.analysis.demodulation.samples import Samples
from solen.analysis.demodulation.slots import OFF, Slots, at_limits, slots_of
from solen.analysis.demodulation.subtract import Demodulated, subtract
from solen.arrays import BoolArray, FloatArray

DISTINCT, AT_EXTREME = 100, 4
"""Smallest numbers of distinct values and of samples at the extreme in a channel for clipping to be detected."""
DENSE = 4
"""Smallest number of samples in a slot for flicker to be visible inside it."""
RESTING = 0.5
"""Fraction of "off" samples at one extreme above which this extreme is the channel's dark level."""


@dataclass(frozen=True, eq=False)
class Switched:
    """Readings, with the slots and samples from which they were computed.

    Attributes
    ----------
    samples, slots, readings
        The recording, its slots and all readings.
    means
        Means of readings over whole mains periods; None unless means were needed.
    flicker
        Interference subtracted from the samples; None if there was none.
    limits
        Lowest and highest value of each channel, both (C,); infinite if unknown.
    clipped
        Number of samples at a limit in each channel, (C,).
    dark_at_limit
        Whether each channel is at a limit while the emitters are off, (C,).
    """

    samples: Samples
    slots: Slots
    readings: Demodulated
    means: Averaged | None
    flicker: Flicker | None
    limits: tuple[FloatArray, FloatArray]
    clipped: FloatArray
    dark_at_limit: BoolArray

    @property
    def kept(self) -> Demodulated | Averaged:
        """The readings, or their means if requested."""
        return self.means or self.readings

    @property
    def slot_s(self) -> float:
        """Averaging time of a slot; 0 for a single sample."""
        samples, count = self.samples, float(np.median(self.slots.samples))
        return float(np.median(np.diff(samples.time_s[:10_000]))) * count if count > 1 else 0.0

    @property
    def window_s(self) -> float:
        """Averaging time of a reading."""
        return self.slot_s if self.means is None else self.means.readings * self.readings.period_s

    def beside(self, values: FloatArray) -> FloatArray:
        """Return the means (M, k) of other columns (N, k) over the samples in each reading."""
        other = _slots(self.samples, values)
        own = other.mean[self.readings.slot]
        return own if self.means is None else np.asarray(own[self.means.places].mean(axis=1))


def switched(
    samples: Samples,
    *,
    kernel: Kernel = "two-sided",
    mains_hz: float | None = None,
    rails: tuple[float | None, float | None] = (None, None),
) -> Switched:
    """Compute readings from samples.

    Parameters
    ----------
    samples
        Samples with their states.
    kernel
        "Off" slots that are subtracted.
    mains_hz
        Mains frequency of flickering lamps; None to detect it, 0 to ignore flicker.
    rails
        Lowest and highest value of every channel; None to detect them.

    Raises
    ------
    DataError
        If there is nothing to subtract, or no number of readings spans whole mains periods.
    """
    limits, resting = limits_of(samples, rails)
    at_limit = at_limits(samples.values, limits) & ~(resting & (samples.state == OFF)[:, None])
    slots = _slots(samples, samples.values, at_limit)
    flicker = means = None
    dense = float(np.median(slots.samples)) >= DENSE
    if dense and mains_hz != 0.0:
        readings_hz = samples.rate_hz or _rate_hz(slots)
        tried = MAINS_HZ if mains_hz is None else (mains_hz,)
        used = ~at_limit.any(axis=1)
        flicker = find_flicker(samples.time_s, samples.values, samples.state, readings_hz, tried, used)
    if flicker is not None:
        slots = _slots(samples, samples.values - flicker.values, at_limit)
    readings = subtract(slots, kernel)
    if not dense and mains_hz:
        means = averaged(readings, slots, readings_per_mains(readings.period_s, mains_hz))
    return Switched(samples, slots, readings, means, flicker, limits, at_limit.sum(axis=0), resting)


def _slots(samples: Samples, values: FloatArray, at_limit: BoolArray | None = None) -> Slots:
    """Return the slots of additional values recorded with the samples."""
    settle_s, gap_s = samples.slot_settle_s, samples.gap_s
    return slots_of(samples.time_s, values, samples.state, settle_s=settle_s, clipped=at_limit, gap_s=gap_s)


def _rate_hz(slots: Slots) -> float:
    """Return the rate of the "on" slots."""
    on = slots.time_s[slots.state > OFF]
    return 1.0 / float(np.median(np.diff(on))) if on.size > 1 else np.inf


def limits_of(
    samples: Samples, rails: tuple[float | None, float | None] = (None, None)
) -> tuple[tuple[FloatArray, FloatArray], BoolArray]:
    """Return the clipping limits of each channel, both (C,), and whether each channel is at one of its limits in the dark.

    The limits are as specified, or detected from the frequency of extreme values. The most frequent dark value is the
    circuit's level without light; only samples with a different value can be clipped.
    """
    low, high = (np.full(samples.values.shape[1], end) for end in (-np.inf, np.inf))
    resting = np.zeros(low.size, dtype=bool)
    off, dark_high = samples.state == OFF, _dark_is_high(samples)
    for place, column in enumerate(samples.values.T):
        there = column[np.isfinite(column)]
        if there.size:
            low[place] = -_upper_limit(-there) if rails[0] is None else rails[0]
            high[place] = _upper_limit(there) if rails[1] is None else rails[1]
        dark = column[off] >= high[place] if dark_high else column[off] <= low[place]
        resting[place] = dark.size > 0 and float(dark.mean()) > RESTING
    return (low, high), resting


def _dark_is_high(samples: Samples) -> bool:
    off, on = (np.nanmean(samples.values[which]) if which.any() else 0.0 for which in _off_and_on(samples))
    return bool(off > on)


def _off_and_on(samples: Samples) -> tuple[BoolArray, BoolArray]:
    return np.asarray(samples.state == OFF), np.asarray(samples.state > OFF)


def _upper_limit(values: FloatArray) -> float:
    """Return the largest value, if it occurs far more often in a channel than the next largest value; otherwise inf."""
    count = int((values == values.max()).sum())
    distinct = np.unique(values[:: max(1, len(values) // 100_000)])
    if count < AT_EXTREME or len(distinct) < DISTINCT:
        return np.inf
    near = int((values == distinct[-2]).sum())
    return float(values.max()) if count > AT_EXTREME * max(1, near) else np.inf

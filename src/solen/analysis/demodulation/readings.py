"""Computation of readings from samples and their states, common to all commands.

Samples at a limit are marked in the recorded values, before anything is subtracted. Lamp flicker is subtracted if the
samples inside slots show it. The samples of each slot are then averaged, and a reading is the "on" slot minus the "off"
slots. Slots of a single sample do not show flicker; on request, their readings are averaged over whole mains periods.
Other recorded columns, e.g. a stage angle, are averaged over the same samples as a reading.

Public names: `switched`, `Switched` and `limits_of`.
"""

from dataclasses import dataclass

import numpy as np

from solen.analysis.demodulation.average import Averaged, averaged, readings_per_mains
from solen.analysis.demodulation.flicker import MAINS_HZ, Flicker, find_flicker, resolved_orders
from solen.analysis.demodulation.rejection import Kernel
from solen.analysis.demodulation.samples import Samples
from solen.analysis.demodulation.slots import OFF, Slots, at_limits, slots_of
from solen.analysis.demodulation.subtract import Demodulated, subtract
from solen.arrays import BoolArray, FloatArray

MIN_DISTINCT, MIN_AT_EXTREME = 100, 4
"""Smallest numbers of distinct values and of samples at the extreme in a channel for clipping to be detected."""
MIN_SLOT_SAMPLES = 4
"""Smallest number of samples in a slot for flicker to be visible inside it."""
MIN_DARK_FRACTION = 0.5
"""Fraction of the "off" samples at one extreme above which this extreme is the channel's dark level."""


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
        Lamp flicker subtracted from the samples; None if there was none.
    unresolved_hz
        Nominal mains frequencies whose harmonics cannot be separated from the light of the emitter.
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
    unresolved_hz: tuple[float, ...]
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

    def means_of(self, values: FloatArray) -> FloatArray:
        """Return the means (M, k) of other columns (N, k) over the samples in each reading."""
        of_readings = _slots(self.samples, values).mean[self.readings.slot]
        return of_readings if self.means is None else np.asarray(of_readings[self.means.blocks].mean(axis=1))


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
    limits, dark_at_limit = limits_of(samples, rails)
    at_limit = at_limits(samples.values, limits) & ~(dark_at_limit & (samples.state == OFF)[:, None])
    slots = _slots(samples, samples.values, at_limit)
    flicker, means = None, None
    unresolved_hz: tuple[float, ...] = ()
    shows_flicker = float(np.median(slots.samples)) >= MIN_SLOT_SAMPLES
    if shows_flicker and mains_hz != 0.0:
        rate_hz = samples.rate_hz or _rate_hz(slots)
        nominal_hz = MAINS_HZ if mains_hz is None else (mains_hz,)
        unresolved_hz = tuple(hz for hz in nominal_hz if not resolved_orders(hz, rate_hz))
        used = ~at_limit.any(axis=1)
        flicker = find_flicker(samples.time_s, samples.values, samples.state, rate_hz, nominal_hz, used)
    if flicker is not None:
        slots = _slots(samples, samples.values - flicker.values, at_limit)
    readings = subtract(slots, kernel)
    if not shows_flicker and mains_hz:
        means = averaged(readings, slots, readings_per_mains(readings.period_s, mains_hz))
    clipped = at_limit.sum(axis=0)
    return Switched(samples, slots, readings, means, flicker, unresolved_hz, limits, clipped, dark_at_limit)


def _slots(samples: Samples, values: FloatArray, at_limit: BoolArray | None = None) -> Slots:
    """Return the slots of values recorded with the samples."""
    settle_s, gap_s = samples.slot_settle_s, samples.gap_s
    return slots_of(samples.time_s, values, samples.state, settle_s=settle_s, clipped=at_limit, gap_s=gap_s)


def _rate_hz(slots: Slots) -> float:
    """Return the rate of the "on" slots."""
    on = slots.time_s[slots.state > OFF]
    return 1.0 / float(np.median(np.diff(on))) if on.size > 1 else np.inf


def limits_of(
    samples: Samples, rails: tuple[float | None, float | None] = (None, None)
) -> tuple[tuple[FloatArray, FloatArray], BoolArray]:
    """Return the clipping limits of each channel, both (C,), and whether each channel is at a limit in the dark, (C,).

    The limits are as specified, or detected from how often the extreme values occur. If most "off" samples are at a
    limit, this is the output of the circuit without light, at which these samples are not clipped.
    """
    low, high = (np.full(samples.values.shape[1], limit) for limit in (-np.inf, np.inf))
    dark_at_limit = np.zeros(low.size, dtype=bool)
    off, dark_is_high = samples.state == OFF, _dark_is_high(samples)
    for index, column in enumerate(samples.values.T):
        finite = column[np.isfinite(column)]
        if finite.size:
            low[index] = -_upper_limit(-finite) if rails[0] is None else rails[0]
            high[index] = _upper_limit(finite) if rails[1] is None else rails[1]
        dark = column[off] >= high[index] if dark_is_high else column[off] <= low[index]
        dark_at_limit[index] = dark.size > 0 and float(dark.mean()) > MIN_DARK_FRACTION
    return (low, high), dark_at_limit


def _dark_is_high(samples: Samples) -> bool:
    masks = (samples.state == OFF, samples.state > OFF)
    off, on = (np.nanmean(samples.values[mask]) if mask.any() else 0.0 for mask in masks)
    return bool(off > on)


def _upper_limit(values: FloatArray) -> float:
    """Return the largest value if it occurs far more often than the next largest value, otherwise inf."""
    count = int((values == values.max()).sum())
    distinct = np.unique(values[:: max(1, len(values) // 100_000)])
    if count < MIN_AT_EXTREME or len(distinct) < MIN_DISTINCT:
        return np.inf
    next_count = int((values == distinct[-2]).sum())
    return float(values.max()) if count > MIN_AT_EXTREME * max(1, next_count) else np.inf

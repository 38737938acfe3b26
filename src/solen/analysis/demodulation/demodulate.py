"""Demodulation of a recording: readings without ambient light, missing data, and the rejection of the subtraction.

Public names: `demodulated`, `Demodulation` and `readings_csv`.
"""

import re
from collections.abc import Callable
from dataclasses import field
from typing import Any, Literal

import numpy as np

from solen.analysis.demodulation.average import Averaged
from solen.analysis.demodulation.clock import CERTAIN, SMOOTH, Clock
from solen.analysis.demodulation.flicker import Flicker
from solen.analysis.demodulation.readings import Switched, switched
from solen.analysis.demodulation.rejection import gain, mean_gain, rejection_dB
from solen.analysis.demodulation.samples import DemodulationOptions, Samples, other_columns, samples_of
from solen.analysis.demodulation.subtract import Counts, Demodulated
from solen.files import SIMULATED_DATA, csv_cell
from solen.ranks import Caution, note, warning
from solen.recording import Provenance, Recording
from solen.results import HIDDEN, Result

REPORTED_HZ = (1.0, 10.0, 50.0, 60.0, 100.0, 120.0)
"""Ambient light frequencies for which the rejection is reported."""
SWAPPED, MIN_TO_COMPARE = 2.0, 20


class EmitterReadings(Result):
    """Readings of a channel for one emitter: mean, scatter, uncertainty of a reading, and number clipped."""

    mean: float
    sd: float
    u_reading: float
    clipped: int


class ChannelReadings(Result):
    """Readings of a channel, in the channel's unit.

    Attributes
    ----------
    unit
        Channel unit; empty if unknown.
    emitters
        Readings for each emitter, by emitter number.
    mean_ambient, sd_ambient
        Mean and standard deviation of the subtracted values.
    sd_slot
        Noise of an "off" slot that the subtraction leaves.
    """

    unit: str
    emitters: dict[int, EmitterReadings]
    mean_ambient: float
    sd_ambient: float
    sd_slot: float


class Rejection(Result):
    """Ambient light rejection at a frequency, from its formula; also with a mean over mains periods."""

    frequency_hz: float
    two_sided_dB: float
    one_sided_dB: float
    with_mean_dB: float | None = None


class Demodulation(Result):
    """A recording without its ambient light.

    Attributes
    ----------
    switched
        The recording, its slots and readings.
    options
        Demodulation options.
    flicker
        Lamp flicker, fitted to the "off" phases of a waveform and subtracted; None without flicker.
    method
        Source of the emitter states: ``states`` or ``waveform``.
    clock, off_stated_ppm
        Emitter clock and its deviation from the specified rate, if detected in the waveform.
    rate_hz
        Readings per second from one emitter; None with fewer than two.
    readings_kept, readings_averaged
        Number of readings (or means) that are returned, and number of readings averaged in each.
    samples_per_slot, window_s
        Typical number of samples per slot, and the averaging time.
    settle_us
        Time omitted after each switch.
    counts
        Missing data.
    clipped_samples
        Number of samples at a limit, by channel.
    channels
        Readings of each channel, by name.
    rejection
        Rejection at each frequency; empty if an emitter has fewer than two readings.
    simulated
        Whether the recording is simulated.
    sources
        The recording.
    warnings
        Warnings.
    """

    switched: Switched = field(metadata=HIDDEN)
    options: DemodulationOptions
    method: Literal["states", "waveform"]
    clock: Clock | None
    off_stated_ppm: float | None
    flicker: Flicker | None
    rate_hz: float | None
    readings_kept: int
    readings_averaged: int | None
    samples_per_slot: float
    window_s: float
    settle_us: float
    counts: Counts
    clipped_samples: dict[str, int]
    channels: dict[str, ChannelReadings]
    rejection: tuple[Rejection, ...]
    simulated: bool
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]

    @property
    def samples(self) -> Samples:
        """Samples in the recording."""
        return self.switched.samples

    @property
    def readings(self) -> Demodulated:
        """All readings."""
        return self.switched.readings

    @property
    def means(self) -> Averaged | None:
        """Means of readings over whole mains periods; None unless means were needed."""
        return self.switched.means


def demodulated(recording: Recording, options: DemodulationOptions | None = None) -> Demodulation:
    """Subtract the ambient light from a recording and return its readings.

    Raises
    ------
    DataError, SpecError
        If columns, states or a clock are missing, or there is nothing to subtract.
    """
    options = options or DemodulationOptions()
    samples = samples_of(recording, options)
    found = switched(samples, kernel=options.kernel, mains_hz=options.mains_hz, rails=(options.low, options.high))
    readings, means, clock = found.readings, found.means, samples.clock
    channels = zip(samples.names, samples.units, strict=True)
    return Demodulation(
        switched=found,
        options=options,
        method="states" if clock is None else "waveform",
        clock=clock,
        off_stated_ppm=None if clock is None else _off_stated_ppm(clock, options),
        flicker=found.flicker,
        rate_hz=1.0 / readings.period_s if np.isfinite(readings.period_s) else None,
        readings_kept=len(found.kept.time_s),
        readings_averaged=None if means is None else means.readings,
        samples_per_slot=float(np.median(found.slots.samples)),
        window_s=found.window_s,
        settle_us=1e6 * samples.settle_s,
        counts=readings.counts,
        clipped_samples={name: int(count) for name, count in zip(samples.names, found.clipped, strict=True)},
        channels={name: _channel(readings, found.kept, n, unit) for n, (name, unit) in enumerate(channels)},
        rejection=_rejection(found, options),
        simulated=recording.provenance.simulated,
        sources=(recording.provenance,),
        warnings=(*recording.warnings, *_polarity(samples, options), *_warnings(found)),
    )


def _polarity(samples: Samples, options: DemodulationOptions) -> list[Caution]:
    if samples.clock is None or "on" in options.model_fields_set:
        return []
    return [
        note(
            "light is assumed to lower the readings (--on low), as with the paper's receivers; otherwise use --on high"
        )
    ]


def _off_stated_ppm(clock: Clock, options: DemodulationOptions) -> float:
    stated_hz = (options.rate_hz or np.nan) * options.emitters
    return 1e6 * (clock.rate_hz / stated_hz - 1.0)


def _channel(readings: Demodulated, kept: Demodulated | Averaged, place: int, unit: str) -> ChannelReadings:
    ambient = readings.ambient[np.isfinite(readings.ambient[:, place]), place]
    mean, sd = (float(ambient.mean()), float(ambient.std())) if ambient.size else (np.nan, np.nan)
    emitters = {}
    for emitter in readings.emitters:
        here = kept.emitter == emitter
        there = here & np.isfinite(kept.signal[:, place])
        if there.any():
            values = kept.signal[there, place]
            u = float(np.median(kept.u[there, place]))
            clipped = int(kept.clipped[here, place].sum())
            emitters[emitter] = EmitterReadings(float(values.mean()), float(values.std()), u, clipped)
    return ChannelReadings(unit, emitters, mean, sd, float(readings.slot_sd[place]))


def _rejection(result: Switched, options: DemodulationOptions) -> tuple[Rejection, ...]:
    period_s, means = result.readings.period_s, result.means
    if not np.isfinite(period_s):
        return ()
    hz, slot_s = np.array(REPORTED_HZ), result.slot_s
    two_sided, one_sided = (rejection_dB(gain(hz, period_s, slot_s, kernel)) for kernel in ("two-sided", "one-sided"))
    if means is None:
        return tuple(Rejection(*row) for row in np.column_stack([hz, two_sided, one_sided]).tolist())
    left = gain(hz, period_s, slot_s, options.kernel) * mean_gain(hz, period_s, means.readings)
    with_mean = rejection_dB(np.maximum(left, 1e-10))
    return tuple(Rejection(*row) for row in np.column_stack([hz, two_sided, one_sided, with_mean]).tolist())


def _warnings(result: Switched) -> list[Caution]:
    samples, readings, means = result.samples, result.readings, result.means
    return [
        *_count_warnings(readings),
        *_noise_warnings(readings),
        *([] if means is None or not means.left_out else [warning(_LEFT_OUT.format(means.left_out))]),
        *swapped(samples, readings),
        *([] if samples.clock is None else _clock_warnings(samples.clock)),
    ]


_LEFT_OUT = "{} readings do not fill a whole mains period and are omitted from the means"


def _count_warnings(readings: Demodulated) -> list[Caution]:
    counts = readings.counts
    warnings = [
        warning(f"emitter {emitter}: {missing} on slots of a regular sequence are missing from the recording")
        for emitter, missing in counts.missing.items()
        if missing
    ]
    if counts.without_off:
        warnings.append(warning(f"{counts.without_off} on slots have no off slot nearby and give no reading"))
    if counts.one_sided > 2 * len(readings.emitters):
        one_sided = (
            "readings have an off slot on one side only, so a linear change in the ambient "
            "light is not removed from them"
        )
        warnings.append(warning(f"{counts.one_sided} {one_sided}"))
    if counts.emptied:
        warnings.append(warning(f"{counts.emptied} slots contain no samples after settling: use a shorter --settle-us"))
    if counts.clipped:
        clipped = (
            f"{counts.clipped} of {len(readings.time_s)} readings contain samples at a limit of their "
            "channel; light from the "
            "emitter or the room beyond the limit is not recorded (see --low and --high)"
        )
        warnings.append(warning(clipped))
    return warnings


def _noise_warnings(readings: Demodulated) -> list[Caution]:
    if np.isnan(readings.slot_sd).all():
        return [warning("fewer than three off slots: the uncertainties are unknown")]
    if not np.nanmax(readings.slot_sd) > 0.0:
        still = (
            "off slots never change: the noise is smaller than the converter step, and uncertainties of 0 are not real"
        )
        return [warning(still)]
    return []


def _clock_warnings(clock: Clock) -> list[Caution]:
    warnings = []
    if clock.between_share > SMOOTH:
        slow = (
            f"the transitions between on and off take {100.0 * clock.between_share:.0f} % of a period, which indicates "
            "flicker or a slow receiver "
            "rather than an emitter that switches"
        )
        warnings.append(warning(slow))
    if clock.clearness < CERTAIN:
        warnings.append(
            warning(f"the modulation is only {clock.clearness:.0f} times its noise, so the edges are uncertain")
        )
    return warnings


def swapped(samples: Samples, readings: Demodulated) -> list[Caution]:
    """Return a warning if the "off" phases vary more than the "on" phases, as if the two were swapped."""
    with np.errstate(invalid="ignore"):
        off, on = (np.nanstd(one, axis=0) for one in (readings.ambient, readings.ambient + readings.signal))
    if len(readings.time_s) < MIN_TO_COMPARE or not (off > SWAPPED * on).all():
        return []
    remedy = "the state column" if samples.clock is None else "--on"
    varies = (
        f"readings with the emitter off vary more than {SWAPPED:g} times as much as those with the emitter on; "
        "the emitter's light "
        f"follows the motion but ambient light does not, so on and off may be swapped ({remedy})"
    )
    return [warning(varies)]


def readings_csv(result: Demodulation, recording: Recording) -> str:
    """Format the readings as CSV: time, emitter, and each channel's signal, uncertainty, ambient light and clipping.

    The other columns of the recording follow, averaged over the samples in each reading. The last column is the
    averaging time of a reading, unless a reading is a single sample.
    """
    kept, options = result.switched.kept, result.options
    columns: dict[str, list[float]] = {"time_s": kept.time_s.tolist(), "emitter": kept.emitter.tolist()}
    for place, (name, channel) in enumerate(result.channels.items()):
        plain, unit = re.sub(r"[,\s\"]+", "_", name), f" ({channel.unit})" if channel.unit else ""
        heads = (f"{plain}{unit}", f"u_{plain}{unit}", f"ambient_{plain}{unit}", f"clipped_{plain}")
        for head, values in zip(heads, (kept.signal, kept.u, kept.ambient, kept.clipped), strict=True):
            columns[head] = values[:, place].tolist()
    others = other_columns(recording, options)
    if others:
        means = result.switched.beside(np.column_stack(list(others.values())))
        columns |= {
            head.replace(",", " ").replace('"', " "): one.tolist() for head, one in zip(others, means.T, strict=True)
        }
    if result.switched.window_s:
        columns["window (s)"] = [result.switched.window_s] * len(kept.time_s)
    formats = [_format(head) for head in columns]
    rows = zip(*columns.values(), strict=True)
    remarks = [f"# readings of {recording.provenance.file}: on minus off, {options.kernel}"]
    if result.means is not None:
        remarks.append(f"# means of {result.means.readings} readings over whole periods of {options.mains_hz:g} Hz")
    if result.simulated:
        remarks.append(SIMULATED_DATA.rstrip())
    table = [",".join(write(value) for write, value in zip(formats, row, strict=True)) for row in rows]
    return "\n".join([*remarks, ",".join(map(csv_cell, columns)), *table]) + "\n"


def _format(head: str) -> Callable[[Any], str]:
    """Format a column: integers without decimals, times to the microsecond, missing values empty."""
    if head == "emitter" or head.startswith("clipped_"):
        return lambda value: str(int(value))
    digits = ".6f" if head == "time_s" else ".9g"
    return lambda value: "" if value != value else format(value, digits)

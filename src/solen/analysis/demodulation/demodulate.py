"""Demodulation of a recording: readings without ambient light, missing data, and the rejection of ambient light.

Public names: `demodulated`, `Demodulation` and `readings_csv`.
"""

import re
from collections.abc import Callable
from dataclasses import field
from typing import Any, Literal

import numpy as np

from solen.analysis.demodulation.average import Averaged
from solen.analysis.demodulation.clock import MAX_TRANSITION, MIN_CERTAIN, Clock
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
MAX_OFF_TO_ON, MIN_READINGS = 2.0, 20
"""Ratio of the scatter of the off phases to that of the on phases above which the two may be swapped, and number of
readings from which it is computed.
"""


class EmitterReadings(Result):
    """Readings of a channel for one emitter: mean, scatter, uncertainty of a reading, number of clipped readings."""

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
        Readings for each emitter, keyed by its number.
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
    """Calculated rejection of ambient light at a frequency: in single readings, and in means over mains periods."""

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
        Source of the emitter states: recorded ``states`` or the ``waveform``.
    clock, off_stated_ppm
        Emitter clock and its deviation from the specified rate, if detected in the waveform.
    rate_hz
        Readings per second from one emitter; None with fewer than two.
    readings_kept, readings_averaged
        Number of readings (or means) that are returned, and number of readings averaged in each.
    samples_per_slot, window_s
        Median number of samples in a slot, and the averaging time of a reading.
    settle_us
        Time omitted after each switching edge.
    counts
        Missing data.
    clipped_samples
        Number of samples at a limit, keyed by channel.
    channels
        Readings of each channel, keyed by name.
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
    result = switched(samples, kernel=options.kernel, mains_hz=options.mains_hz, rails=(options.low, options.high))
    readings, means, clock = result.readings, result.means, samples.clock
    channels = zip(samples.names, samples.units, strict=True)
    return Demodulation(
        switched=result,
        options=options,
        method="states" if clock is None else "waveform",
        clock=clock,
        off_stated_ppm=None if clock is None else _deviation_ppm(clock, options),
        flicker=result.flicker,
        rate_hz=1.0 / readings.period_s if np.isfinite(readings.period_s) else None,
        readings_kept=len(result.kept.time_s),
        readings_averaged=None if means is None else means.readings,
        samples_per_slot=float(np.median(result.slots.samples)),
        window_s=result.window_s,
        settle_us=1e6 * samples.settle_s,
        counts=readings.counts,
        clipped_samples={name: int(count) for name, count in zip(samples.names, result.clipped, strict=True)},
        channels={name: _channel(readings, result.kept, n, unit) for n, (name, unit) in enumerate(channels)},
        rejection=_rejection(result, options),
        simulated=recording.provenance.simulated,
        sources=(recording.provenance,),
        warnings=(*recording.warnings, *_polarity(samples, options), *_warnings(result)),
    )


def _polarity(samples: Samples, options: DemodulationOptions) -> list[Caution]:
    if samples.clock is None or "on" in options.model_fields_set:
        return []
    text = "light is assumed to lower the readings (--on low), as with the paper's receivers; otherwise use --on high"
    return [note(text)]


def _deviation_ppm(clock: Clock, options: DemodulationOptions) -> float:
    specified_hz = (options.rate_hz or np.nan) * options.emitters
    return 1e6 * (clock.rate_hz / specified_hz - 1.0)


def _channel(readings: Demodulated, kept: Demodulated | Averaged, index: int, unit: str) -> ChannelReadings:
    ambient = readings.ambient[np.isfinite(readings.ambient[:, index]), index]
    mean, sd = (float(ambient.mean()), float(ambient.std())) if ambient.size else (np.nan, np.nan)
    emitters = {}
    for emitter in readings.emitters:
        rows = kept.emitter == emitter
        finite = rows & np.isfinite(kept.signal[:, index])
        if finite.any():
            values = kept.signal[finite, index]
            u = float(np.median(kept.u[finite, index]))
            clipped = int(kept.clipped[rows, index].sum())
            emitters[emitter] = EmitterReadings(float(values.mean()), float(values.std()), u, clipped)
    return ChannelReadings(unit, emitters, mean, sd, float(readings.slot_sd[index]))


def _rejection(result: Switched, options: DemodulationOptions) -> tuple[Rejection, ...]:
    period_s, means = result.readings.period_s, result.means
    if not np.isfinite(period_s):
        return ()
    hz, slot_s = np.array(REPORTED_HZ), result.slot_s
    two_sided, one_sided = (rejection_dB(gain(hz, period_s, slot_s, kernel)) for kernel in ("two-sided", "one-sided"))
    columns = [hz, two_sided, one_sided]
    if means is not None:
        remaining = gain(hz, period_s, slot_s, options.kernel) * mean_gain(hz, period_s, means.readings)
        columns.append(rejection_dB(np.maximum(remaining, 1e-10)))
    return tuple(Rejection(*row) for row in np.column_stack(columns).tolist())


def _warnings(result: Switched) -> list[Caution]:
    samples, readings, means = result.samples, result.readings, result.means
    return [
        *_count_warnings(readings),
        *_noise_warnings(readings),
        *([] if means is None or not means.omitted else [warning(f"{means.omitted} {_OMITTED}")]),
        *swapped(samples, readings),
        *unresolved_flicker(result),
        *([] if samples.clock is None else _clock_warnings(samples.clock)),
    ]


_OMITTED = "readings are omitted from the means, because they do not fill a block of whole mains periods"


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
        one_sided = "readings have an off slot on one side only, so a linear change in the ambient light is not removed"
        warnings.append(warning(f"{counts.one_sided} {one_sided}"))
    if counts.emptied:
        warnings.append(warning(f"{counts.emptied} slots contain no samples after settling: use a shorter --settle-us"))
    if counts.clipped:
        clipped = (
            f"{counts.clipped} of {len(readings.time_s)} readings contain samples at a limit of their channel, which "
            "do not show the true light from the emitter or the room (see --low and --high)"
        )
        warnings.append(warning(clipped))
    return warnings


def _noise_warnings(readings: Demodulated) -> list[Caution]:
    if np.isnan(readings.slot_sd).all():
        return [warning("fewer than three off slots: the uncertainties are unknown")]
    if not np.nanmax(readings.slot_sd) > 0.0:
        constant = (
            "off slots never change, because the noise is smaller than the step of the ADC: the true uncertainties are "
            "larger than the reported 0"
        )
        return [warning(constant)]
    return []


def _clock_warnings(clock: Clock) -> list[Caution]:
    warnings = []
    if clock.between_share > MAX_TRANSITION:
        slow = (
            f"the transitions between on and off take {100.0 * clock.between_share:.0f} % of a period, which indicates "
            "flicker or a slow receiver rather than an emitter that switches"
        )
        warnings.append(warning(slow))
    if clock.clearness < MIN_CERTAIN:
        weak = f"the modulation is only {clock.clearness:.0f} times its noise, so the edges are uncertain"
        warnings.append(warning(weak))
    return warnings


def swapped(samples: Samples, readings: Demodulated) -> list[Caution]:
    """Return a warning if the "off" phases vary more than the "on" phases, as if the two were swapped."""
    with np.errstate(invalid="ignore"):
        off, on = np.nanstd(readings.ambient, axis=0), np.nanstd(readings.ambient + readings.signal, axis=0)
    if len(readings.time_s) < MIN_READINGS or not (off > MAX_OFF_TO_ON * on).all():
        return []
    remedy = "the state column" if samples.clock is None else "--on"
    text = (
        f"voltages with the emitter off vary more than {MAX_OFF_TO_ON:g} times as much as those with the emitter on, "
        "although the emitter's light follows the motion and ambient light does not: on and off may be swapped "
        f"(check {remedy})"
    )
    return [warning(text)]


def unresolved_flicker(result: Switched) -> list[Caution]:
    """Return a note about lamps whose flicker cannot be distinguished from the light of the emitter."""
    if not result.unresolved_hz:
        return []
    mains = " or ".join(f"{hz:g}" for hz in result.unresolved_hz)
    return [
        note(
            f"flicker of lamps at a mains frequency of {mains} Hz cannot be distinguished from the emitter at this "
            "switching rate and is not subtracted; use another rate if such lamps are on"
        )
    ]


def readings_csv(result: Demodulation, recording: Recording) -> str:
    """Format the readings as CSV: time, emitter, and each channel's signal, uncertainty, ambient light and clipping.

    The other columns of the recording follow, averaged over the samples in each reading, and then the averaging time of
    a reading, unless it is a single sample.
    """
    kept, options = result.switched.kept, result.options
    columns: dict[str, list[float]] = {"time_s": kept.time_s.tolist(), "emitter": kept.emitter.tolist()}
    for index, (name, channel) in enumerate(result.channels.items()):
        plain, unit = re.sub(r"[,\s\"]+", "_", name), f" ({channel.unit})" if channel.unit else ""
        headers = (f"{plain}{unit}", f"u_{plain}{unit}", f"ambient_{plain}{unit}", f"clipped_{plain}")
        for header, values in zip(headers, (kept.signal, kept.u, kept.ambient, kept.clipped), strict=True):
            columns[header] = values[:, index].tolist()
    others = other_columns(recording, options)
    if others:
        means = result.switched.means_of(np.column_stack(list(others.values())))
        headers_of_others = [re.sub('[,"]', " ", header) for header in others]
        columns |= dict(zip(headers_of_others, means.T.tolist(), strict=True))
    if result.switched.window_s:
        columns["window (s)"] = [result.switched.window_s] * len(kept.time_s)
    formats = [_format(header) for header in columns]
    rows = zip(*columns.values(), strict=True)
    comments = [f"# readings of {recording.provenance.file}: on minus off, {options.kernel}"]
    if result.means is not None:
        comments.append(f"# means of {result.means.readings} readings over whole periods of {options.mains_hz:g} Hz")
    if result.simulated:
        comments.append(SIMULATED_DATA.rstrip())
    table = [",".join(write(value) for write, value in zip(formats, row, strict=True)) for row in rows]
    return "\n".join([*comments, ",".join(map(csv_cell, columns)), *table]) + "\n"


def _format(header: str) -> Callable[[Any], str]:
    """Return the format of a column: integers without decimals, times to the microsecond, missing values empty."""
    if header == "emitter" or header.startswith("clipped_"):
        return lambda value: str(int(value))
    digits = ".6f" if header == "time_s" else ".9g"
    return lambda value: "" if value != value else format(value, digits)

"""Waveforms of a recording, by emitter: if the emitters are switched, readings without ambient light.

A fast recorder resolves the switching of the emitters. The switching rate is specified by an option, or else is that of
the strongest spectral line of the voltages. If the voltages switch at this rate and the switched part follows the
motion, ambient light and lamp flicker are subtracted (`solen.analysis.demodulation`); before that, samples at the
recorder's limits are marked.

Public name: `waveforms`.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from solen.analysis.demodulation.clock import Clock, On, find_clock, find_switching
from solen.analysis.demodulation.demodulate import swapped, unresolved_flicker
from solen.analysis.demodulation.flicker import MAINS_HZ
from solen.analysis.demodulation.readings import Switched, switched
from solen.analysis.demodulation.samples import DEFAULT_SETTLE_US, Samples
from solen.analysis.samples import sampled
from solen.analysis.signals import AngleSource, SignalOptions, Switching, Waveforms
from solen.analysis.timebase import time_base
from solen.arrays import IndexArray
from solen.errors import SpecError
from solen.ranks import Caution, note, warning
from solen.recording import Recording

_MAX_MEAN_SPAN = 0.05  # largest fraction of a recording that a moving mean may span
_MIN_SIGNAL_SCATTER = 0.5  # smallest scatter of an emitter's signal, relative to that of either phase


def waveforms(recording: Recording, options: SignalOptions, *, angle: AngleSource = "optional") -> dict[str, Waveforms]:
    """Return the waveforms of a recording, keyed by emitter; the key of a single or unswitched emitter is empty.

    Parameters
    ----------
    recording
        Recording with its columns.
    options
        Roles of the columns, and processing options.
    angle
        With ``elsewhere``, no angle, force or depth is read.

    Raises
    ------
    DataError, SpecError
        If a column is missing, contains no numbers or has an unsuitable unit, or a specified rate is not present.
    """
    file = recording.provenance.name
    samples = sampled(recording, options, angle)
    if samples.ambient_subtracted and options.rails is not None:
        limit = f"does not apply to {file}: its ambient light was subtracted, and its clipped readings are marked"
        rails = " ".join(f"{rail:g}" for rail in options.rails)
        raise SpecError("--rails", value=rails, limit=limit, remedy="omit it")
    return {emitter: _smoothed(part, options, file) for emitter, part in _by_emitter(samples, options).items()}


def _by_emitter(samples: Waveforms, options: SignalOptions) -> dict[str, Waveforms]:
    rate_hz, detected = options.on_off_hz, options.on_off_hz is None
    if rate_hz == 0.0 or (detected and samples.ambient_subtracted):
        return {"": samples}
    clock = _clock(samples, options, rate_hz, options.on or "low")
    if clock is None:
        return {"": samples}
    rate_hz = rate_hz or float(f"{clock.rate_hz:.4g}")
    result, on = _subtracted(samples, options, clock), options.on or "low"
    if options.on is None and swapped(result.samples, result.readings):
        on, clock = "high", find_clock(samples.time_s, samples.volts, rate_hz, on="high", emitters=options.emitters)
        result = _subtracted(samples, options, clock)
    if detected and not _follows_motion(result):
        caution = warning(
            f"the voltages switch at {rate_hz:g} Hz, but by the same amount at all positions of the sensor, so this "
            f"is assumed to be ambient light; specify --on-off-hz {rate_hz:g} if it is the emitter"
        )
        return {"": replace(samples, warnings=(*samples.warnings, caution))}
    state = _state(samples, result, rate_hz, on, detected=detected)
    part = replace(samples, switching=state, warnings=(*samples.warnings, *_warnings(result, state, clock)))
    names = {emitter: "" if options.emitters == 1 else f"E{emitter}" for emitter in result.readings.emitters}
    return {name: _readings(part, result, emitter) for emitter, name in names.items()}


def _clock(samples: Waveforms, options: SignalOptions, rate_hz: float | None, on: On) -> Clock | None:
    if rate_hz is None:
        return find_switching(samples.time_s, samples.volts, on)
    return find_clock(samples.time_s, samples.volts, rate_hz, on=on, emitters=options.emitters)


def _follows_motion(result: Switched) -> bool:
    """Return whether the switched part varies with the motion, as light of an emitter does, unlike room light."""
    signal, off = result.readings.signal, result.readings.ambient
    smaller = np.minimum(np.nanstd(signal + off, axis=0), np.nanstd(off, axis=0))
    return bool((np.nanstd(signal, axis=0) > _MIN_SIGNAL_SCATTER * smaller).any())


def _subtracted(waveforms: Waveforms, options: SignalOptions, clock: Clock) -> Switched:
    settle_s = min(1e-6 * DEFAULT_SETTLE_US, 0.3 * clock.shorter_s)
    states = clock.states(settle_s, options.emitters)
    units = (waveforms.unit,) * len(waveforms.receivers)
    samples = Samples(waveforms.time_s, waveforms.volts, waveforms.receivers, units, states, settle_s, clock)
    return switched(samples, mains_hz=options.mains_hz, rails=options.rails or (None, None))


def _state(samples: Waveforms, result: Switched, rate_hz: float, on: On, *, detected: bool) -> Switching:
    flicker, names = result.flicker, samples.receivers
    mains = None if flicker is None else min(MAINS_HZ, key=lambda nominal_hz: abs(nominal_hz - flicker.mains_hz))
    limits = zip(names, *result.limits, strict=True)
    return Switching(
        on_off_hz=rate_hz,
        detected=detected,
        on=on,
        mains_hz=mains,
        flicker_V=None if flicker is None else float(flicker.amplitude.max()),
        samples=samples.time_s.size,
        clipped_samples={name: int(n) for name, n in zip(names, result.clipped, strict=True)},
        limits_V={name: (_finite(low), _finite(high)) for name, low, high in limits},
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _readings(samples: Waveforms, readings: Switched, emitter: int) -> Waveforms:
    kept = readings.kept
    of_emitter = np.flatnonzero(kept.emitter == emitter)
    base = time_base(kept.time_s[of_emitter], "readings")
    rows: IndexArray = of_emitter[base.order]
    angle = None if samples.angle_deg is None else readings.means_of(samples.angle_deg[:, None])[rows, 0]
    return replace(
        samples,
        time_s=base.time_s,
        step_s=base.step_s,
        volts=kept.signal[rows],
        angle_deg=angle,
        clipped=kept.clipped[rows],
        ambient_subtracted=True,
        window_s=readings.window_s,
        warnings=(*samples.warnings, *base.warnings),
    )


def _warnings(result: Switched, state: Switching, clock: Clock) -> list[Caution]:
    reading_hz = clock.rate_hz / max(len(result.readings.emitters), 1)
    origin = "detected automatically" if state.detected else f"{state.on_off_hz:g} Hz was specified"
    subtracted = (
        "ambient light is subtracted: each reading is the on phase minus the mean of the off phases before and after "
        f"it; {result.kept.time_s.size} readings at {reading_hz:.6g} Hz ({origin}); "
        f"light makes the voltage {'lower' if state.on == 'low' else 'higher'}"
    )
    warnings = [note(subtracted)]
    missing = sum(result.readings.counts.missing.values())
    if missing:
        warnings.append(warning(f"{missing} on slots are missing from the recording"))
    if result.flicker is not None:
        lines = " and ".join(f"{n * result.flicker.mains_hz:.4g}" for n in result.flicker.multiples)
        size = f"{state.flicker_V:.2g} {result.samples.units[0]}"
        warnings.append(
            note(f"lamps flicker at {lines} Hz by up to {size}: the flicker is fitted to the off phases and subtracted")
        )
    warnings += unresolved_flicker(result)
    for name, at_limit in zip(result.samples.names, result.dark_at_limit, strict=True):
        if at_limit:
            unseen = "is at its limit in the dark, so weak light from the emitter or the room is not detected"
            warnings.append(warning(f"{name} {unseen}"))
    return warnings


def _smoothed(samples: Waveforms, options: SignalOptions, file: str) -> Waveforms:
    """Return the samples with voltages averaged over a centred moving window; unchanged unless this is requested."""
    if options.smooth_ms is None:
        return samples
    max_ms = 1e3 * _MAX_MEAN_SPAN * float(samples.time_s[-1] - samples.time_s[0])
    if options.smooth_ms > max_ms:
        limit = f"must be at most {max_ms:.4g}, a twentieth of the duration of {file}"
        remedy = "choose a smaller width, or omit the option"
        raise SpecError("--smooth-ms", value=options.smooth_ms, limit=limit, remedy=remedy)
    width = max(1, round(1e-3 * options.smooth_ms / samples.step_s)) | 1  # an odd number of samples
    return replace(samples, volts=np.asarray(uniform_filter1d(samples.volts, width, axis=0, mode="nearest")))

"""Waveforms of a recording, by emitter: readings without ambient light if the emitters switch.

A recorder that is faster than the switching resolves it. Unless an option specifies the rate, the strongest spectral
line of the voltages is tried. If this line is due to a switch, and the switched light follows the motion, the ambient
light and the lamp flicker are subtracted (`solen.analysis.demodulation`); samples at the recorder's limits are marked
before the subtraction.

Public name: `waveforms`.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from solen.analysis.demodulation.clock import Clock, On, find_clock, find_switching
from solen.analysis.demodulation.demodulate import swapped
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
_FOLLOWS = 0.5  # smallest scatter of the difference, relative to that of either phase, for a sensor


def waveforms(recording: Recording, options: SignalOptions, *, angle: AngleSource = "optional") -> dict[str, Waveforms]:
    """Readings of a recording by emitter; the key is empty if emitters do not switch, or there is only one.

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
    whole = sampled(recording, options, angle)
    if whole.ambient_subtracted and options.rails is not None:
        limit = f"do not apply to {file}, from which ambient light was subtracted: its clipped readings are marked"
        rails = " ".join(f"{rail:g}" for rail in options.rails)
        raise SpecError("--rails", value=rails, limit=limit, remedy="omit it")
    parts = _by_emitter(whole, options)
    return {emitter: _smoothed(part, options, file) for emitter, part in parts.items()}


def _by_emitter(whole: Waveforms, options: SignalOptions) -> dict[str, Waveforms]:
    rate_hz, detected = options.on_off_hz, options.on_off_hz is None
    if rate_hz == 0.0 or (detected and whole.ambient_subtracted):
        return {"": whole}
    clock = _clock(whole, options, rate_hz, options.on or "low")
    if clock is None:
        return {"": whole}
    rate_hz = rate_hz or float(f"{clock.rate_hz:.4g}")
    by_emitter, on = _found(whole, options, clock), options.on or "low"
    if options.on is None and swapped(by_emitter.samples, by_emitter.readings):
        on, clock = "high", find_clock(whole.time_s, whole.volts, rate_hz, on="high", emitters=options.emitters)
        by_emitter = _found(whole, options, clock)
    if detected and not _follows(by_emitter):
        caution = warning(
            f"the voltages switch at {rate_hz:g} Hz, but by the same step at all positions of the sensor, so this is "
            f"assumed to be ambient light; use --on-off-hz {rate_hz:g} if it is the emitter"
        )
        return {"": replace(whole, warnings=(*whole.warnings, caution))}
    state = _state(whole, by_emitter, rate_hz, on, detected=detected)
    part = replace(whole, switching=state, warnings=(*whole.warnings, *_warnings(by_emitter, state, clock)))
    names = {emitter: "" if options.emitters == 1 else f"E{emitter}" for emitter in by_emitter.readings.emitters}
    return {name: _readings(part, by_emitter, emitter) for emitter, name in names.items()}


def _clock(whole: Waveforms, options: SignalOptions, rate_hz: float | None, on: On) -> Clock | None:
    if rate_hz is None:
        return find_switching(whole.time_s, whole.volts, on)
    return find_clock(whole.time_s, whole.volts, rate_hz, on=on, emitters=options.emitters)


def _follows(result: Switched) -> bool:
    """Whether the switched part varies with the level of the phases, like light from an emitter in a moving sensor."""
    on = result.readings.signal + result.readings.ambient
    least = np.minimum(np.nanstd(on, axis=0), np.nanstd(result.readings.ambient, axis=0))
    return bool((np.nanstd(result.readings.signal, axis=0) > _FOLLOWS * least).any())


def _found(whole: Waveforms, options: SignalOptions, clock: Clock) -> Switched:
    settle_s = min(1e-6 * DEFAULT_SETTLE_US, 0.3 * clock.shorter_s)
    states = clock.states(settle_s, options.emitters)
    units = (whole.unit,) * len(whole.receivers)
    samples = Samples(whole.time_s, whole.volts, whole.receivers, units, states, settle_s, clock)
    return switched(samples, mains_hz=options.mains_hz, rails=options.rails or (None, None))


def _state(whole: Waveforms, result: Switched, rate_hz: float, on: On, *, detected: bool) -> Switching:
    flicker, names = result.flicker, whole.receivers
    mains = None if flicker is None else min(MAINS_HZ, key=lambda one: abs(one - flicker.mains_hz))
    limits = zip(names, *result.limits, strict=True)
    return Switching(
        on_off_hz=rate_hz,
        detected=detected,
        on=on,
        mains_hz=mains,
        flicker_V=None if flicker is None else float(flicker.amplitude.max()),
        samples=whole.time_s.size,
        clipped_samples={name: int(n) for name, n in zip(names, result.clipped, strict=True)},
        limits_V={name: (_finite(low), _finite(high)) for name, low, high in limits},
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _readings(whole: Waveforms, readings: Switched, emitter: int) -> Waveforms:
    kept = readings.kept
    here = np.flatnonzero(kept.emitter == emitter)
    base = time_base(kept.time_s[here], "readings")
    rows: IndexArray = here[base.order]
    angle = None if whole.angle_deg is None else readings.beside(whole.angle_deg[:, None])[rows, 0]
    return replace(
        whole,
        time_s=base.time_s,
        step_s=base.step_s,
        volts=kept.signal[rows],
        angle_deg=angle,
        clipped=kept.clipped[rows],
        ambient_subtracted=True,
        window_s=readings.window_s,
        warnings=(*whole.warnings, *base.warnings),
    )


def _warnings(result: Switched, state: Switching, clock: Clock) -> list[Caution]:
    each = clock.rate_hz / max(len(result.readings.emitters), 1)
    by = "detected automatically" if state.detected else f"{state.on_off_hz:g} Hz was specified"
    subtracted = (
        "ambient light is subtracted: each reading is the on phase minus the mean of the off phases before and "
        "after it, "
        f"{result.kept.time_s.size} readings at {each:.6g} Hz ({by}); "
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
    for name, resting in zip(result.samples.names, result.dark_at_limit, strict=True):
        if resting:
            unseen = "is at its limit in the dark, so weak light from the emitter or the room is not visible"
            warnings.append(warning(f"{name} {unseen}"))
    return warnings


def _smoothed(samples: Waveforms, options: SignalOptions, file: str) -> Waveforms:
    """Centred moving mean of each receiver, if requested."""
    if options.smooth_ms is None:
        return samples
    most_ms = 1e3 * _MAX_MEAN_SPAN * float(samples.time_s[-1] - samples.time_s[0])
    if options.smooth_ms > most_ms:
        limit = f"must be at most {most_ms:.4g}, a twentieth of the length of {file}"
        raise SpecError(
            "--smooth-ms", value=options.smooth_ms, limit=limit, remedy="choose a smaller width, or omit the option"
        )
    width = max(1, round(1e-3 * options.smooth_ms / samples.step_s)) | 1  # an odd number of samples
    return replace(samples, volts=np.asarray(uniform_filter1d(samples.volts, width, axis=0, mode="nearest")))

"""Ambient light out of a recording: from any table to a table of readings, with what was missing and what is left."""

import re
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from solen import files
from solen.analysis.demodulation import (
    Clock,
    Demodulated,
    Kernel,
    Samples,
    Slots,
    averaged,
    gain,
    readings_per_mains,
    rejection_dB,
    slots_of,
    subtract,
)
from solen.analysis.demodulation.average import Averaged
from solen.analysis.demodulation.rejection import KERNELS, mean_gain
from solen.errors import OutputError
from solen.pipeline.bench.demodulate_data import Options, beside, limits_of, samples_of
from solen.pipeline.outputs import check_figure
from solen.recording import Recording, read

__all__ = ["Options", "demodulate", "named"]

TOLD_HZ = (1.0, 10.0, 50.0, 60.0, 100.0, 120.0)
SMOOTH, SWAPPED, LEAST_TO_COMPARE = 0.2, 2.0, 20


def demodulate(
    file: Path,
    options: Options,
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: Path | None = None,
) -> dict[str, Any]:
    """Readings of a recording without its ambient light, as a table of its own where ``out`` is named."""
    check_figure(figure)
    if out is not None and out.suffix.lower() != ".csv":
        raise OutputError(str(out), limit="readings are written as .csv", remedy="rename it")
    options.check()
    recording = read(file, sheet=sheet)
    samples = samples_of(recording, options)
    slots = slots_of(
        samples.time_s,
        samples.values,
        samples.state,
        settle_s=samples.settle_s if samples.clock is None else 0.0,
        limits=limits_of(samples, options),
        gap_s=None if samples.clock is None else samples.clock.shorter_s,
    )
    kernel = next(one for one in KERNELS if one == options.kernel)
    found = subtract(slots, kernel)
    means = None
    if options.mains_hz is not None:
        means = averaged(found, slots, readings_per_mains(found.period_s, options.mains_hz))
    data = _told(samples, slots, found, means, options) | {
        "sources": [recording.provenance.as_dict()],
        "warnings": [*recording.warnings, *_warnings(samples, found, means)],
    }
    contents: dict[Path, files.Content] = {}
    if out is not None:
        contents[out] = _table(samples, means or found, options, recording).encode("utf-8")
    if figure is not None:
        from solen.report import canvas
        from solen.report.bench.demodulate import demodulation_figure

        title = f"{'simulated: ' if recording.provenance.simulated else ''}{recording.provenance.file}"
        drawn = demodulation_figure(samples, found, means, title, _window_s(samples, slots), kernel)
        contents[figure] = canvas.encoded(drawn, figure.suffix.lower(), "demodulation")
    files.write_all(contents)
    return data | {name: str(path) for name, path in (("out", out), ("figure", figure)) if path is not None}


def _window_s(samples: Samples, slots: Slots) -> float:
    """Time over which a slot is averaged."""
    step = float(np.median(np.diff(samples.time_s[:10_000]))) if len(samples.time_s) > 1 else 0.0
    count = float(np.median(slots.samples))
    return step * count if count > 1 else 0.0


def _told(
    samples: Samples, slots: Slots, found: Demodulated, means: Averaged | None, options: Options
) -> dict[str, Any]:
    kept = means or found
    counts = asdict(found.counts)
    for name in ("readings", "missing"):
        counts[name] = {str(emitter): count for emitter, count in counts[name].items()}
    names = samples.names
    return {
        "method": "states" if samples.clock is None else "waveform",
        "kernel": options.kernel,
        "channels": list(names),
        "emitters": list(found.emitters),
        "samples": len(samples.time_s),
        "readings": len(kept.time_s),
        "readings_averaged": None if means is None else means.readings,
        "left_out_of_means": None if means is None else means.left_out,
        "rate_hz": None if not np.isfinite(found.period_s) else 1.0 / found.period_s,
        "samples_per_slot": float(np.median(slots.samples)),
        "settle_us": 1e6 * samples.settle_s,
        "clock": None if samples.clock is None else _clock(samples.clock, options),
        "counts": counts,
        "by_channel": {name: _channel(found, kept, place) for place, name in enumerate(names)},
        "rejection": _rejection(samples, slots, found, means, options),
    }


def _clock(clock: Clock, options: Options) -> dict[str, Any]:
    stated = (options.rate_hz or np.nan) * options.emitters
    return {
        "rate_hz": clock.rate_hz,
        "u_rate_hz": _number(clock.u_rate_hz),
        "off_stated_ppm": 1e6 * (clock.rate_hz / stated - 1.0),
        "wander_us": clock.wander_us,
        "jitter_us": clock.jitter_us,
        "on_share": clock.on_share,
        "depth": clock.depth,
        "clearness": _number(clock.clearness),
    }


def _channel(found: Demodulated, kept: Demodulated | Averaged, place: int) -> dict[str, Any]:
    """Numbers of one channel; ``ambient`` compares how it varies with what of that off slots show after subtraction."""
    column = found.ambient[:, place]
    spread = float(np.nanstd(column)) if np.isfinite(column).any() else np.nan
    slot = float(found.slot_sd[place])
    by_emitter = {}
    for emitter in found.emitters:
        here = kept.emitter == emitter
        values = kept.signal[here, place]
        there = np.isfinite(values)
        if there.any():
            by_emitter[str(emitter)] = {
                "mean": float(values[there].mean()),
                "sd": float(values[there].std()),
                "u_reading": _number(float(np.median(kept.u[here, place][there]))),
                "clipped": int(kept.clipped[here, place].sum()),
            }
    return {
        "by_emitter": by_emitter,
        "ambient_mean": _number(float(np.nanmean(column))) if np.isfinite(column).any() else None,
        "ambient_sd": _number(spread),
        "slot_sd": _number(slot),
    }


def _rejection(
    samples: Samples, slots: Slots, found: Demodulated, means: Averaged | None, options: Options
) -> list[dict[str, Any]]:
    """Rejection by frequency, by its formula, beside that of one-sided subtraction."""
    if not np.isfinite(found.period_s):
        return []
    window, rows = _window_s(samples, slots), []
    for hz in TOLD_HZ:
        by: dict[Kernel, float] = {one: float(gain(hz, found.period_s, window, one)) for one in KERNELS}
        row = {"hz": hz} | {f"{one.replace('-', '_')}_dB": _number(float(rejection_dB(by[one]))) for one in KERNELS}
        if means is not None:
            kernel = next(one for one in KERNELS if one == options.kernel)
            both = by[kernel] * float(mean_gain(hz, found.period_s, means.readings))
            row["mean_dB"] = _number(float(rejection_dB(max(both, 1e-10))))
        rows.append(row)
    return rows


def _warnings(samples: Samples, found: Demodulated, means: Averaged | None) -> list[str]:
    counts, told = found.counts, []
    readings = len(found.time_s)
    for emitter, missing in counts.missing.items():
        if missing:
            told.append(f"emitter {emitter}: {missing} on slots of a regular sequence are missing from the recording")
    if counts.without_off:
        told.append(f"{counts.without_off} on slots have no off slot near: they give no reading")
    if counts.one_sided > 2 * len(found.emitters):
        told.append(f"{counts.one_sided} readings have an off slot on one side only: a ramp is not taken out of them")
    if counts.emptied:
        told.append(f"{counts.emptied} slots had no sample left after settling: shorten --settle-us")
    if counts.clipped:
        told.append(
            f"{counts.clipped} of {readings} readings hold samples at a limit of their channel: light beyond it is not "
            "seen, neither the emitter's nor the ambient's (--low, --high)"
        )
    if np.isnan(found.slot_sd).all():
        told.append("fewer than three off slots: uncertainties are not known")
    elif not np.nanmax(found.slot_sd) > 0.0:
        told.append("off slots never change: noise is below the converter's step, and uncertainties of 0 are not real")
    if means is not None and means.left_out:
        told.append(f"{means.left_out} readings fill no unbroken period of the mains: left out of the means")
    told += _swapped(samples, found)
    if samples.clock is not None and samples.clock.between_share > SMOOTH:
        told.append(
            f"{100.0 * samples.clock.between_share:.0f} % of a period lie between on and off: this looks like flicker "
            "or a slow receiver rather than an emitter that switches"
        )
    if samples.clock is not None and samples.clock.clearness < 20.0:
        told.append(f"the modulation stands out only {samples.clock.clearness:.0f} times: edges are uncertain")
    return told


def _swapped(samples: Samples, found: Demodulated) -> list[str]:
    """Whether what was taken as off varies more than what was taken as on, as where they are swapped."""
    with np.errstate(invalid="ignore"):
        off, on = (np.nanstd(one, axis=0) for one in (found.ambient, found.ambient + found.signal))
    if len(found.time_s) < LEAST_TO_COMPARE or not (off > SWAPPED * on).all():
        return []
    remedy = "the column of states" if samples.clock is None else "--on"
    return [
        f"readings taken as off vary more than {SWAPPED:g} times as much as those taken as on: an emitter's light "
        f"follows the motion and the room does not, so on and off may be swapped ({remedy})"
    ]


def _table(samples: Samples, kept: Demodulated | Averaged, options: Options, recording: Recording) -> str:
    """Readings as CSV: time, emitter; of each channel signal, uncertainty, ambient light and whether it clipped."""
    heads, lists = ["time_s", "emitter"], [kept.time_s.tolist(), kept.emitter.tolist()]
    for place, channel in enumerate(zip(samples.names, samples.units, strict=True)):
        name, unit = _plain(*channel)
        heads += [f"{name}{unit}", f"u_{name}{unit}", f"ambient_{name}{unit}", f"clipped_{name}"]
        lists += [part[:, place].tolist() for part in (kept.signal, kept.u, kept.ambient, kept.clipped)]
    for head, values in beside(recording, options, kept.time_s).items():
        heads.append(head.replace(",", " ").replace('"', " "))
        lists.append(values.tolist())
    formats = [_form(head) for head in heads]
    rows = [",".join(form(value) for form, value in zip(formats, row, strict=True)) for row in zip(*lists, strict=True)]
    remarks = [f"# readings of {recording.provenance.file}: on less off, {options.kernel}"]
    if isinstance(kept, Averaged):
        remarks.append(f"# means of {kept.readings} readings, whole periods of {options.mains_hz:g} Hz")
    if recording.provenance.simulated:
        remarks.append("# simulated: yes")
    return "\n".join([*remarks, ",".join(heads), *rows]) + "\n"


def _plain(name: str, unit: str) -> tuple[str, str]:
    """Name of a channel without commas and spaces, and its unit as the end of a header."""
    return re.sub(r"[,\s\"]+", "_", name), f" ({unit})" if unit else ""


def _form(head: str) -> Callable[[Any], str]:
    """How a column is written: whole numbers whole, times to the microsecond, gaps empty."""
    if head == "emitter" or head.startswith("clipped_"):
        return lambda value: str(int(value))
    digits = ".6f" if head == "time_s" else ".9g"
    return lambda value: "" if value != value else format(value, digits)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def named(channel: Sequence[str] | None) -> tuple[str, ...]:
    """Names of channels as an option gives them, none twice."""
    return tuple(dict.fromkeys(channel or ()))

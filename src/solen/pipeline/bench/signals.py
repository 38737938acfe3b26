"""Columns of a recording to the signals of sensors: which column is the time, the angle, a receiver, and of whom.

What is named on the command line is taken by its name; what is not is told by its quantity, unit or words, and where
that leaves a doubt it is asked for with the columns that there are.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.analysis import Signals, TimeBase, side_of, time_base
from solen.analysis.clocks import align
from solen.analysis.demodulation import Demodulated, find_clock, slots_of, subtract
from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.pipeline.bench.told import ENDS, NAMED_UNITS, told, told_receivers, words_of
from solen.recording import Channel, Recording
from solen.recording.words import heading, plain
from solen.units import factor

NOWHERE = ""
"""Name of an angle that is not to be looked for in a recording."""
_DOTTED = re.compile(r"(.+)[.:/]([^.:/]+)")
_SLOW_S = 1.0  # a step of a time without a unit from which on it may be samples or ms
_HIGH_V = 100.0  # volts that no receiver here shows
_TURN_DEG = 360.0
_FAR_DEG = 720.0  # an angle beyond two turns is counted in something else


@dataclass(frozen=True)
class Columns:
    """Which columns are what, as asked for.

    Attributes
    ----------
    time, angle
        Names of columns, or None for those that are told by themselves.
    channels
        Receiver (with its sensor before a point, where it has one) and column.
    time_unit
        Unit of a time without one.
    rate_hz
        Samples in a second, of a recording without times.
    zero_deg, flip
        What the angle reads at rest, and whether it counts the other way.
    """

    time: str | None = None
    angle: str | None = None
    channels: tuple[tuple[str, str], ...] = ()
    time_unit: str | None = None
    rate_hz: float | None = None
    zero_deg: float = 0.0
    flip: bool = False


@dataclass(frozen=True)
class Sampled:
    """Columns of one recording on its own clock: ``angle_deg`` is None where there is none.

    ``subtracted`` says that ambient light was taken out, so that no light is 0 V.
    """

    base: TimeBase
    angle_deg: FloatArray | None
    receivers: tuple[str, ...]
    volts: FloatArray
    warnings: tuple[str, ...]
    clipped: NDArray[np.bool_] | None = None
    subtracted: bool = False


def named_channels(texts: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Receivers and columns of ``NAME=COLUMN`` texts; a name alone is that of its column."""
    found = []
    for text in texts:
        name, separator, column = text.partition("=")
        if not name.strip() or (separator and not column.strip()):
            raise SpecError("--channel", value=text, limit="must be NAME=COLUMN", remedy="as in --channel left=V_L")
        found.append((name.strip(), (column if separator else name).strip()))
    twice = [name for name, count in Counter(name for name, _ in found).items() if count > 1]
    if twice:
        raise SpecError("--channel", value=twice[0], limit="is named twice", remedy="give each receiver its own name")
    return tuple(found)


def sampled(recording: Recording, asked: Columns, *, need_angle: bool = False) -> Sampled:
    """Samples of a recording in the order of their time.

    Raises
    ------
    DataError
        Where a column is missing, holds no numbers or has a unit of another kind.
    """
    warnings = list(recording.warnings)
    times = _time_s(recording, asked, warnings)
    base = time_base(times, f"{recording.provenance.file}: time")
    angle = _angle_deg(recording, asked, warnings, need=need_angle)
    taken = {one.name for one in (_time(recording, asked), _angle(recording, asked)) if one is not None}
    channels = _receivers(recording, asked, taken)
    names = tuple(channels)
    volts = np.column_stack([_volts(channel, warnings) for channel in channels.values()])
    flags = [_flags(recording, channel) for channel in channels.values()]
    clipped = np.column_stack(flags)[base.order] if any(one.any() for one in flags) else None
    angle = None if angle is None else angle[base.order]
    bare = all(recording.find(*_ambient(channel)) is not None for channel in channels.values())
    one = Sampled(base, angle, names, volts[base.order], (*base.warnings, *warnings), clipped, bare)
    return _whole(recording, one)


def _whole(recording: Recording, one: Sampled) -> Sampled:
    """Samples without those that miss a number."""
    good = np.isfinite(one.volts)
    for name, held in zip(one.receivers, good.T, strict=True):
        if not held.any():
            raise DataError(f"{recording.provenance.file}: {name}", limit="holds no number", remedy="leave it out")
    kept = np.asarray(good.all(axis=1))
    if one.angle_deg is not None:
        kept &= np.isfinite(one.angle_deg)
    if kept.all():
        return one
    said = f"{int((~kept).sum())} of {kept.size} samples miss a number and are left out"
    return replace(part(one, kept), warnings=(*one.warnings, said))


def part(one: Sampled, kept: NDArray[np.bool_]) -> Sampled:
    """Some of the samples."""
    base = replace(one.base, order=one.base.order[kept], time_s=one.base.time_s[kept])
    angle = None if one.angle_deg is None else one.angle_deg[kept]
    clipped = None if one.clipped is None else one.clipped[kept]
    return replace(one, base=base, angle_deg=angle, volts=one.volts[kept], clipped=clipped)


def _ambient(channel: Channel) -> tuple[str, str]:
    """Names of a column beside a receiver's that holds what was subtracted from it."""
    name = ENDS.sub("", channel.name)
    return f"ambient_{name}", f"{name}_ambient"


def _flags(recording: Recording, channel: Channel) -> NDArray[np.bool_]:
    """Samples that a column beside a receiver's marks as clipped, ``clipped_left`` or ``left_clipped``."""
    name = ENDS.sub("", channel.name)
    found = recording.find(f"clipped_{name}", f"{name}_clipped")
    return np.zeros(channel.values.size, dtype=bool) if found is None else np.asarray(found.values > 0.5)


def column(recording: Recording, name: str, option: str) -> Channel:
    """Column of a name, with or without its unit; `DataError` with the columns that there are."""
    last = name.rpartition(".")[2]
    found = recording.find(name, heading(name).name, last, heading(last).name)
    if found is not None:
        return found
    what = f"{recording.provenance.file or 'recording'}: {option} {name}"
    if recording.label(name, heading(name).name) is not None:
        raise DataError(what, limit="is a column of words, not of numbers", remedy=_there(recording))
    raise DataError(what, limit="no such column", remedy=_there(recording))


def _there(recording: Recording) -> str:
    shown = recording.names[:12]
    more = len(recording.names) - len(shown)
    return f"its columns are {', '.join(shown)}" + (f" and {more} more" if more else "")


def _time(recording: Recording, asked: Columns) -> Channel | None:
    if asked.time is not None:
        return column(recording, asked.time, "--time")
    if asked.rate_hz is not None:
        return None
    return told(recording, "time")


def _angle(recording: Recording, asked: Columns) -> Channel | None:
    if asked.angle == NOWHERE:
        return None
    if asked.angle is not None:
        return column(recording, asked.angle, "--angle")
    return told(recording, "angle")


def _time_s(recording: Recording, asked: Columns, warnings: list[str]) -> FloatArray:
    channel = _time(recording, asked)
    file = recording.provenance.file or "recording"
    if channel is None:
        if asked.rate_hz is None:
            remedy = f"name it with --time, or give --rate-hz; {_there(recording)}"
            raise DataError(file, limit="has no column that is told to be the time", remedy=remedy)
        return np.arange(recording.channels[0].values.size) / asked.rate_hz
    unit = asked.time_unit or channel.unit or NAMED_UNITS.get(plain(channel.name), "")
    if unit:
        scale = factor(unit, "s")
        if scale is None:
            remedy = "name another column with --time, or its unit with --time-unit"
            raise DataError(f"{file}: {channel.name}", value=unit, limit="is no unit of time", remedy=remedy)
        return channel.values * scale
    steps = np.diff(channel.values)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if usual >= _SLOW_S:
        limit = f"states no unit, and its steps of {usual:.3g} may be ms, s or samples"
        raise DataError(f"{file}: {channel.name}", limit=limit, remedy="give --time-unit ms, or --rate-hz")
    warnings.append(
        f"{channel.name} states no unit; it is taken for s, so that there are {1 / usual:.4g} samples a second"
        if usual
        else f"{channel.name} states no unit; it is taken for s"
    )
    return channel.values


def _angle_deg(recording: Recording, asked: Columns, warnings: list[str], *, need: bool) -> FloatArray | None:
    channel = _angle(recording, asked)
    file = recording.provenance.file or "recording"
    if channel is None:
        if need:
            remedy = (
                "name it with --angle, a log of the stage with --angle-file, or give --amplitude-deg; "
                f"{_there(recording)}"
            )
            raise DataError(file, limit="has no column that is told to be the angle", remedy=remedy)
        return None
    scale = factor(channel.unit, "deg") if channel.unit else 1.0
    if scale is None or channel.unit == "1":
        limit = "is no unit of an angle"
        raise DataError(f"{file}: {channel.name}", value=channel.unit, limit=limit, remedy="name another with --angle")
    if not channel.unit:
        _check_degrees(channel, file, warnings)
    return (-1.0 if asked.flip else 1.0) * (_unwound(channel, scale, warnings) - asked.zero_deg)


def _check_degrees(channel: Channel, file: str, warnings: list[str]) -> None:
    """Whether an angle without a unit may be degrees."""
    farthest = float(np.nanmax(np.abs(channel.values), initial=0.0))
    if farthest > _FAR_DEG:
        limit = f"goes to {farthest:.4g} and states no unit that is known, so it is no angle in degrees"
        remedy = "state its unit in the header: deg, mdeg, rad or mrad; or name another column with --angle"
        raise DataError(f"{file}: {channel.name}", limit=limit, remedy=remedy)
    if not plain(channel.name).endswith("deg"):
        warnings.append(f"{channel.name} states no unit; it is taken for degrees")


def _unwound(channel: Channel, scale: float, warnings: list[str]) -> FloatArray:
    """Degrees, counted on where they pass from 360 to 0 or from 180 to -180 and back."""
    angle = np.asarray(channel.values * scale)
    held = np.isfinite(angle)
    steps = np.diff(angle[held])
    if not (np.abs(np.abs(steps) - _TURN_DEG) < 0.5 * (_TURN_DEG - 180.0)).any() or np.ptp(angle[held]) > _TURN_DEG:
        return angle
    unwound = np.unwrap(angle[held], period=_TURN_DEG)
    angle[held] = unwound - _TURN_DEG * np.round(np.median(unwound) / _TURN_DEG)
    warnings.append(f"{channel.name} passes from one end of a turn to the other; it is counted on from there")
    return angle


def _receivers(recording: Recording, asked: Columns, taken: set[str]) -> dict[str, Channel]:
    """Columns of the receivers, by the names that they are given."""
    if asked.channels:
        named = {name: column(recording, text, "--channel") for name, text in asked.channels}
        _check_once(recording, [one.name for one in named.values()], taken)
        return named
    found = told_receivers([one for one in recording.channels if one.name not in taken])
    if not found:
        limit = "has no column that is told to be a receiver's voltage"
        remedy = f"name them with --channel NAME=COLUMN; {_there(recording)}"
        raise DataError(recording.provenance.file or "recording", limit=limit, remedy=remedy)
    return {one.name: one for one in found}


def _check_once(recording: Recording, names: Sequence[str], taken: set[str]) -> None:
    """`SpecError` where a column is to be two things."""
    for name, count in Counter([*names, *taken]).items():
        if count > 1:
            limit = f"is named for two things in {recording.provenance.file}"
            raise SpecError("--channel", value=name, limit=limit, remedy="give each its own column")


def _volts(channel: Channel, warnings: list[str]) -> FloatArray:
    if channel.unit and channel.unit != "1":
        return channel.to("V")
    if not ENDS.search(channel.name):
        largest = float(np.nanmax(np.abs(channel.values), initial=0.0))
        doubt = f"; up to {largest:.4g} V is much: are they mV?" if largest > _HIGH_V else ""
        warnings.append(f"{channel.name} states no unit; it is taken for V{doubt}")
    return channel.values


def by_sensor(names: Sequence[str], label: str, *, alone: bool) -> dict[str, dict[str, int]]:
    """Receivers of each sensor and the columns' places, by names such as ``S1.left`` or ``S1_L`` beside ``S2_L``.

    ``label`` is the file's own; it stands before the sensor's where there are several files.
    """
    parts = [_DOTTED.fullmatch(name) for name in names]
    split = [(part[1], part[2]) if part else ("", name) for part, name in zip(parts, names, strict=True)]
    if not any(parts):
        split = _by_side(names)
    found: dict[str, dict[str, int]] = {}
    for place, (sensor, receiver) in enumerate(split):
        full = label if not sensor else sensor if alone else f"{label}.{sensor}"
        found.setdefault(full, {})[receiver] = place
    return found


def _by_side(names: Sequence[str]) -> list[tuple[str, str]]:
    """Sensor and receiver of names that differ in a side and something else: both sides of each must be there."""
    bases = [(_without_side(name), side_of(name)) for name in names]
    pairs = Counter(bases)
    sensors = {base for base, _ in bases}
    whole = all(pairs[base, side] == 1 for base in sensors for side in ("left", "right"))
    if len(sensors) > 1 and whole and len(names) == 2 * len(sensors):
        return bases
    return [("", name) for name in names]


def _without_side(name: str) -> str:
    return " ".join(word for word in words_of(name) if not side_of(word) and word.lower() != "v")


def with_log(
    one: Sampled, log: Recording, asked: Columns, path: Path
) -> tuple[Sampled, list[str], list[dict[str, Any]]]:
    """Samples with the angle of a log on another clock, what to know, and how the clocks differ."""
    warnings: list[str] = []
    times = time_base(_time_s(log, asked, warnings), f"{log.provenance.file}: time")
    angle = _angle_deg(log, asked, warnings, need=True)
    assert angle is not None  # noqa: S101  _angle_deg() has refused
    held = np.isfinite(angle[times.order])
    found = align(one.base.time_s, one.volts, times.time_s[held], angle[times.order][held])
    aligned = part(replace(one, angle_deg=found.angle_deg), np.isfinite(found.angle_deg))
    told = {
        "file": path.name,
        "angle_file": log.provenance.file,
        "lag_s": found.lag_s,
        "u_lag_s": found.u_lag_s,
        "rate_ppm": found.rate_ppm,
        "u_rate_ppm": found.u_rate_ppm,
    }
    said = [f"{log.provenance.file}: {line}" for line in (*times.warnings, *warnings)]
    return aligned, [*said, *found.warnings], [told]


def signals_of(one: Sampled, angle_deg: FloatArray, label: str, source: Path, alone: bool) -> list[Signals]:
    """Signals of each sensor of a recording; ``alone`` where it is the only one."""
    found = []
    for sensor, receivers in by_sensor(one.receivers, label, alone=alone).items():
        places = list(receivers.values())
        clipped = None if one.clipped is None else one.clipped[:, places]
        volts = one.volts[:, places]
        found.append(Signals(sensor, tuple(receivers), one.base.time_s, angle_deg, volts, None, source.name, clipped))
    return found


def demodulated(one: Sampled, rate_hz: float, emitters: int, settle_us: float) -> dict[str, Sampled]:
    """On less off of a waveform whose emitters switch, by emitter; the name is empty where there is one.

    The angle is that at the middle of each on slot, on a straight line between samples.
    """
    clock = find_clock(one.base.time_s, one.volts, rate_hz, emitters=emitters)
    states = clock.states(1e-6 * settle_us, emitters)
    found = subtract(slots_of(one.base.time_s, one.volts, states, gap_s=clock.shorter_s))
    made = {}
    for emitter in found.emitters:
        here = found.of(emitter)
        base = time_base(found.time_s[here], "readings")
        angle = None if one.angle_deg is None else np.interp(base.time_s, one.base.time_s, one.angle_deg)
        said = [*one.warnings, *base.warnings, *_switching(found, rate_hz, clock.rate_hz)]
        volts, clipped = found.signal[here][base.order], found.clipped[here][base.order]
        name = "" if emitters == 1 else f"E{emitter}"
        made[name] = Sampled(base, angle, one.receivers, volts, tuple(said), clipped if clipped.any() else None, True)
    return made


def _switching(found: Demodulated, rate_hz: float, seen_hz: float) -> list[str]:
    told = [
        f"ambient light is subtracted: a reading is on less the mean of off before and after, {found.time_s.size} "
        f"readings at {seen_hz:.6g} Hz ({rate_hz:g} Hz was stated)"
    ]
    missing = sum(found.counts.missing.values())
    return [*told, f"{missing} on slots are missing from the recording"] if missing else told

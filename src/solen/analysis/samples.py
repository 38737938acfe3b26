"""Samples of a recording: times, voltages and stimulus from its columns, in s, V and the unit of the stimulus.

Public names: `sampled`, `sample_times`, `ambient_by_side`, `time_scale`, `receivers_unit` and `receiver_scale`.
"""

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from solen.analysis.signals import TIMES, AngleSource, SignalOptions, Waveforms
from solen.analysis.stimulus_column import StimulusColumn, stimulus_column
from solen.analysis.timebase import TimeBase, time_base
from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError, SpecError
from solen.ranks import Caution, warning
from solen.recording import Channel, Recording
from solen.recording.column_roles import (
    ENDS_IN_V,
    NAMED_UNITS,
    column_list,
    column_of,
    companion,
    named_column,
    receiver_columns,
    side_of,
)
from solen.recording.headings import plain
from solen.recording.stimulus import ANGLE
from solen.spec.strict import repeated
from solen.units import factor

_BRACKETED = re.compile(r"[(\[]\s*([^()\[\]\d]+?)\s*[)\]]\s*$")  # a final word in brackets, usually a unit
_AMBIGUOUS_STEP = 1.0  # times without a unit and with at least this step may be ms or sample numbers
_MAX_RECEIVER_V = 100.0


def ambient_by_side(recording: Recording) -> dict[str, float]:
    """Return the mean ambient light subtracted from the right and the left receiver, keyed by side, if recorded."""
    columns = {side: recording.find(f"{side}_ambient", f"ambient_{side}") for side in ("right", "left")}
    return {
        side: float(np.nanmean(column.values))
        for side, column in columns.items()
        if column is not None and np.isfinite(column.values).any()
    }


def sampled(recording: Recording, options: SignalOptions, angle: AngleSource = "optional") -> Waveforms:
    """Read the unprocessed samples of a recording.

    Parameters
    ----------
    recording
        Recording with its columns.
    options
        Roles of the columns.
    angle
        With ``elsewhere``, no angle, force or depth is read.

    Raises
    ------
    DataError, SpecError
        If a column is missing, contains no numbers or has an unsuitable unit.
    """
    warnings: list[Caution] = list(recording.warnings)
    base = sample_times(recording, options, warnings)
    driving = None if angle == "elsewhere" else stimulus_column(recording, options, base, warnings)
    channels = _receivers(recording, options, driving)
    warnings += [] if options.channel else _unused_warnings(recording, channels)
    unit, file = receivers_unit(channels.values()), recording.provenance.name
    flags = [_clipped_flags(recording, channel) for channel in channels.values()]
    samples = Waveforms(
        time_s=base.time_s,
        step_s=base.step_s,
        receivers=tuple(channels),
        volts=np.column_stack(
            [channel.values * receiver_scale(channel, unit, file, warnings) for channel in channels.values()]
        )[base.order],
        unit=unit,
        angle_deg=None if driving is None else driving.values,
        stimulus=ANGLE if driving is None else driving.stimulus,
        cell=None if driving is None else driving.cell,
        clipped=np.column_stack(flags)[base.order] if any(flag.any() for flag in flags) else None,
        ambient_subtracted=all(companion(recording, channel, "ambient") is not None for channel in channels.values()),
        window_s=_window_s(recording),
        warnings=(*base.warnings, *warnings),
    )
    return _complete(samples, recording.provenance.name)


def _window_s(recording: Recording) -> float:
    """Return the averaging time of each row, as written by `solen bench demodulate`."""
    column = recording.find("window")
    return 0.0 if column is None or column.unit != "s" else float(np.nanmedian(column.values))


def _complete(samples: Waveforms, file: str) -> Waveforms:
    """Return the samples in which no number is missing."""
    finite = np.isfinite(samples.volts)
    for name, column in zip(samples.receivers, finite.T, strict=True):
        if not column.any():
            raise DataError(f"{file}: {name}", limit="contains no number", remedy="omit it")
    kept = np.asarray(finite.all(axis=1))
    if samples.angle_deg is not None:
        kept &= np.isfinite(samples.angle_deg)
    if kept.all():
        return samples
    caution = warning(f"{int((~kept).sum())} of {kept.size} samples lack a number and are omitted")
    return replace(samples.rows(kept), warnings=(*samples.warnings, caution))


def _clipped_flags(recording: Recording, channel: Channel) -> BoolArray:
    marks = companion(recording, channel, "clipped")
    return np.zeros(channel.values.size, dtype=bool) if marks is None else np.asarray(marks.values > 0.5)


def _time_column(recording: Recording, options: SignalOptions) -> Channel | None:
    if options.time is not None:
        return named_column(recording, options.time, "--time")
    return column_of(recording, "time") if options.rate_hz is None else None


def sample_times(
    recording: Recording, options: SignalOptions, warnings: list[Caution], named: tuple[str, str] = TIMES
) -> TimeBase:
    """Return the order and times of a recording's samples, and append assumptions to the warnings.

    ``named`` contains the names of the options that specify the time column and the rate.
    """
    return time_base(_time_s(recording, options, warnings, named), f"{recording.provenance.file}: time")


def _time_s(
    recording: Recording, options: SignalOptions, warnings: list[Caution], named: tuple[str, str]
) -> FloatArray:
    channel, file = _time_column(recording, options), recording.provenance.name
    if channel is None:
        if options.rate_hz is None:
            remedy = f"name the time column with {named[0]}, or specify the rate with {named[1]}; "
            remedy += column_list(recording)
            raise DataError(file, limit="no column is recognised as the time", remedy=remedy)
        return np.arange(recording.channels[0].values.size) / options.rate_hz
    return channel.values * time_scale(channel, options.time_unit, file, warnings)


def time_scale(channel: Channel, unit: str | None, file: str, warnings: list[Caution]) -> float:
    """Return the factor from a time column to s, and append a warning to ``warnings`` if the unit is assumed.

    The unit is ``unit``, otherwise that of the column.

    Raises
    ------
    DataError
        If the unit is not a time unit, or steps without a unit are plausible in several units.
    """
    unit = unit or channel.unit or NAMED_UNITS.get(plain(channel.name), "")
    if not unit:
        return _seconds_assumed(channel, file, warnings)
    scale = factor(unit, "s")
    if scale is None:
        remedy = "name another column with --time, or specify the unit with --time-unit"
        raise DataError(f"{file}: {channel.name}", value=unit, limit="is not a time unit", remedy=remedy)
    return scale


def _seconds_assumed(channel: Channel, file: str, warnings: list[Caution]) -> float:
    steps = np.diff(channel.values)
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if step >= _AMBIGUOUS_STEP:
        limit = f"specifies no unit, and its steps of {step:.3g} may be ms, s or samples"
        raise DataError(
            f"{file}: {channel.name}", limit=limit, remedy="specify --time-unit (s, ms, us or min) or --rate-hz"
        )
    rate = f", i.e. {1 / step:.4g} samples per second" if step else ""
    warnings.append(warning(f"the header {channel.name} specifies no unit; s is assumed{rate}"))
    return 1.0


def _receivers(recording: Recording, options: SignalOptions, driving: StimulusColumn | None) -> dict[str, Channel]:
    """Return the receiver columns, keyed by receiver name."""
    time = _time_column(recording, options)
    taken = {*(() if time is None else (time.name,)), *(() if driving is None else driving.columns)}
    if options.channel:
        named = {name: named_column(recording, text, "--channel") for name, text in options.named_receivers}
        twice = repeated([*(column.name for column in named.values()), *taken])
        if twice is not None:
            limit = f"has two roles in {recording.provenance.file}"
            raise SpecError("--channel", value=twice, limit=limit, remedy="use a different column for each role")
        return named
    columns = receiver_columns([channel for channel in recording.channels if channel.name not in taken])
    if not columns:
        remedy = f"name the columns with --channel NAME=COLUMN; {column_list(recording)}"
        raise DataError(recording.provenance.name, limit="no column is recognised as a receiver voltage", remedy=remedy)
    return {column.name: column for column in columns}


def _unused_warnings(recording: Recording, receivers: Iterable[str]) -> list[Caution]:
    """Return warnings about unused columns with a receiver name but an unknown unit."""
    names = [channel.name for channel in recording.channels if channel.name not in receivers]
    return [
        warning(
            f'{name} is not used, because "{unit[1]}" is not a known unit; to use it, specify --channel NAME=COLUMN'
        )
        for name in names
        if (unit := _BRACKETED.search(name)) and side_of(name)
    ]


def receivers_unit(channels: Iterable[Channel]) -> str:
    """Return the unit of the receivers: V, unless the unit of one receiver cannot be converted to V."""
    units = [channel.unit for channel in channels if channel.unit and channel.unit != "1"]
    return next((unit for unit in units if factor(unit, "V") is None), "V")


def receiver_scale(channel: Channel, unit: str, file: str, warnings: list[Caution]) -> float:
    """Return the factor from a receiver's unit to the common unit, and append a warning if V is assumed.

    Raises
    ------
    DataError
        If the unit cannot be converted, or is not specified while another receiver is not in V.
    """
    if unit != "V" or (channel.unit and channel.unit != "1"):
        scale = factor(channel.unit, unit) if channel.unit else None
        if scale is None:
            limit = f"cannot be the unit of a receiver if another receiver is in {unit}"
            remedy = "choose receivers with compatible units with --channel NAME=COLUMN"
            raise DataError(f"{file}: {channel.name}", value=channel.unit or "none", limit=limit, remedy=remedy)
        return scale
    if not ENDS_IN_V.search(channel.name):
        largest = float(np.nanmax(np.abs(channel.values), initial=0.0))
        doubt = f"; values up to {largest:.4g} V are unusual: check whether they are in mV"
        unknown = _BRACKETED.search(channel.name)
        reason = f'specifies "{unknown[1]}", which is not a known unit' if unknown else "specifies no unit"
        assumed = f"the header {channel.name} {reason}; V is assumed"
        warnings.append(warning(assumed + (doubt if largest > _MAX_RECEIVER_V else "")))
    return 1.0

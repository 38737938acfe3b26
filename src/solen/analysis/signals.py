"""Signals: the voltages of receivers over time, read from the columns of a recording.

The idea: `SignalOptions` name columns and state what a file leaves out; every other role follows from headers
(`solen.recording.column_roles`). Units become s, degrees and volts; an assumption is a warning, a doubt a refusal.

The interface: `sampled` of a `Recording` gives `Waveforms` as they were recorded (`solen.analysis.waveforms` makes
readings of them); `Signals` are those of one sensor.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from solen.analysis.demodulation.clock import On
from solen.analysis.drive import Drive, driven
from solen.analysis.load_cell import LoadCell
from solen.analysis.timebase import TimeBase, time_base
from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError, SpecError
from solen.ranks import Caution, look_at
from solen.recording import Channel, Provenance, Recording
from solen.recording.column_roles import (
    ENDS_IN_V,
    NAMED_UNITS,
    column_of,
    companion,
    existing,
    named_column,
    receiver_columns,
    side_of,
)
from solen.recording.stimulus import ANGLE, Name, Stimulus
from solen.recording.words import plain
from solen.results import Result
from solen.spec.strict import Finite, Options, refused
from solen.units import factor

_BRACKETED = re.compile(
    r"[(\[]\s*([^()\[\]\d]+?)\s*[)\]]\s*$"
)  # a word in brackets at the end, where a unit is written
_SLOW_S = 1.0  # from this step on, a time without a unit may count samples or ms
_HIGH_V = 100.0  # above what any receiver here shows
TIMES, TIMES_OF_LOG = ("--time", "--rate-hz"), ("--angle-time", "--angle-rate-hz")
"""Options that state the times of a recording, and of a stage's log beside it."""

AngleSource = Literal["optional", "elsewhere"]


class SignalOptions(Options):
    """Which columns of a recording are what."""

    time: str | None = None
    """Column of the time; default: the column whose header names it."""
    angle: str | None = None
    """Column of the angle; default: the column whose header names it."""
    load: str | None = None
    """Column of a force, likewise: in N, mN, kN, gf, kgf or lbf, or in volts with --load-cell."""
    depth: str | None = None
    """Column of a depth, likewise."""
    against: Name | None = None
    """What the voltages are analysed against; default: of several the angle, then the force, then the depth."""
    load_cell: Path | None = None
    """File with [load_cell] (a rig's will do): what a volt of the force's column stands for, with its uncertainty."""
    tare_s: Finite | None = Field(None, gt=0)
    """Seconds at the beginning whose mean force, or depth, is taken for 0."""
    channel: tuple[str, ...] = ()
    """A receiver and its column, NAME=COLUMN, as in --channel left=ai0 right=ai1; S1.left=ai0 names the sensor as well.
    Default: every column in volts."""
    time_unit: str | None = None
    """Unit of a time whose column states none: s, ms, us, min."""
    rate_hz: Finite | None = Field(None, gt=0)
    """Samples per second, for a recording without times."""
    zero_deg: Finite = 0.0
    """Angle reading at rest; it is subtracted."""
    flip_angle: bool = False
    """Count the angle the other way."""
    on_off_hz: Finite | None = Field(None, ge=0)
    """How often per second the emitters of a raw waveform switch on and off, 0 where they do not; default: detected.
    Ambient light is then subtracted first, as solen bench demodulate does."""
    on: On | None = None
    """Whether light makes such a waveform low or high; default: detected by the phase that follows the motion."""
    mains_hz: Finite | None = Field(None, ge=0)
    """Mains of lamps whose flicker is subtracted from such a waveform, 50 or 60, or 0 for none; default: detected."""
    emitters: int = Field(1, ge=1)
    """How many emitters take turns in it, each followed by an off phase; each counts as a sensor."""
    rails: tuple[float, float] | None = None
    """Lowest and highest voltage of the recorder, such as 0 5: samples there are clipped. Default: detected."""
    smooth_ms: Finite | None = Field(None, gt=0)
    """Width of a moving mean over the voltages; none by default."""
    columns: tuple[str, ...] = ()
    """Names of the columns of tables without a header, such as time_s angle_deg left_mV right_mV."""
    sheet: str | None = None
    """Sheet of a workbook."""

    @model_validator(mode="after")
    def _check_columns(self) -> Self:
        for text in self.channel:
            name, equals, column = text.partition("=")
            if not name.strip() or (equals and not column.strip()):
                raise refused("channel", "must be NAME=COLUMN", value=text, remedy="as in --channel left=V_L")
        counts = Counter(name for name, _ in self.named_receivers)
        for name, count in counts.items():
            if count > 1:
                raise refused("channel", "is named twice", value=name, remedy="give each receiver its own name")
        if self.rate_hz is not None and self.time is not None:
            raise refused("rate_hz", "cannot be combined with --time", value=self.rate_hz, remedy="leave one out")
        if self.emitters > 1 and not self.on_off_hz:
            limit = "needs the rate at which each of them switches"
            raise refused("emitters", limit, value=self.emitters, remedy="give --on-off-hz")
        if self.rails is not None and not self.rails[0] < self.rails[1]:
            low, high = self.rails
            raise refused("rails", "must be the lower and the higher voltage", value=f"{low} {high}")
        return self

    @property
    def named_receivers(self) -> tuple[tuple[str, str], ...]:
        """Receivers with their columns, as ``channel`` names them; a name alone is also that of its column."""
        parts = [text.partition("=") for text in self.channel]
        return tuple((name.strip(), (column if equals else name).strip()) for name, equals, column in parts)


class Switching(Result):
    """Switching detected in a waveform.

    Attributes
    ----------
    on_off_hz
        Rate of one emitter, as stated or, if ``detected``, rounded.
    on
        Whether light makes the waveform ``low`` or ``high``.
    mains_hz, flicker_V
        Mains of the lamps whose flicker was subtracted, and its largest amplitude; None without any.
    samples
        Number of samples of the waveform.
    clipped_samples
        Number of samples at a limit, by receiver.
    limits_V
        Lowest and highest voltage of each receiver; None if no limit shows.
    """

    on_off_hz: float
    detected: bool
    on: On
    mains_hz: float | None
    flicker_V: float | None
    samples: int
    clipped_samples: dict[str, int]
    limits_V: dict[str, tuple[float | None, float | None]]


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Voltages of all receivers of a recording, in order of time.

    Attributes
    ----------
    time_s, step_s
        Non-decreasing times, (n,), and the usual step between them.
    receivers, volts
        Names (m,) and voltages (n, m).
    angle_deg
        (n,); None if there is none.
    clipped
        Samples that the recording marks as clipped, (n, m); None if it marks none.
    unit
        Unit of the values: V, or another stated in the recording, such as pF, lux or counts.
    ambient_subtracted
        Whether ambient light was subtracted, so that no light is 0 V.
    window_s
        Averaging time of each; 0 for samples.
    switching
        Switching of the emitters; None if they do not switch.
    stimulus
        What ``angle_deg`` is: an angle, or a force or depth in its own unit.
    cell
        Load cell that measured it, where it is stated.
    warnings
        Assumptions and omissions.
    """

    time_s: FloatArray
    step_s: float
    receivers: tuple[str, ...]
    volts: FloatArray
    angle_deg: FloatArray | None = None
    clipped: BoolArray | None = None
    unit: str = "V"
    ambient_subtracted: bool = False
    window_s: float = 0.0
    switching: Switching | None = None
    stimulus: Stimulus = ANGLE
    cell: LoadCell | None = None
    warnings: tuple[Caution, ...] = ()

    def rows(self, kept: BoolArray) -> "Waveforms":
        """Some of the samples."""
        angle = None if self.angle_deg is None else self.angle_deg[kept]
        clipped = None if self.clipped is None else self.clipped[kept]
        return replace(self, time_s=self.time_s[kept], volts=self.volts[kept], angle_deg=angle, clipped=clipped)


@dataclass(frozen=True, eq=False)
class Signals:
    """One recording of one sensor.

    Attributes
    ----------
    label
        Name of the sensor; recordings of one name are of one sensor.
    receivers
        Names of the receivers, (m,).
    time_s
        Times that never fall, (n,).
    angle_deg
        (n,); of another ``stimulus`` in its unit.
    volts
        (n, m), NaN where there is no reading.
    lens
        Whether it has a lens; None if it is not stated.
    source
        The file.
    clipped
        Samples that the recording marks as clipped, (n, m); None if it marks none.
    provenance
        Of the recording.
    unit
        Of the values: V, or another that the recording states.
    ambient_subtracted
        Whether ambient light was subtracted; clipped samples are then those marked before.
    timing_bound_s
        How far angles and readings may be apart in time, and what states it; None if only the angle shows it.
    ambient_V
        Mean of the ambient light that was subtracted, by side, where the recording states it.
    stimulus, cell
        As in `Waveforms`.
    """

    label: str
    receivers: tuple[str, ...]
    time_s: FloatArray
    angle_deg: FloatArray
    volts: FloatArray
    lens: bool | None = None
    source: str = ""
    clipped: BoolArray | None = None
    provenance: Provenance = field(default_factory=Provenance)
    unit: str = "V"
    ambient_subtracted: bool = False
    timing_bound_s: tuple[float, Literal["recording", "log"]] | None = None
    ambient_V: Mapping[str, float] = field(default_factory=dict)
    stimulus: Stimulus = ANGLE
    cell: LoadCell | None = None


def ambient_by_side(recording: Recording) -> dict[str, float]:
    """Mean of the ambient light that was subtracted from the right and the left receiver, where it is recorded."""
    columns = {side: recording.find(f"{side}_ambient", f"ambient_{side}") for side in ("right", "left")}
    return {
        side: float(np.nanmean(column.values))
        for side, column in columns.items()
        if column is not None and np.isfinite(column.values).any()
    }


def sampled(recording: Recording, options: SignalOptions, angle: AngleSource = "optional") -> Waveforms:
    """Unprocessed samples of a recording.

    Parameters
    ----------
    recording
        Its columns.
    options
        Roles of the columns.
    angle
        With ``elsewhere`` the angle, force or depth is not looked for.

    Raises
    ------
    DataError, SpecError
        If a column is missing, holds no numbers or has a unit of another kind.
    """
    warnings: list[Caution] = list(recording.warnings)
    base = sample_times(recording, options, warnings)
    drive = None if angle == "elsewhere" else driven(recording, options, base, warnings)
    channels = _receivers(recording, options, drive)
    warnings += [] if options.channel else _passed_over(recording, channels)
    unit, file = _unit_of(channels.values()), _file(recording)
    flags = [_clipped_flags(recording, channel) for channel in channels.values()]
    samples = Waveforms(
        time_s=base.time_s,
        step_s=base.step_s,
        receivers=tuple(channels),
        volts=np.column_stack([_values(channel, unit, file, warnings) for channel in channels.values()])[base.order],
        unit=unit,
        angle_deg=None if drive is None else drive.values,
        stimulus=ANGLE if drive is None else drive.stimulus,
        cell=None if drive is None else drive.cell,
        clipped=np.column_stack(flags)[base.order] if any(flag.any() for flag in flags) else None,
        ambient_subtracted=all(companion(recording, one, "ambient") is not None for one in channels.values()),
        window_s=_window_s(recording),
        warnings=(*base.warnings, *warnings),
    )
    return _complete(samples, _file(recording))


def _window_s(recording: Recording) -> float:
    """Time over which each row is a mean, as `solen bench demodulate` writes it."""
    column = recording.find("window")
    return 0.0 if column is None or column.unit != "s" else float(np.nanmedian(column.values))


def _file(recording: Recording) -> str:
    return recording.provenance.file or "recording"


def _complete(samples: Waveforms, file: str) -> Waveforms:
    """Samples that lack no number."""
    finite = np.isfinite(samples.volts)
    for name, held in zip(samples.receivers, finite.T, strict=True):
        if not held.any():
            raise DataError(f"{file}: {name}", limit="holds no number", remedy="leave it out")
    kept = np.asarray(finite.all(axis=1))
    if samples.angle_deg is not None:
        kept &= np.isfinite(samples.angle_deg)
    if kept.all():
        return samples
    warning = look_at(f"{int((~kept).sum())} of {kept.size} samples lack a number and are left out")
    return replace(samples.rows(kept), warnings=(*samples.warnings, warning))


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
    """Order and times of a recording's samples; assumptions are added to the warnings.

    ``named`` are the options that state its column of times and its rate.
    """
    return time_base(_time_s(recording, options, warnings, named), f"{recording.provenance.file}: time")


def _time_s(
    recording: Recording, options: SignalOptions, warnings: list[Caution], named: tuple[str, str]
) -> FloatArray:
    channel, file = _time_column(recording, options), _file(recording)
    if channel is None:
        if options.rate_hz is None:
            remedy = f"name it with {named[0]}, or give {named[1]}; {existing(recording)}"
            raise DataError(file, limit="no column is recognised as the time", remedy=remedy)
        return np.arange(recording.channels[0].values.size) / options.rate_hz
    unit = options.time_unit or channel.unit or NAMED_UNITS.get(plain(channel.name), "")
    if not unit:
        return _seconds_assumed(channel, file, warnings)
    scale = factor(unit, "s")
    if scale is None:
        remedy = "name another column with --time, or its unit with --time-unit"
        raise DataError(f"{file}: {channel.name}", value=unit, limit="is not a unit of time", remedy=remedy)
    return channel.values * scale


def _seconds_assumed(channel: Channel, file: str, warnings: list[Caution]) -> FloatArray:
    steps = np.diff(channel.values)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if usual >= _SLOW_S:
        limit = f"states no unit, and its steps of {usual:.3g} may be ms, s or samples"
        raise DataError(f"{file}: {channel.name}", limit=limit, remedy="give --time-unit ms, or --rate-hz")
    rate = f", which makes {1 / usual:.4g} samples per second" if usual else ""
    warnings.append(look_at(f"{channel.name} states no unit; s is assumed{rate}"))
    return channel.values


def _receivers(recording: Recording, options: SignalOptions, drive: Drive | None) -> dict[str, Channel]:
    """Columns of the receivers by their names."""
    time = _time_column(recording, options)
    taken = {*(() if time is None else (time.name,)), *(() if drive is None else drive.columns)}
    if options.channel:
        named = {name: named_column(recording, text, "--channel") for name, text in options.named_receivers}
        for name, count in Counter([*(one.name for one in named.values()), *taken]).items():
            if count > 1:
                limit = f"has two roles in {recording.provenance.file}"
                raise SpecError("--channel", value=name, limit=limit, remedy="give each role its own column")
        return named
    columns = receiver_columns([channel for channel in recording.channels if channel.name not in taken])
    if not columns:
        remedy = f"name them with --channel NAME=COLUMN; {existing(recording)}"
        raise DataError(_file(recording), limit="no column is recognised as a receiver's voltage", remedy=remedy)
    return {column.name: column for column in columns}


def _passed_over(recording: Recording, channels: Iterable[str]) -> list[Caution]:
    """Columns that are named like a receiver but have an unknown unit, beside others in V."""
    rest = {one.name: _BRACKETED.search(one.name) for one in recording.channels if one.name not in channels}
    return [
        look_at(f'{name} is not used: "{unit[1]}" is not a known unit; --channel NAME=COLUMN uses it')
        for name, unit in rest.items()
        if unit and side_of(name)
    ]


def _unit_of(channels: Iterable[Channel]) -> str:
    """Unit of the receivers: V, unless one states another that cannot be converted to it."""
    units = [one.unit for one in channels if one.unit and one.unit != "1"]
    return next((unit for unit in units if factor(unit, "V") is None), "V")


def _values(channel: Channel, unit: str, file: str, warnings: list[Caution]) -> FloatArray:
    """Values of a receiver in the unit of all."""
    if unit != "V" or (channel.unit and channel.unit != "1"):
        scale = factor(channel.unit, unit) if channel.unit else None
        if scale is None:
            limit = f"is not a unit that a receiver can have beside one in {unit}"
            remedy = "choose receivers of one kind with --channel NAME=COLUMN"
            raise DataError(f"{file}: {channel.name}", value=channel.unit or "none", limit=limit, remedy=remedy)
        return channel.values * scale
    if not ENDS_IN_V.search(channel.name):
        largest = float(np.nanmax(np.abs(channel.values), initial=0.0))
        doubt = f"; up to {largest:.4g} V is much: are they mV?" if largest > _HIGH_V else ""
        unknown = _BRACKETED.search(channel.name)
        states = f'states "{unknown[1]}", which is not a known unit' if unknown else "states no unit"
        warnings.append(look_at(f"{channel.name} {states}; V is assumed{doubt}"))
    return channel.values

"""Samples of several channels and the emitter state at each sample, from the columns of a recording.

Public names: `samples_of`, `DemodulationOptions`, `Samples` and `other_columns`.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from solen.analysis.demodulation.clock import Clock, On, find_clock
from solen.analysis.demodulation.rejection import Kernel
from solen.analysis.demodulation.slots import OFF
from solen.arrays import FloatArray, IntArray
from solen.errors import DataError, SpecError
from solen.recording import Channel, Recording
from solen.recording.column_roles import column_of, receiver_columns
from solen.spec.strict import Finite, Options, refused

STATES = ("state", "emitter", "led", "emitter state")
VOLTAGES = ("V", "mV", "µV")
OFF_WORDS, ON_WORDS = ("off", "dark", "aus", "0", "false"), ("on", "light", "an", "ein", "1", "true")
DEFAULT_SETTLE_US = 300.0
"""Time omitted after each switching edge in a waveform: about ten time constants of a receiver with a 2 kΩ load."""


class DemodulationOptions(Options):
    """Options for subtracting ambient light from a recording."""

    channel: tuple[str, ...] = ()
    """Column of a receiver; repeatable. Default: all columns in V."""
    time: str | None = None
    """Time column; default: the column whose header denotes time."""
    state: str | None = None
    """Column with the number of the emitter that is on: 0 or off for none. Default: a column called state, emitter
    or led.
    """
    rate_hz: Finite | None = Field(None, gt=0)
    """Readings per second from one emitter; the edges are then found in the waveform itself."""
    emitters: int = Field(1, ge=1)
    """Number of emitters that are switched in sequence in a waveform, each followed by an off phase."""
    on: On = "low"
    """Whether light makes the readings low, as with the paper's receivers, or high."""
    settle_us: Finite | None = Field(None, ge=0)
    """Time omitted after each switching edge; default: 300 in a waveform, 0 with states."""
    kernel: Kernel = "two-sided"
    """Off phases that are subtracted: two-sided for those before and after; one-sided for the one before, for
    comparison.
    """
    mains_hz: Finite | None = Field(None, ge=0)
    """Mains frequency of flickering lamps, 50 or 60. Default: detected in a waveform, whose flicker is fitted to the
    off phases and subtracted. With single samples per slot, readings are averaged over whole mains periods only
    if this frequency is specified. 0 ignores flicker.
    """
    low: Finite | None = None
    """Value at or below which a channel is clipped; default: detected from its extreme values."""
    high: Finite | None = None
    """Value at or above which a channel is clipped; default: detected from its extreme values."""

    @model_validator(mode="after")
    def _check_state(self) -> Self:
        if self.state is not None and self.rate_hz is not None:
            limit = "has no effect with --state, which specifies when an emitter is on"
            raise refused("rate_hz", limit, value=self.rate_hz, remedy="omit one of the two")
        return self


@dataclass(frozen=True, eq=False)
class Samples:
    """N samples of C channels.

    Attributes
    ----------
    time_s, values
        Times (N,) and values (N, C).
    names, units
        Names and units of the channels; an unknown unit is empty.
    state
        States (N,), numbered as in `solen.analysis.demodulation.slots`.
    settle_s
        Time omitted after a switching edge.
    clock
        Emitter clock, if the states were detected in the waveform; None if they were recorded.
    """

    time_s: FloatArray
    values: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]
    state: IntArray
    settle_s: float
    clock: Clock | None

    @property
    def slot_settle_s(self) -> float:
        """Time to discard at the beginning of a slot; 0 if the clock's states already exclude it."""
        return self.settle_s if self.clock is None else 0.0

    @property
    def gap_s(self) -> float | None:
        """Time without samples that separates two slots of the same state."""
        return None if self.clock is None else self.clock.shorter_s

    @property
    def rate_hz(self) -> float | None:
        """Rate of the "on" slots, from the clock."""
        return None if self.clock is None else self.clock.rate_hz


def samples_of(recording: Recording, options: DemodulationOptions) -> Samples:
    """Return the samples of a recording with the emitter state at each sample, from a column or from the waveform.

    Raises
    ------
    DataError, SpecError
        If a column is missing, or neither the states nor a rate are known.
    """
    time = _time(recording, options)
    time_s = time.to("s") if time.unit else time.values
    state = _recorded_state(recording, options)
    channels = _channels(recording, options, time)
    kept = np.isfinite(time_s)
    time_s, values = time_s[kept], np.stack([channel.values for channel in channels], axis=1)[kept]
    names, units = zip(*map(_name_and_unit, channels), strict=True)
    if state is not None:
        return Samples(time_s, values, names, units, state[kept], 1e-6 * (options.settle_us or 0.0), None)
    if options.rate_hz is None:
        limit = "no column is recognised as the emitter state, and no switching rate is specified"
        raise SpecError(
            "--state", limit=limit, remedy="name the column with --state, or specify the switching rate with --rate-hz"
        )
    settle_s = 1e-6 * (DEFAULT_SETTLE_US if options.settle_us is None else options.settle_us)
    clock = find_clock(time_s, values, options.rate_hz, on=options.on, emitters=options.emitters)
    if settle_s >= clock.shorter_s:
        limit = f"leaves no sample of the shorter phase, which lasts {1e6 * clock.shorter_s:.0f} µs"
        raise SpecError("--settle-us", value=1e6 * settle_s, limit=limit, remedy="use a smaller value")
    return Samples(time_s, values, names, units, clock.states(settle_s, options.emitters), settle_s, clock)


def other_columns(recording: Recording, options: DemodulationOptions) -> dict[str, FloatArray]:
    """Return the other numeric columns, e.g. a stage angle, at the samples (N,), keyed by header.

    Missing numbers are interpolated; a column without numbers is omitted.
    """
    time = _time(recording, options)
    time_s = time.to("s") if time.unit else time.values
    kept = np.isfinite(time_s)
    used = {time.name, *(channel.name for channel in _channels(recording, options, time))}
    state = recording.find(*_state_names(options)) if options.rate_hz is None else None
    used |= {state.name} if state is not None else set()
    columns = {}
    for channel in recording.channels:
        known = kept & np.isfinite(channel.values)
        if channel.name not in used and known.any():
            name, unit = _name_and_unit(channel)
            header = f"{name} ({unit})" if unit else name
            columns[header] = np.interp(time_s[kept], time_s[known], channel.values[known])
    return columns


def _time(recording: Recording, options: DemodulationOptions) -> Channel:
    if options.time:
        return recording.channel(options.time)
    return column_of(recording, "time") or recording.need("time")


def _channels(recording: Recording, options: DemodulationOptions, time: Channel) -> Sequence[Channel]:
    """Return the named channels, or all voltages if none is named."""
    if options.channel:
        return [recording.channel(name) for name in dict.fromkeys(options.channel)]
    free = [channel for channel in recording.channels if channel.name != time.name]
    channels = [channel for channel in free if _name_and_unit(channel)[1] in VOLTAGES] or receiver_columns(free)
    if not channels:
        limit = f"no column is in V; the columns are {', '.join(recording.names)}"
        raise SpecError("--channel", limit=limit, remedy="name the receiver columns with --channel")
    return channels


def _name_and_unit(channel: Channel) -> tuple[str, str]:
    """Return the name and unit of a channel; a name with a unit, such as ``right_V``, is split into both."""
    stem, _, end = channel.name.rpartition("_")
    return (stem, end) if not channel.unit and stem and end in VOLTAGES else (channel.name, channel.unit)


def _state_names(options: DemodulationOptions) -> tuple[str, ...]:
    return (options.state,) if options.state else STATES


def _recorded_state(recording: Recording, options: DemodulationOptions) -> IntArray | None:
    """Return the states from a column of numbers or words; None with a specified rate or without a state column."""
    if options.rate_hz is not None:
        return None
    names = _state_names(options)
    channel, texts = recording.find(*names), recording.label(*names)
    if channel is not None:
        return _states_of_numbers(channel)
    if texts is None:
        return None if options.state is None else _states_of_numbers(recording.channel(options.state))
    return np.array([_state_of_word(text, row) for row, text in enumerate(texts, start=1)], dtype=np.int64)


def _states_of_numbers(channel: Channel) -> IntArray:
    values = np.where(np.isfinite(channel.values), channel.values, -1.0)
    invalid = np.flatnonzero((values != np.rint(values)) | (values < -1.0))
    if invalid.size:
        limit = "must be an integer: 0 if all emitters are off, otherwise the number of the emitter that is on"
        raise DataError(f"{channel.name} in row {int(invalid[0]) + 1}", value=float(values[invalid[0]]), limit=limit)
    return values.astype(np.int64)


def _state_of_word(text: str, row: int) -> int:
    """Return the state for a word: off, on, on 2, emitter 2; an empty word is a sample without a state."""
    word = text.strip().casefold()
    if not word:
        return -1
    if word in OFF_WORDS:
        return OFF
    if word in ON_WORDS:
        return 1
    number = re.fullmatch(r"(?:on|led|emitter|e)?[\s_#-]*(\d+)", word)
    if number is None:
        limit = "must be off, on, a number, or emitter followed by its number"
        raise DataError(f"state in row {row}", value=text, limit=limit)
    return int(number[1])

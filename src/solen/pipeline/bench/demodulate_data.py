"""What a recording is demodulated from: its samples, and the state of the emitters at each."""

import re
from dataclasses import dataclass
from typing import get_args

import numpy as np

from solen.analysis.demodulation import OFF, Samples, find_clock
from solen.analysis.demodulation.clock import On
from solen.analysis.demodulation.rejection import KERNELS
from solen.arrays import FloatArray, IntArray
from solen.errors import DataError, SpecError
from solen.pipeline.bench.told import told, told_receivers
from solen.pipeline.outputs import check_choice
from solen.recording import Channel, Recording

TIMES = ("time", "t", "timestamp", "zeit")
STATES = ("state", "emitter", "led", "emitter state")
VOLTAGES = ("V", "mV", "µV")
OFF_WORDS, ON_WORDS = ("off", "dark", "aus", "0", "false"), ("on", "light", "an", "ein", "1", "true")
SETTLE_US = 300.0
"""Time after a switch that is left out of a waveform where none is stated: some ten time constants at 2 kΩ."""
DISTINCT, AT_EXTREME = 100, 4
"""Different values from which on a channel is fine enough to tell clipping, and samples at its extreme that are some.
"""


@dataclass(frozen=True)
class Options:
    """How a recording is demodulated; the command explains them."""

    channels: tuple[str, ...] = ()
    time: str | None = None
    state: str | None = None
    rate_hz: float | None = None
    emitters: int = 1
    on: str = "low"
    settle_us: float | None = None
    kernel: str = "two-sided"
    mains_hz: float | None = None
    low: float | None = None
    high: float | None = None

    def check(self) -> None:
        """`SpecError` where an option is none or has no meaning beside another."""
        check_choice("--on", self.on, get_args(On))
        check_choice("--kernel", self.kernel, KERNELS)
        if self.emitters < 1:
            raise SpecError("--emitters", value=self.emitters, limit="must be at least 1")
        for name, value in (("--rate-hz", self.rate_hz), ("--mains-hz", self.mains_hz)):
            if value is not None and not 0.0 < value < np.inf:
                raise SpecError(name, value=value, limit="must be above 0")
        if self.settle_us is not None and not 0.0 <= self.settle_us < np.inf:
            raise SpecError("--settle-us", value=self.settle_us, limit="must be at least 0")
        if self.state is not None and self.rate_hz is not None:
            limit = "has no meaning beside --state, which says when an emitter is on"
            raise SpecError("--rate-hz", value=self.rate_hz, limit=limit, remedy="leave one of them out")


def samples_of(recording: Recording, options: Options) -> Samples:
    """Samples of a recording with the state of each, as a column says or as the waveform shows."""
    time = _time(recording, options)
    time_s = time.to("s") if time.unit else time.values
    state = _state_column(recording, options)
    channels = _channels(recording, options, time)
    values = np.stack([channel.values for channel in channels], axis=1)
    kept = np.isfinite(time_s)
    time_s, values = time_s[kept], values[kept]
    names, units = zip(*(named_unit(channel) for channel in channels), strict=True)
    if state is not None:
        return Samples(time_s, values, names, units, state[kept], 1e-6 * (options.settle_us or 0.0), None)
    if options.rate_hz is None:
        limit = "neither a column of states nor a rate of switching is known"
        raise SpecError("--state", limit=limit, remedy="name the column, or state --rate-hz 200")
    settle_s = 1e-6 * (SETTLE_US if options.settle_us is None else options.settle_us)
    on: On = "low" if options.on == "low" else "high"
    clock = find_clock(time_s, values, options.rate_hz, on=on, emitters=options.emitters)
    shorter_us = 1e6 * clock.shorter_s
    if 1e6 * settle_s >= shorter_us:
        limit = f"leaves nothing of the shorter phase, which lasts {shorter_us:.0f} µs"
        raise SpecError("--settle-us", value=1e6 * settle_s, limit=limit, remedy="shorten it")
    return Samples(time_s, values, names, units, clock.states(settle_s, options.emitters), settle_s, clock)


def beside(recording: Recording, options: Options, at_s: FloatArray) -> dict[str, FloatArray]:
    """Other columns of numbers, as the angle of a stage, at the times of readings, straight between samples, by head.

    Times (M,) lie within those of the samples; a column without numbers is left out.
    """
    time = _time(recording, options)
    time_s = time.to("s") if time.unit else time.values
    used = {time.name, *_names(_channels(recording, options, time))}
    state = recording.find(*((options.state,) if options.state else STATES))
    used |= {state.name} if state is not None and options.rate_hz is None else set()
    found = {}
    for channel in recording.channels:
        there = np.isfinite(time_s) & np.isfinite(channel.values)
        if channel.name not in used and there.any():
            name, unit = named_unit(channel)
            head = f"{name} ({unit})" if unit else name
            found[head] = np.interp(at_s, time_s[there], channel.values[there])
    return found


def _time(recording: Recording, options: Options) -> Channel:
    if options.time:
        return recording.channel(options.time)
    return recording.find(*TIMES) or told(recording, "time") or recording.need(*TIMES)


def _names(channels: tuple[Channel, ...]) -> set[str]:
    return {channel.name for channel in channels}


def _channels(recording: Recording, options: Options, time: Channel) -> tuple[Channel, ...]:
    """Channels that are named, or else all voltages."""
    if options.channels:
        return tuple(recording.channel(name) for name in options.channels)
    found = tuple(one for one in recording.channels if named_unit(one)[1] in VOLTAGES and one.name != time.name)
    found = found or tuple(told_receivers([one for one in recording.channels if one is not time]))
    if not found:
        names = ", ".join(one.name for one in recording.channels)
        limit = f"no column is in V; there are {names}"
        raise SpecError("--channel", limit=limit, remedy="name the columns of the receivers")
    return found


def named_unit(channel: Channel) -> tuple[str, str]:
    """Name and unit of a channel; of one whose unit is but the end of its name, as right_V, both halves."""
    stem, _, end = channel.name.rpartition("_")
    return (stem, end) if not channel.unit and stem and end in VOLTAGES else (channel.name, channel.unit)


def _state_column(recording: Recording, options: Options) -> IntArray | None:
    """States by a column of numbers or words; None where a rate is stated or there is none."""
    if options.rate_hz is not None:
        return None
    names = (options.state,) if options.state else STATES
    texts = recording.label(*names)
    channel = recording.find(*names)
    if channel is None and texts is None:
        if options.state:
            recording.channel(options.state)
        return None
    if channel is not None:
        return _of_numbers(channel)
    return np.array([_of_word(text, row) for row, text in enumerate(texts or (), start=1)], dtype=np.int64)


def _of_numbers(channel: Channel) -> IntArray:
    values = np.where(np.isfinite(channel.values), channel.values, -1.0)
    wrong = np.flatnonzero((values != np.rint(values)) | (values < -1.0))
    if wrong.size:
        limit = "must be whole: 0 with all emitters off, the emitter's number while one is on"
        raise DataError(f"{channel.name} in row {int(wrong[0]) + 1}", value=float(values[wrong[0]]), limit=limit)
    return values.astype(np.int64)


def _of_word(text: str, row: int) -> int:
    """State of a word: off, on, on 2, emitter 2; empty for a sample without one."""
    word = text.strip().casefold()
    if not word:
        return -1
    if word in OFF_WORDS:
        return OFF
    if word in ON_WORDS:
        return 1
    number = re.fullmatch(r"(?:on|led|emitter|e)?[\s_#-]*(\d+)", word)
    if number is None:
        limit = "must be off, on, a number, or emitter and its number"
        raise DataError(f"state in row {row}", value=text, limit=limit)
    return int(number[1])


def limits_of(samples: Samples, options: Options) -> tuple[FloatArray, FloatArray]:
    """Values of each channel at and beyond which it is taken as cut off: stated, or by how often its extremes come."""
    low, high = np.full(samples.values.shape[1], -np.inf), np.full(samples.values.shape[1], np.inf)
    for place, column in enumerate(samples.values.T):
        there = column[np.isfinite(column)]
        if there.size == 0:
            continue
        low[place] = _extreme(there, float(there.min()), -np.inf) if options.low is None else options.low
        high[place] = _extreme(there, float(there.max()), np.inf) if options.high is None else options.high
    return low, high


def _extreme(values: FloatArray, extreme: float, otherwise: float) -> float:
    """The extreme, where a channel of many values stands at this one far more often than at the one beside it."""
    at = values == extreme
    count = int(at.sum())
    if count < AT_EXTREME:
        return otherwise
    distinct = np.unique(values[:: max(1, len(values) // 100_000)])
    if len(distinct) < DISTINCT:
        return otherwise
    near = distinct[1] if otherwise < 0 else distinct[-2]
    return extreme if count > AT_EXTREME * max(1, int((values == near).sum())) else otherwise

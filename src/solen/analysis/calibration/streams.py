"""Streams of voltages to decode: a recorded file, or lines of CSV as they arrive.

A `Stream` contains an iterator over `Batch` objects with left and right voltages, each of as many readings as are
available.

Public names: `recorded_stream` and `line_stream`.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from solen.analysis.calibration.csv_lines import STDIN, lines_of
from solen.analysis.calibration.file import Ambient
from solen.analysis.samples import receiver_scale, receivers_unit, time_scale
from solen.analysis.signals import AngleSource, SignalOptions, Waveforms
from solen.analysis.waveforms import waveforms
from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError, SpecError
from solen.ranks import Caution
from solen.recording import Channel, Provenance, Recording, read_parts
from solen.recording.column_roles import (
    by_sensor,
    column_list,
    column_of,
    force_in_volts,
    is_companion,
    left_right,
    named_column,
    side_of,
)
from solen.recording.stimulus import ANGLE, FORCE, STIMULI, Stimulus

_STIMULUS_OPTIONS = ("angle", "load", "depth", "against", "load_cell", "tare_s", "zero_deg", "flip_angle")
FILE_OPTIONS = (*_STIMULUS_OPTIONS, "on_off_hz", "on", "mains_hz", "emitters", "smooth_ms", "sheet")
"""Options that apply only to files."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Readings: times (n,), left and right voltages (n, 2; NaN if missing), clipping flags, and true angles (n,)."""

    time_s: FloatArray
    volts: FloatArray
    clipped: BoolArray | None = None
    angle_deg: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Stream:
    """Readings with their sensor, source and unit, and whether ambient light was subtracted (None if unknown).

    ``named`` is False if the sensor name is only the file name.
    """

    batches: Iterator[Batch]
    sensor: str | None = None
    ambient: Ambient | None = None
    provenance: Provenance | None = None
    warnings: tuple[Caution, ...] = ()
    unit: str = "V"
    named: bool = True

    @property
    def simulated(self) -> bool:
        """Whether the readings are simulated."""
        return self.provenance is not None and self.provenance.simulated


def recorded_stream(
    path: Path, options: SignalOptions, sensor: str | None, calibrated: str, stimulus: Stimulus = ANGLE
) -> Stream:
    """Read the readings in a file; ``sensor`` is the sensor to decode, by default the ``calibrated`` sensor.

    Decoded values are compared with the values of the ``stimulus`` in the file, if there are any.

    Raises
    ------
    DataError, SpecError
        If the file contains no sensor with that name, or no left and right receiver.
    """
    _check_stimulus(options, stimulus)
    options = options.model_copy(update={"against": stimulus.name})
    streams: dict[str, Stream] = {}
    for group, recording in read_parts(path, sheet=options.sheet, columns=options.columns or None):
        source: AngleSource = "optional" if _contains_stimulus(recording, options, stimulus) else "elsewhere"
        for emitter, samples in waveforms(recording, options, angle=source).items():
            label = ".".join(filter(None, (group, emitter))) or path.stem
            for name, receivers in by_sensor(samples.receivers, label, single_file=True).items():
                sides = left_right(tuple(receivers))
                if sides is not None:
                    columns = [list(receivers.values())[side] for side in sides]
                    streams[name] = _of_sensor(samples, name, columns, recording.provenance)
    if not streams:
        remedy = "name them with --channel left=COLUMN right=COLUMN"
        raise DataError(path.name, limit="has no pair of a left and a right receiver", remedy=remedy)
    name = chosen_sensor(list(streams), sensor, calibrated, path.name)
    return replace(streams[name], named=sensor is not None or name != path.stem)


def _check_stimulus(options: SignalOptions, stimulus: Stimulus) -> None:
    """Raise `SpecError` if a column is specified for a quantity that is not decoded."""
    limit = f"does not apply, because the calibration is for the {stimulus.name}"
    for name, other in STIMULI.items():
        if name != stimulus.name and (column := getattr(options, other.column)) is not None:
            remedy = f"omit it, and name a {stimulus.name} column with --{stimulus.column}"
            raise SpecError(f"--{other.column}", value=column, limit=limit, remedy=remedy)
    if options.against not in {None, stimulus.name}:
        raise SpecError("--against", value=options.against, limit=limit, remedy="omit it")


def _contains_stimulus(recording: Recording, options: SignalOptions, stimulus: Stimulus) -> bool:
    """Return whether a recording contains the stimulus; volts of a load cell require a known sensitivity."""
    if getattr(options, stimulus.column) is not None or column_of(recording, stimulus.name) is not None:
        return True
    return stimulus is FORCE and options.load_cell is not None and force_in_volts(recording) is not None


def _of_sensor(samples: Waveforms, name: str, columns: list[int], provenance: Provenance) -> Stream:
    clipped = None if samples.clipped is None else samples.clipped[:, columns]
    batch = Batch(samples.time_s, samples.volts[:, columns], clipped, samples.angle_deg)
    ambient: Ambient | None = "subtracted" if samples.ambient_subtracted else None
    return Stream(iter([batch]), name, ambient, provenance, samples.warnings, samples.unit)


def chosen_sensor(names: Sequence[str], sensor: str | None, calibrated: str, source: str) -> str:
    """Return the requested sensor; by default the calibrated sensor, otherwise the only sensor."""
    for candidate in filter(None, (sensor, calibrated)):
        matches = [name for name in names if name.rpartition(".")[2] == candidate.rpartition(".")[2]]
        if matches:
            return candidate if candidate in matches else matches[0]
        if candidate == sensor:
            limit = f"{source} contains no sensor of this name"
            raise SpecError("--sensor", value=sensor, limit=limit, remedy=f"choose from {', '.join(names)}")
    if len(names) == 1:
        return names[0]
    limit = f"contains {len(names)} sensors, none of which is called {calibrated}: {', '.join(names)}"
    raise DataError(source, limit=limit, remedy="choose one with --sensor")


def check_live(options: SignalOptions, *, subtracted: bool = False) -> None:
    """Raise `SpecError` for an option that does not apply to live readings.

    ``subtracted`` is whether ambient light was subtracted from the readings.
    """
    if subtracted and options.rails is not None:
        limit = "does not apply to readings whose ambient light was subtracted: clipped readings are marked"
        raise SpecError("--rails", limit=limit, remedy="omit it")
    for name in FILE_OPTIONS:
        if name in options.model_fields_set:
            option = f"--{name.replace('_', '-')}"
            raise SpecError(option, limit="applies only to recorded files, not to live readings", remedy="omit it")


def line_stream(text: Iterable[str], options: SignalOptions) -> Stream:
    """Read CSV lines, each as soon as it arrives; the first line is the header unless column names are specified.

    Times are converted to seconds and voltages to a common unit; an assumed unit causes a warning.

    Raises
    ------
    DataError
        If no line arrives, or the header names no left and right receiver.
    """
    lines = lines_of(text, options.columns, remedy="name the columns, as in --columns time_s left_V right_V")
    layout = _Layout.of(lines.header, options)
    return Stream(layout.batches(lines.rows), warnings=layout.warnings, unit=layout.unit)


@dataclass(frozen=True)
class _Layout:
    """Column indices of time, left and right in a line, their scale factors, and the unit of the readings."""

    columns: tuple[int | None, int, int]
    scales: tuple[float, float, float]
    unit: str
    rate_hz: float | None
    warnings: tuple[Caution, ...]

    @classmethod
    def of(cls, header: Recording, options: SignalOptions) -> "_Layout":
        time = None
        if options.time is not None:
            time = named_column(header, options.time, "--time")
        elif options.rate_hz is None:
            time = column_of(header, "time")
            if time is None:
                remedy = f"name the column with --time, or specify the rate with --rate-hz; {column_list(header)}"
                raise DataError(STDIN, limit="no column is recognised as the time", remedy=remedy)
        left, right = (_receiver(header, options, side) for side in ("left", "right"))
        warnings: list[Caution] = []
        seconds = 1.0 if time is None else time_scale(time, options.time_unit, STDIN, warnings)
        unit = receivers_unit((left, right))
        left_scale, right_scale = (receiver_scale(channel, unit, STDIN, warnings) for channel in (left, right))
        index = {id(channel): column for column, channel in enumerate(header.channels)}
        columns = (None if time is None else index[id(time)], index[id(left)], index[id(right)])
        return cls(columns, (seconds, left_scale, right_scale), unit, options.rate_hz, tuple(warnings))

    def batches(self, rows: Iterable[Sequence[float]]) -> Iterator[Batch]:
        """Yield one reading at a time; a line that cannot be read is treated as a missing reading."""
        time, left, right = self.columns
        for number, values in enumerate(rows):
            time_s = number / (self.rate_hz or 1.0) if time is None else values[time] * self.scales[0]
            volts = [values[left] * self.scales[1], values[right] * self.scales[2]]
            yield Batch(np.array([time_s]), np.array([volts if math.isfinite(time_s) else [math.nan, math.nan]]))


def _receiver(header: Recording, options: SignalOptions, side: str) -> Channel:
    """Return the column of the left or right receiver."""
    named = next((column for name, column in options.named_receivers if side_of(name) == side), None)
    if named is not None:
        return named_column(header, named, "--channel")
    columns = [
        channel for channel in header.channels if side_of(channel.name) == side and not is_companion(channel.name)
    ]
    if len(columns) != 1:
        limit = f"has {len(columns)} columns that could be the {side} receiver, but exactly one is required"
        remedy = f"name the column with --channel {side}=COLUMN; {column_list(header)}"
        raise DataError(STDIN, limit=limit, remedy=remedy)
    return columns[0]

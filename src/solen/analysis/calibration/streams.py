"""Streams of voltages to decode: a recorded file, or lines of CSV as they arrive.

A `Stream` yields a sequence of `Batch` objects with left and right voltages, each as large as the available data.

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
from solen.recording.stimulus import ANGLE, STIMULI, Stimulus

_OF_DRIVE = ("angle", "load", "depth", "against", "load_cell", "tare_s", "zero_deg", "flip_angle")
FILE_OPTIONS = (*_OF_DRIVE, "on_off_hz", "on", "mains_hz", "emitters", "smooth_ms", "sheet")
"""Options that apply only to files."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Readings: times (n,), left and right (n, 2) with NaN if missing, flags for clipped readings, and true angles."""

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
    _check_drive(options, stimulus)
    streams: dict[str, Stream] = {}
    for group, recording in read_parts(path, sheet=options.sheet, columns=options.columns or None):
        own = options.model_copy(update={"against": stimulus.name})
        truth: AngleSource = "optional" if _has(recording, own) else "elsewhere"
        for emitter, samples in waveforms(recording, own, angle=truth).items():
            label = ".".join(filter(None, (group, emitter))) or path.stem
            for name, receivers in by_sensor(samples.receivers, label, single_file=True).items():
                sides = left_right(tuple(receivers))
                if sides is not None:
                    places = [list(receivers.values())[side] for side in sides]
                    streams[name] = _of_sensor(samples, name, places, recording.provenance)
    if not streams:
        remedy = "name them with --channel left=COLUMN right=COLUMN"
        raise DataError(path.name, limit="has no pair of a left and a right receiver", remedy=remedy)
    name = chosen_sensor(list(streams), sensor, calibrated, path.name)
    return replace(streams[name], named=sensor is not None or name != path.stem)


def _check_drive(options: SignalOptions, stimulus: Stimulus) -> None:
    """Raise `SpecError` if a column is specified for a quantity that is not decoded."""
    limit = f"does not apply, because the calibration is for the {stimulus.name}"
    for name, other in STIMULI.items():
        if name != stimulus.name and (column := getattr(options, other.column)) is not None:
            raise SpecError(f"--{other.column}", value=column, limit=limit, remedy=f"name it with --{stimulus.column}")
    if options.against not in {None, stimulus.name}:
        raise SpecError("--against", value=options.against, limit=limit, remedy="omit it")


def _has(recording: Recording, options: SignalOptions) -> bool:
    """Return whether a recording contains true values of the stimulus; volts count only with a load cell calibration."""
    name = options.against or ANGLE.name
    if getattr(options, STIMULI[name].column) is not None or column_of(recording, name) is not None:
        return True
    return name == "force" and options.load_cell is not None and force_in_volts(recording) is not None


def _of_sensor(samples: Waveforms, name: str, places: list[int], provenance: Provenance) -> Stream:
    clipped = None if samples.clipped is None else samples.clipped[:, places]
    batch = Batch(samples.time_s, samples.volts[:, places], clipped, samples.angle_deg)
    ambient: Ambient | None = "subtracted" if samples.ambient_subtracted else None
    return Stream(iter([batch]), name, ambient, provenance, samples.warnings, samples.unit)


def chosen_sensor(names: Sequence[str], sensor: str | None, calibrated: str, source: str) -> str:
    """Return the requested sensor; by default the calibrated sensor, or else the only sensor."""
    for wanted in filter(None, (sensor, calibrated)):
        named = [name for name in names if name.rpartition(".")[2] == wanted.rpartition(".")[2]]
        if named:
            return wanted if wanted in named else named[0]
        if wanted == sensor:
            raise SpecError("--sensor", value=sensor, limit=f"{source} has {', '.join(names)}")
    if len(names) == 1:
        return names[0]
    limit = f"has {len(names)} sensors, none of which is called {calibrated}: {', '.join(names)}"
    raise DataError(source, limit=limit, remedy="choose one with --sensor")


def check_live(options: SignalOptions, *, subtracted: bool = False) -> None:
    """Raise `SpecError` for an option that does not apply to live readings, or only to readings with ambient light."""
    if subtracted and options.rails is not None:
        limit = (
            "do not apply, because ambient light was already subtracted from these readings "
            "and clipped readings are marked"
        )
        raise SpecError("--rails", limit=limit, remedy="omit it")
    for name in FILE_OPTIONS:
        if name in options.model_fields_set:
            option = f"--{name.replace('_', '-')}"
            raise SpecError(option, limit="applies to recorded files, not to live readings", remedy="omit it")


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
    """Columns of time, left and right in a line, their scale factors, and the unit of the left and right readings."""

    places: tuple[int | None, int, int]
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
                raise DataError(STDIN, limit="no column is recognised as a time column", remedy=remedy)
        left, right = (_receiver(header, options, side) for side in ("left", "right"))
        warnings: list[Caution] = []
        of_time = 1.0 if time is None else time_scale(time, options.time_unit, STDIN, warnings)
        unit = receivers_unit((left, right))
        of_left, of_right = (receiver_scale(side, unit, STDIN, warnings) for side in (left, right))
        at = {id(channel): place for place, channel in enumerate(header.channels)}
        places = (None if time is None else at[id(time)], at[id(left)], at[id(right)])
        return cls(places, (of_time, of_left, of_right), unit, options.rate_hz, tuple(warnings))

    def batches(self, rows: Iterable[Sequence[float]]) -> Iterator[Batch]:
        """Yield one reading at a time; a line that cannot be read counts as a missing reading."""
        for number, values in enumerate(rows):
            place, left, right = self.places
            stamp = number / (self.rate_hz or 1.0) if place is None else values[place] * self.scales[0]
            volts = [values[left] * self.scales[1], values[right] * self.scales[2]]
            yield Batch(np.array([stamp]), np.array([volts if math.isfinite(stamp) else [math.nan, math.nan]]))


def _receiver(header: Recording, options: SignalOptions, side: str) -> Channel:
    """Return the column of the left or right receiver."""
    named = next((column for name, column in options.named_receivers if side_of(name) == side), None)
    if named is not None:
        return named_column(header, named, "--channel")
    columns = [
        channel for channel in header.channels if side_of(channel.name) == side and not is_companion(channel.name)
    ]
    if len(columns) != 1:
        limit = f"{len(columns) or 'no'} columns are recognised as the {side} receiver, but exactly one is required"
        remedy = f"name the column with --channel {side}=COLUMN; {column_list(header)}"
        raise DataError(STDIN, limit=limit, remedy=remedy)
    return columns[0]

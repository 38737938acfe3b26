"""Readings of a network from a recording: a matrix, emitter × receiver, for each switching cycle of the emitters.

The bench of solen writes a group for each emitter, with separate times and angles; other recorders write a table with a
column for each power, named ``EMITTER.RECEIVER``. Both are converted to rows, one for each switching cycle: the reading
of the first emitter and the next reading of every other emitter. An incomplete cycle is kept, with NaN for the missing
readings.

Public names: `holds_network`, `network_readings` and `NetworkReadings`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from solen.analysis.calibration.conditions import header_of
from solen.analysis.calibration.file import Ambient
from solen.analysis.network.columns import DOTTED, power_columns
from solen.analysis.samples import time_scale
from solen.arrays import BoolArray, FloatArray
from solen.errors import DataError, SpecError
from solen.ranks import Caution
from solen.recording import Channel, Provenance, Recording, read_parts
from solen.recording.column_roles import column_list, column_of, is_companion
from solen.units import factor

_TURN = 1.5  # largest duration of a turn, in usual intervals of an emitter's readings


@dataclass(frozen=True, eq=False)
class NetworkReadings:
    """Readings of a network.

    Attributes
    ----------
    sensor
        Name of the network; empty if unknown.
    motions, emitters, receivers
        Names of the motions, emitters and receivers.
    time_s
        Time of the first reading in each switching cycle, (N,).
    angle_deg
        Mean angles over each switching cycle, (N, motions); no columns if the recording contains no angles.
    signal
        Signals (N, emitters, receivers), without ambient light if it was subtracted; NaN for missing readings.
    clipped
        Whether each signal was at a limit, of the same shape.
    unit, ambient
        Unit of the signals, and whether ambient light was subtracted; None if unknown.
    provenance
        The file.
    warnings
        Assumed units.
    """

    sensor: str
    motions: tuple[str, ...]
    emitters: tuple[str, ...]
    receivers: tuple[str, ...]
    time_s: FloatArray
    angle_deg: FloatArray
    signal: FloatArray
    clipped: BoolArray
    unit: str
    ambient: Ambient | None
    provenance: Provenance
    warnings: tuple[Caution, ...] = ()

    def ordered(self, motions: Sequence[str], emitters: Sequence[str], receivers: Sequence[str]) -> "NetworkReadings":
        """Return the readings with emitters, receivers and motions in this order; raise `DataError` if one is missing.

        All motions may be missing, as in a recording that is to be decoded.
        """
        file = self.provenance.name
        lit = places_of("emitter", emitters, self.emitters, file)
        read = places_of("receiver", receivers, self.receivers, file)
        known = set(motions) <= set(self.motions)
        columns = [self.motions.index(motion) for motion in motions] if known else []
        return replace(
            self,
            motions=tuple(motions) if known else (),
            emitters=tuple(emitters),
            receivers=tuple(receivers),
            angle_deg=self.angle_deg[:, columns],
            signal=self.signal[:, lit][:, :, read],
            clipped=self.clipped[:, lit][:, :, read],
        )


def places_of(kind: str, wanted: Sequence[str], there: Sequence[str], file: str) -> list[int]:
    """Return the indices of the requested names of one kind among those in a file; raise `DataError` if a name is missing."""
    for name in wanted:
        if name not in there:
            limit = f"contains no readings for {kind} {name}; it contains readings for {', '.join(there)}"
            raise DataError(file, limit=limit, remedy="record all motions, emitters and receivers that were calibrated")
    return [there.index(one) for one in wanted]


@dataclass(frozen=True, eq=False)
class _Lit:
    """Readings with one emitter on: times (n,), angles (n, M), signals and clipping flags (n, R)."""

    time_s: FloatArray
    angle_deg: FloatArray
    signal: FloatArray
    clipped: BoolArray


def holds_network(path: Path) -> bool:
    """Return whether a recording is of a network, according to the bench header or the columns."""
    _, recording = next(iter(read_parts(path)))
    if header_of(recording.provenance).get("motions"):
        return True
    dotted = [
        channel for channel in recording.channels if DOTTED.fullmatch(channel.name) and not is_companion(channel.name)
    ]
    return len(dotted) > 1 and len(_angles(recording)) > 1


def network_readings(path: Path, sensor: str | None = None) -> NetworkReadings:
    """Read the readings of a network from a file.

    Parameters
    ----------
    path
        A recording from solen's bench, or a table with columns ``time_s``, ``MOTION_deg`` and ``EMITTER.RECEIVER``.
    sensor
        Name of the network; default: the only network.

    Raises
    ------
    DataError, SpecError
        If the file contains no network or no network with this name, or several networks but no name is specified.
    """
    parts = list(read_parts(path))
    header = header_of(parts[0][1].provenance)
    if not header.get("motions"):
        if sensor is not None:
            raise SpecError("--sensor", value=sensor, limit=f"{path.name} names no sensors", remedy="omit it")
        return _of_table(parts[0][1])
    return _of_bench(dict(parts), header, chosen_network(header, sensor, path.name))


def chosen_network(header: Mapping[str, Any], sensor: str | None, file: str) -> Mapping[str, Any]:
    """Return the header entry of a sensor."""
    entries: dict[str, Mapping[str, Any]] = {one["name"]: one for one in header["sensors"]}
    if sensor is None and len(entries) == 1:
        return next(iter(entries.values()))
    if sensor in entries:
        return entries[sensor]
    limit = f"must be one of {', '.join(entries)}, the sensors in {file}"
    raise SpecError("--sensor", value=sensor, limit=limit)


def _of_bench(parts: Mapping[str, Recording], header: Mapping[str, Any], entry: Mapping[str, Any]) -> NetworkReadings:
    motions, receivers = tuple(header["motions"]), tuple(entry["inputs"])
    each = [_lit(parts[f"{entry['name']}.{own}"], motions, receivers) for own in entry["emitters"]]
    rows = _turns([one.time_s for one in each])
    known = rows >= 0

    def matrix(values: Sequence[FloatArray]) -> FloatArray:
        found = [
            np.where(ok[:, None], value[at], np.nan) for value, at, ok in zip(values, rows.T, known.T, strict=True)
        ]
        return np.stack(found, axis=1)

    first = parts[f"{entry['name']}.{next(iter(entry['emitters']))}"]
    unit = next(channel.unit for channel in first.channels if channel.name == receivers[0])
    return NetworkReadings(
        sensor=entry["name"],
        motions=motions,
        emitters=tuple(entry["emitters"]),
        receivers=receivers,
        time_s=each[0].time_s,
        angle_deg=np.nanmean(matrix([one.angle_deg for one in each]), axis=1),
        signal=matrix([one.signal for one in each]),
        clipped=matrix([one.clipped.astype(float) for one in each]) == 1.0,
        unit=unit,
        ambient="subtracted" if first.find(f"{receivers[0]}_ambient") is not None else "not subtracted",
        provenance=first.provenance,
    )


def _lit(recording: Recording, motions: Sequence[str], receivers: Sequence[str]) -> _Lit:
    """Return the readings with one emitter on, from its group."""

    def column(name: str) -> FloatArray:
        found = next((channel for channel in recording.channels if channel.name == name), None)
        if found is None:
            what = f"{recording.provenance.file}: {name}"
            raise DataError(what, limit="no such column", remedy=column_list(recording))
        return found.values

    return _Lit(
        column("time_s"),
        np.column_stack([column(f"{name}_deg") for name in motions]),
        np.column_stack([column(name) for name in receivers]),
        np.column_stack([column(f"{name}_clipped") for name in receivers]) > 0,
    )


def _turns(times: Sequence[FloatArray]) -> Any:
    """Return the index of each emitter's reading in the first emitter's switching cycles (N, emitters); -1 if missing."""
    first = times[0]
    usual_s = float(np.median(np.diff(first))) if len(first) > 1 else np.inf
    ends = np.append(first[1:], np.inf)
    rows = [np.arange(len(first))]
    for time in times[1:]:
        after = np.searchsorted(time, first)
        there = np.minimum(after, max(len(time) - 1, 0))
        good = (after < len(time)) & (len(time) > 0)
        near = np.minimum(ends, first + _TURN * usual_s) if len(time) else first
        rows.append(np.where(good & (time[there] < near) if len(time) else False, there, -1))
    return np.stack(rows, axis=1)


def _angles(recording: Recording) -> dict[str, Channel]:
    """Return the angle columns, by motion name."""
    found = {}
    for one in (channel for channel in recording.channels if not is_companion(channel.name)):
        if (one.unit and factor(one.unit, "deg") is not None) or one.name.endswith("_deg"):
            found[one.name.removesuffix("_deg")] = one
    return found


def times_of(recording: Recording) -> tuple[Channel, float, list[Caution]]:
    """Return the time column, its factor to s, and a warning if this is assumed; raise `DataError` if there is no time column."""
    file = recording.provenance.name
    time = column_of(recording, "time")
    if time is None:
        raise DataError(file, limit="no column is recognised as the time", remedy=column_list(recording))
    warnings: list[Caution] = []
    return time, time_scale(time, None, file, warnings), warnings


def _of_table(recording: Recording) -> NetworkReadings:
    file = recording.provenance.name
    time, of_time, warnings = times_of(recording)
    layout = power_columns(recording.channels, file)
    powers = layout.places
    for name in recording.texts:
        if is_companion(name):
            raise DataError(
                f"{file}: {name}", limit="contains words instead of numbers", remedy="write 0 or 1, or omit the column"
            )
    emitters, receivers = (tuple(dict.fromkeys(pair[place] for pair in powers)) for place in (0, 1))
    if not powers:
        remedy = f"name a column for each power, EMITTER.RECEIVER; {column_list(recording)}"
        raise DataError(file, limit="contains no columns of powers by emitter and receiver", remedy=remedy)
    for pair in ((lit, read) for lit in emitters for read in receivers):
        if pair not in powers:
            limit = f"contains no column {'.'.join(pair)}, but every emitter requires a column for every receiver"
            raise DataError(file, limit=limit, remedy=column_list(recording))
    angles = _angles(recording)
    columns = [channel.values for channel in recording.channels]
    marks = np.zeros(len(time.values))

    def matrix(values: Mapping[tuple[str, str], FloatArray]) -> FloatArray:
        return np.stack([[values.get((lit, read), marks) for read in receivers] for lit in emitters]).transpose(2, 0, 1)

    return NetworkReadings(
        sensor="",
        motions=tuple(angles),
        emitters=emitters,
        receivers=receivers,
        time_s=of_time * time.values,
        angle_deg=np.column_stack([_degrees(angle) for angle in angles.values()])
        if angles
        else np.zeros((len(marks), 0)),
        signal=matrix({pair: layout.scales[pair] * columns[place] for pair, place in powers.items()}),
        clipped=matrix({pair: columns[place] for pair, place in layout.clipped.items()}) > 0.5,
        unit=layout.unit,
        ambient=layout.ambient,
        provenance=recording.provenance,
        warnings=(*warnings, *layout.warnings),
    )


def _degrees(channel: Channel) -> FloatArray:
    return np.asarray(channel.values * (factor(channel.unit, "deg") or 1.0 if channel.unit else 1.0))

"""Readings of a network from a recording: a matrix (emitters × receivers) for each switching cycle of the emitters.

The bench of solen writes a group for each emitter, with separate times and angles; other recorders write a table with a
column for each power, named ``EMITTER.RECEIVER``. Both are converted to one row for each switching cycle, which
consists of a reading with the first emitter on and the next readings with every other emitter on. An incomplete cycle
is kept, with NaN for the missing readings.

Public names: `is_network`, `network_readings` and `NetworkReadings`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from solen.analysis.calibration.conditions import header_of
from solen.analysis.calibration.file import Ambient
from solen.analysis.network.columns import DOTTED, power_columns
from solen.analysis.samples import time_scale
from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.errors import DataError, SpecError
from solen.ranks import Caution
from solen.recording import Channel, Provenance, Recording, read_parts
from solen.recording.column_roles import column_list, column_of, is_companion
from solen.units import factor

_MAX_CYCLE = 1.5  # largest duration of a switching cycle, relative to the median interval of an emitter's readings


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
        Warnings about assumed units.
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
        emitter_rows = indices_of("emitter", emitters, self.emitters, file)
        receiver_columns = indices_of("receiver", receivers, self.receivers, file)
        has_motions = set(motions) <= set(self.motions)
        columns = [self.motions.index(motion) for motion in motions] if has_motions else []
        return replace(
            self,
            motions=tuple(motions) if has_motions else (),
            emitters=tuple(emitters),
            receivers=tuple(receivers),
            angle_deg=self.angle_deg[:, columns],
            signal=self.signal[:, emitter_rows][:, :, receiver_columns],
            clipped=self.clipped[:, emitter_rows][:, :, receiver_columns],
        )


def indices_of(kind: str, names: Sequence[str], recorded: Sequence[str], file: str) -> list[int]:
    """Return the index of each name in the names recorded in a file; raise `DataError` if one is missing there."""
    for name in names:
        if name not in recorded:
            limit = f"contains no readings for {kind} {name}; it contains readings for {', '.join(recorded)}"
            raise DataError(file, limit=limit, remedy="record all motions, emitters and receivers that were calibrated")
    return [recorded.index(name) for name in names]


@dataclass(frozen=True, eq=False)
class _EmitterReadings:
    """Readings with one emitter on: times (n,), angles (n, M), signals and clipping flags (n, R)."""

    time_s: FloatArray
    angle_deg: FloatArray
    signal: FloatArray
    clipped: BoolArray


def is_network(path: Path) -> bool:
    """Return whether a recording is of a network, according to the header from a bench or to its columns."""
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
        Name of the network; default: the only one.

    Raises
    ------
    DataError, SpecError
        If the file contains no network or no network with this name, or several networks but no name is specified.
    """
    parts = list(read_parts(path))
    header = header_of(parts[0][1].provenance)
    if not header.get("motions"):
        if sensor is not None:
            raise SpecError("--sensor", value=sensor, limit=f"{path.name} contains no sensor names", remedy="omit it")
        return _of_table(parts[0][1])
    return _of_bench(dict(parts), header, network_entry(header, sensor, path.name))


def network_entry(header: Mapping[str, Any], sensor: str | None, file: str) -> Mapping[str, Any]:
    """Return the header entry of a sensor, by default of the only one."""
    entries: dict[str, Mapping[str, Any]] = {entry["name"]: entry for entry in header["sensors"]}
    if sensor is None and len(entries) == 1:
        return next(iter(entries.values()))
    if sensor in entries:
        return entries[sensor]
    limit = f"must name one of the sensors in {file}"
    raise SpecError("--sensor", value=sensor, limit=limit, remedy=f"choose from {', '.join(entries)}")


def _of_bench(parts: Mapping[str, Recording], header: Mapping[str, Any], entry: Mapping[str, Any]) -> NetworkReadings:
    motions, receivers = tuple(header["motions"]), tuple(entry["inputs"])
    groups = [parts[f"{entry['name']}.{emitter}"] for emitter in entry["emitters"]]
    by_emitter = [_emitter_readings(group, motions, receivers) for group in groups]
    rows = _cycles([readings.time_s for readings in by_emitter])

    def matrix(values: Sequence[FloatArray]) -> FloatArray:
        columns = zip(values, rows.T, strict=True)
        return np.stack([np.where(row[:, None] >= 0, value[row], np.nan) for value, row in columns], axis=1)

    first = groups[0]
    unit = next(channel.unit for channel in first.channels if channel.name == receivers[0])
    return NetworkReadings(
        sensor=entry["name"],
        motions=motions,
        emitters=tuple(entry["emitters"]),
        receivers=receivers,
        time_s=by_emitter[0].time_s,
        angle_deg=np.nanmean(matrix([readings.angle_deg for readings in by_emitter]), axis=1),
        signal=matrix([readings.signal for readings in by_emitter]),
        clipped=matrix([readings.clipped.astype(float) for readings in by_emitter]) == 1.0,
        unit=unit,
        ambient="subtracted" if first.find(f"{receivers[0]}_ambient") is not None else "not subtracted",
        provenance=first.provenance,
    )


def _emitter_readings(recording: Recording, motions: Sequence[str], receivers: Sequence[str]) -> _EmitterReadings:
    """Return the readings with one emitter on, from its group."""

    def column(name: str) -> FloatArray:
        channel = next((channel for channel in recording.channels if channel.name == name), None)
        if channel is None:
            raise DataError(
                f"{recording.provenance.file}: {name}", limit="no such column", remedy=column_list(recording)
            )
        return channel.values

    return _EmitterReadings(
        column("time_s"),
        np.column_stack([column(f"{name}_deg") for name in motions]),
        np.column_stack([column(name) for name in receivers]),
        np.column_stack([column(f"{name}_clipped") for name in receivers]) > 0,
    )


def _cycles(times: Sequence[FloatArray]) -> IndexArray:
    """Return the index of each emitter's reading in each switching cycle, (N, emitters); -1 if it is missing."""
    first = times[0]
    interval_s = float(np.median(np.diff(first))) if len(first) > 1 else np.inf
    ends = np.minimum(np.append(first[1:], np.inf), first + _MAX_CYCLE * interval_s)
    rows = [np.arange(len(first))]
    for time in times[1:]:
        following = np.searchsorted(time, first)
        following_s = np.append(time, np.inf)[following]
        rows.append(np.where(following_s < ends, following, -1))
    return np.stack(rows, axis=1).astype(np.intp)


def _angles(recording: Recording) -> dict[str, Channel]:
    """Return the angle columns, keyed by the name of the motion."""
    return {
        channel.name.removesuffix("_deg"): channel
        for channel in recording.channels
        if not is_companion(channel.name)
        and ((channel.unit and factor(channel.unit, "deg") is not None) or channel.name.endswith("_deg"))
    }


def times_of(recording: Recording) -> tuple[Channel, float, list[Caution]]:
    """Return the time column, its factor to s, and warnings if s is assumed; raise `DataError` without a column."""
    file = recording.provenance.name
    time = column_of(recording, "time")
    if time is None:
        raise DataError(file, limit="no column is recognised as the time", remedy=column_list(recording))
    warnings: list[Caution] = []
    return time, time_scale(time, None, file, warnings), warnings


def _of_table(recording: Recording) -> NetworkReadings:
    file = recording.provenance.name
    time, seconds, warnings = times_of(recording)
    layout = power_columns(recording.channels, file)
    powers = layout.indices
    for name in recording.texts:
        if is_companion(name):
            limit = "contains words instead of numbers"
            raise DataError(f"{file}: {name}", limit=limit, remedy="write 0 or 1, or omit the column")
    emitters, receivers = (tuple(dict.fromkeys(names)) for names in zip(*powers, strict=True)) if powers else ((), ())
    if not powers:
        remedy = f"name the column of each power EMITTER.RECEIVER; {column_list(recording)}"
        raise DataError(file, limit="contains no columns of powers", remedy=remedy)
    for pair in product(emitters, receivers):
        if pair not in powers:
            limit = f"contains no column {'.'.join(pair)}, but every emitter requires a column for every receiver"
            raise DataError(file, limit=limit, remedy=f"add this column; {column_list(recording)}")
    angles = _angles(recording)
    columns = [channel.values for channel in recording.channels]
    zeros = np.zeros(len(time.values))

    def matrix(values: Mapping[tuple[str, str], FloatArray]) -> FloatArray:
        rows = [[values.get((emitter, receiver), zeros) for receiver in receivers] for emitter in emitters]
        return np.stack(rows).transpose(2, 0, 1)

    angle_columns = [_degrees(angle) for angle in angles.values()]
    return NetworkReadings(
        sensor="",
        motions=tuple(angles),
        emitters=emitters,
        receivers=receivers,
        time_s=seconds * time.values,
        angle_deg=np.column_stack(angle_columns) if angles else np.zeros((len(zeros), 0)),
        signal=matrix({pair: layout.scales[pair] * columns[index] for pair, index in powers.items()}),
        clipped=matrix({pair: columns[index] for pair, index in layout.clipped.items()}) > 0.5,
        unit=layout.unit,
        ambient=layout.ambient,
        provenance=recording.provenance,
        warnings=(*warnings, *layout.warnings),
    )


def _degrees(channel: Channel) -> FloatArray:
    return np.asarray(channel.values * (factor(channel.unit, "deg") or 1.0 if channel.unit else 1.0))

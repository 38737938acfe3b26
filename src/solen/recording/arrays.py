"""Recordings from named arrays, as in MATLAB, LabVIEW, HDF5 and netCDF files.

These files contain arrays, some of which share an axis. The most common array length is taken as the length of the
recording; an array with that many rows gives a channel for each column; single numbers and strings are parameters. An
array of another length is omitted and named in a note, because its relation to the channels is unknown.

Public names: `Array` and `recorded`.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.recording.headings import heading
from solen.recording.model import Channel, Recording
from solen.recording.source import Source
from solen.recording.table import along_axes, provenance_of, unique

MAX_COLUMNS = 1000
"""Largest number of columns of an array that become channels."""
_MIN_LENGTH = 2
_SINCE = re.compile(r"\s*(\w+) since .*")


@dataclass(frozen=True)
class Array:
    """Values of a variable, (n,) or (n, m), with their unit and any column names from the file."""

    name: str
    values: Any
    unit: str = ""
    columns: Sequence[str] = ()


def recorded(
    source: Source, kind: str, arrays: Iterable[Array], metadata: Mapping[str, str], names: Sequence[str] | None = None
) -> Recording:
    """Return a recording of arrays that share an axis.

    Parameters
    ----------
    source, kind
        The file and its format.
    arrays, metadata
        The arrays and parameters in the file.
    names
        Column names for a matrix without names.

    Raises
    ------
    DataError
        If no two arrays have the same length.
    """
    flattened = _named(source, _with_short_names(arrays), names) if names else _with_short_names(arrays)
    columns = [column for array in flattened for column in _columns(array)]
    lengths = Counter(values.size for _, _, values in columns if values.size >= _MIN_LENGTH)
    if not lengths:
        raise source.error("", "contains no array of numbers", "export the signals as a table (CSV)")
    length = max(lengths, key=lambda size: (lengths[size], size))
    complete = [column for column in columns if column[2].size == length]
    omitted = sorted({name for name, _, values in columns if values.size not in {1, length}})
    parameters = {name: f"{values[0]:.10g}" for name, _, values in columns if values.size == 1} | dict(metadata)
    note = f"arrays of a different length are omitted: {', '.join(omitted[:12])}" if omitted else ""
    channels = []
    for name, (_, unit, values) in zip(unique([name for name, _, _ in complete]), complete, strict=True):
        head = heading(name, _SINCE.sub(r"\1", unit)) if unit else heading(name)
        channels.append(Channel(head.name, head.quantity, head.unit, values))
    channels = [
        replace(channel, name=name) for channel, name in zip(channels, unique([c.name for c in channels]), strict=True)
    ]
    if note:
        channels[0] = replace(channels[0], note=note)
    instrument = next((value for key, value in parameters.items() if key.casefold() in {"instrument", "device"}), "")
    return Recording(tuple(along_axes(channels, ())), provenance_of(source, kind, parameters, instrument))


def _named(source: Source, arrays: Sequence[Array], names: Sequence[str]) -> list[Array]:
    """Return the only matrix with as many columns as there are names; raise `DataError` if there is not exactly one."""
    fitting = [array for array in arrays if np.ndim(array.values) == 2 and min(np.shape(array.values)) == len(names)]
    if len(fitting) != 1:
        shapes = ", ".join(f"{array.name} {' by '.join(map(str, np.shape(array.values)))}" for array in arrays)
        limit = f"has {len(fitting) or 'no'} matrices of {len(names)} columns; it contains {shapes}"
        raise source.error("", limit, "name all columns of one of these matrices, in order")
    return [replace(fitting[0], columns=tuple(names))]


def _with_short_names(arrays: Iterable[Array]) -> list[Array]:
    """Return arrays named by the last part of their path, ``time_s`` for ``run.time_s``, if these names are unique."""
    listed = list(arrays)
    names = [array.name.rpartition(".")[2] for array in listed]
    return (
        [replace(array, name=name) for array, name in zip(listed, names, strict=True)]
        if len({*names}) == len(names)
        else listed
    )


def _columns(array: Array) -> list[tuple[str, str, FloatArray]]:
    """Return the numeric columns of an array: names, units and values."""
    values = np.asarray(array.values)
    if values.dtype.kind not in "biuf" or values.size == 0:
        return []
    values = values.reshape(-1) if values.ndim < 2 or 1 in values.shape else values
    if values.ndim == 1:
        return [(array.name, array.unit, values.astype(np.float64))]
    if values.ndim > 2 or min(values.shape) > MAX_COLUMNS:
        return []
    table = values if values.shape[0] >= values.shape[1] else values.T
    names = array.columns if len(array.columns) == table.shape[1] else range(1, table.shape[1] + 1)
    return [
        (str(name) if array.columns else f"{array.name} {name}", array.unit, column.astype(np.float64))
        for name, column in zip(names, table.T, strict=True)
    ]

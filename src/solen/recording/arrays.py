"""Recordings from named arrays, as needed for MATLAB, LabVIEW, HDF5 and netCDF files.

These files contain arrays, some of which share an axis. The most common array length is taken as the length of the
recording; an array with that many rows gives a channel for each column; single numbers and texts are parameters. An
array of another length is omitted and listed in a note, because its relation to the others is unknown.

Public names: `Array` and `recorded`.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.recording.model import Channel, Recording
from solen.recording.source import Source
from solen.recording.table import along_axes, stated_provenance, unique
from solen.recording.words import heading

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
    """Make a recording from arrays that share an axis.

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
    held = _named(source, _plainly(arrays), names) if names else _plainly(arrays)
    columns = [column for array in held for column in _columns(array)]
    lengths = Counter(values.size for _, _, values in columns if values.size >= _MIN_LENGTH)
    if not lengths:
        raise source.refused("", "contains no array of numbers", "export the signals as a table (CSV)")
    length = max(lengths, key=lambda size: (lengths[size], size))
    whole = [column for column in columns if column[2].size == length]
    others = sorted({name for name, _, values in columns if values.size not in {1, length}})
    stated = {name: f"{values[0]:.10g}" for name, _, values in columns if values.size == 1} | dict(metadata)
    note = f"arrays of a different length are omitted: {', '.join(others[:12])}" if others else ""
    channels = []
    for name, (_, unit, values) in zip(unique([name for name, _, _ in whole]), whole, strict=True):
        head = heading(name, _SINCE.sub(r"\1", unit)) if unit else heading(name)
        channels.append(Channel(head.name, head.quantity, head.unit, values))
    channels = [
        replace(channel, name=name) for channel, name in zip(channels, unique([c.name for c in channels]), strict=True)
    ]
    if note:
        channels[0] = replace(channels[0], note=note)
    instrument = next((value for key, value in stated.items() if key.casefold() in {"instrument", "device"}), "")
    return Recording(tuple(along_axes(channels, ())), stated_provenance(source, kind, stated, instrument))


def _named(source: Source, arrays: Sequence[Array], names: Sequence[str]) -> list[Array]:
    """Return the only matrix with as many columns as there are names.

    Raises `DataError` if no matrix or more than one has that many columns.
    """
    fitting = [array for array in arrays if np.ndim(array.values) == 2 and min(np.shape(array.values)) == len(names)]
    if len(fitting) != 1:
        shapes = ", ".join(f"{array.name} {' by '.join(map(str, np.shape(array.values)))}" for array in arrays)
        limit = f"has {len(fitting) or 'no'} matrices of {len(names)} columns; it contains {shapes}"
        raise source.refused("", limit, "give a name for each column of the matrix, in order")
    return [replace(fitting[0], columns=tuple(names))]


def _plainly(arrays: Iterable[Array]) -> list[Array]:
    """Shorten array paths to their last part, ``run.time_s`` to ``time_s``, if the last parts are unique."""
    held = list(arrays)
    last = [one.name.rpartition(".")[2] for one in held]
    return (
        [replace(one, name=name) for one, name in zip(held, last, strict=True)] if len({*last}) == len(last) else held
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

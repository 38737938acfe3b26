"""Large plain tables, such as an hour of samples, are read in a second or two, with little extra memory.

The beginning is read like any table and defines the columns. If all columns are numbers, and the remainder of the file
contains only digits, signs, the decimal mark and the separator, numpy reads the file. Anything else (a remark, an empty
cell, a word, a row of another length) is left to the row-by-row reader, which reports the error and its location.

`read_large` returns a recording, or None if a file is not a large plain table.
"""

import io
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.recording import cary, layout, table, testxpert
from solen.recording.grid import Grid, cut_note, of_text
from solen.recording.layout import Layout
from solen.recording.model import Recording
from solen.recording.source import Source

MIN_BYTES = 2_000_000
"""Files below this size in bytes are read row by row."""
_HEAD = 200  # lines from which a table is recognised
_DIGITS = b"0123456789+-.eE\r\n"


def read_large(source: Source, columns: Sequence[str] | None = None) -> Recording | None:
    """Read a large numeric table; return None for other files and for tables that must be read row by row."""
    if len(source.data) < MIN_BYTES or source.is_archive or b"\0" in source.data[:4096]:
        return None
    known = _head(source, columns)
    if known is None:
        return None
    grid, place = known
    start = _offset(source.data, grid.lines[place.body[0]] - 1)
    found = table.columns(grid, place)
    cells = [grid.cells(column.place, place.body) for column in found]
    if len(found) != len(place.names) or any(one.values is None for one in found):
        return None
    mark = grid.mark(place.body, dict(enumerate(cells)))
    values = _numbers(source.data[start:], grid.separator, mark, len(found))
    if values is None:
        return None
    whole = [replace(one, values=column) for one, column in zip(found, values, strict=True)]
    recording = table.recorded(replace(grid, source=source), place, whole, "table")
    return recording if source.data.endswith((b"\n", b"\r")) else _noted(recording, source, grid, cells[-1])


def _head(source: Source, columns: Sequence[str] | None) -> tuple[Grid, Layout] | None:
    """Read the beginning of a file as a table; return None if it is not a plain table."""
    end = _offset(source.data, _HEAD)
    if end <= 0:
        return None
    try:
        grid = of_text(replace(source, data=source.data[:end]))
        if cary.is_cary(grid) is not None:
            return None
        place = layout.find(grid, columns)
        table.check_rows(grid, place)
    except DataError:  # reported when the whole file is read
        return None
    plain = not testxpert.program(grid, place) and not place.after and len(place.body) > _HEAD // 2
    return (grid, place) if plain and all(place.names) else None


def _offset(data: bytes, lines: int) -> int:
    """Return the offset of the line after the first ``lines`` lines; −1 if the file has fewer lines."""
    place = 0
    for _ in range(lines):
        place = data.find(b"\n", place) + 1
        if place == 0:
            return -1
    return place


def _numbers(body: bytes, separator: str, mark: str, count: int) -> FloatArray | None:
    """Return the numbers in a table's rows, (count, n); None if the rows contain anything else."""
    allowed = _DIGITS.replace(b".", mark.encode()) + separator.encode()
    if mark == separator or body.translate(None, allowed):
        return None
    text = body.replace(b",", b".") if mark == "," else body
    try:
        values = np.loadtxt(io.BytesIO(text), delimiter=None if separator == " " else separator, ndmin=2)
    except ValueError:
        return None
    whole = values.shape[1] == count and bool(np.isfinite(values).all())
    return np.ascontiguousarray(values.T) if whole else None


def _noted(recording: Recording, source: Source, grid: Grid, above: Sequence[str]) -> Recording:
    """Add a note if the last number is shorter than those above and may be truncated."""
    last = source.data[-80:].decode("ascii", "replace").split("\n")[-1].split(grid.separator)[-1].strip()
    if len(last) >= min(map(len, above)):
        return recording
    *others, end = recording.channels
    return replace(recording, channels=(*others, replace(end, note=cut_note(last))))

"""Fast reader for large plain tables, such as an hour of samples: a second or two, with little extra memory.

The beginning is read like any table and defines the columns. If all columns are numbers, and the remainder of the file
contains only digits, signs, the decimal mark and the separator, numpy reads the file. Anything else (a comment, an
empty cell, a word, a row of another length) is left to the row-by-row reader, which reports errors and their location.

`read_large` returns a recording, or None if a file is not a large plain table.
"""

import io
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.recording import cary, table, testxpert
from solen.recording.grid import Grid, of_text, truncated_number
from solen.recording.layout import Layout, find_layout
from solen.recording.model import Recording
from solen.recording.source import Source

MIN_BYTES = 2_000_000
"""Files below this size in bytes are read row by row."""
_HEADER_LINES = 200  # number of lines from which a table is recognised
_DIGITS = b"0123456789+-.eE\r\n"


def read_large(source: Source, columns: Sequence[str] | None = None) -> Recording | None:
    """Read a large numeric table; return None for other files and for tables that must be read row by row."""
    if len(source.data) < MIN_BYTES or source.is_archive or b"\0" in source.data[:4096]:
        return None
    head = _plain_head(source, columns)
    if head is None:
        return None
    grid, layout = head
    start = _offset(source.data, grid.lines[layout.body[0]] - 1)
    table_columns = table.columns(grid, layout)
    cells = [grid.cells(column.index, layout.body) for column in table_columns]
    if len(table_columns) != len(layout.names) or any(column.values is None for column in table_columns):
        return None
    mark = grid.mark(layout.body, dict(enumerate(cells)))
    values = _numbers(source.data[start:], grid.separator, mark, len(table_columns))
    if values is None:
        return None
    complete = [replace(column, values=numbers) for column, numbers in zip(table_columns, values, strict=True)]
    recording = table.recorded(replace(grid, source=source), layout, complete, "table")
    return recording if source.data.endswith((b"\n", b"\r")) else _with_note(recording, source, grid, cells[-1])


def _plain_head(source: Source, columns: Sequence[str] | None) -> tuple[Grid, Layout] | None:
    """Read the beginning of a file as a table; return None if it is not a plain table."""
    end = _offset(source.data, _HEADER_LINES)
    if end <= 0:
        return None
    try:
        grid = of_text(replace(source, data=source.data[:end]))
        if cary.is_cary(grid) is not None:
            return None
        layout = find_layout(grid, columns)
        table.check_rows(grid, layout)
    except DataError:  # reported when the file is read row by row
        return None
    plain = not testxpert.program(grid, layout) and not layout.after and len(layout.body) > _HEADER_LINES // 2
    return (grid, layout) if plain and all(layout.names) else None


def _offset(data: bytes, lines: int) -> int:
    """Return the offset of the line after the first ``lines`` lines; −1 if the file has fewer lines."""
    offset = 0
    for _ in range(lines):
        offset = data.find(b"\n", offset) + 1
        if offset == 0:
            return -1
    return offset


def _numbers(body: bytes, separator: str, mark: str, count: int) -> FloatArray | None:
    """Return the numbers of the rows, (count, n); None if the rows contain anything else."""
    allowed = _DIGITS.replace(b".", mark.encode()) + separator.encode()
    if mark == separator or body.translate(None, allowed):
        return None
    text = body.replace(b",", b".") if mark == "," else body
    try:
        values = np.loadtxt(io.BytesIO(text), delimiter=None if separator == " " else separator, ndmin=2)
    except ValueError:
        return None
    complete = values.shape[1] == count and bool(np.isfinite(values).all())
    return np.ascontiguousarray(values.T) if complete else None


def _with_note(recording: Recording, source: Source, grid: Grid, previous: Sequence[str]) -> Recording:
    """Return the recording with a note if the last number is shorter than those above, and so may be truncated."""
    last = source.data[-80:].decode("ascii", "replace").split("\n")[-1].split(grid.separator)[-1].strip()
    if len(last) >= min(map(len, previous)):
        return recording
    *others, channel = recording.channels
    return replace(recording, channels=(*others, replace(channel, note=truncated_number(last))))

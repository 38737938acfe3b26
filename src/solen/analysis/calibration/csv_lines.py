"""Lines of CSV as they arrive: the column names, then the numbers in each line.

Public name: `lines_of`.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from solen.errors import DataError
from solen.recording import Channel, Provenance, Recording
from solen.recording.headings import heading
from solen.recording.numbers import is_number, parse

STDIN = "-"
_SEPARATORS = (";", "\t", ",")
_BYTE_ORDER = ("\ufeff", "\xef\xbb\xbf")
"""Byte order mark before a header, decoded as UTF-8 or as Windows-1252."""


@dataclass(frozen=True)
class Lines:
    """Column names, and the numbers in each line: NaN for a cell that is empty or not a number.

    If a line has too few or too many cells, all its numbers are NaN.
    """

    names: tuple[str, ...]
    rows: Iterator[list[float]]

    @property
    def header(self) -> Recording:
        """Table with these columns and no rows, as read from a file."""
        headings = map(heading, self.names)
        channels = (Channel(head.name, head.quantity, head.unit, np.empty(0)) for head in headings)
        return Recording(tuple(channels), Provenance(STDIN))


def lines_of(text: Iterable[str], columns: Sequence[str] = (), *, remedy: str) -> Lines:
    """Read the lines of a text; the first non-blank line is the header, unless column names are specified.

    Raises
    ------
    DataError
        If no line arrives, or the header contains only numbers; the message ends with the ``remedy``.
    """
    rows: Iterator[str] = (row for row in text if row.strip())
    first = next(rows, None)
    if first is None:
        raise DataError(STDIN, limit="is empty: no line arrived", remedy="send a header line and readings")
    head = next((first.removeprefix(mark) for mark in _BYTE_ORDER if first.startswith(mark)), first)
    separator = next((sign for sign in _SEPARATORS if sign in head), ",")
    names = _cells(head, separator)
    if not all(map(is_number, names)):
        headers = {first.strip(), head.strip()}  # a logger repeats its header when it is restarted
        rows = (row for row in rows if row.strip() not in headers)
    elif not columns:
        limit = "begins with numbers instead of column names"
        raise DataError(STDIN, limit=limit, remedy=remedy)
    if columns:
        names, rows = list(columns), chain([head], rows)
    return Lines(tuple(names), (_numbers(row, separator, len(names)) for row in rows))


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.strip("\r\n").split(separator)]


def _numbers(row: str, separator: str, count: int) -> list[float]:
    cells = _cells(row, separator)
    if len(cells) != count:
        return [math.nan] * count
    return [_number(cell, "." if separator == "," else ",") for cell in cells]


def _number(cell: str, decimal: str) -> float:
    try:
        return parse(cell, decimal)
    except ValueError:
        return math.nan

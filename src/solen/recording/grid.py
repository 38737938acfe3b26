"""Files as rows of cells with addresses, from text or from a worksheet.

Readers work on cells and report a faulty cell by line and column, or by its worksheet address. The separator of a text
file is the one with which most cells are numbers. It is the same for the entire file, so that a line with another
separator is recognised as damaged.

`of_text` makes a `Grid`; `Grid.error` returns an error with its location; `Grid.column` returns numbers.
"""

import csv
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.recording.numbers import all_numbers, is_number, parse
from solen.recording.source import Source

_SEPARATORS = ("\t", ";", " ", ",")
_THOUSANDS_COMMA = re.compile("-?[1-9][0-9]{0,2},[0-9]{3}")
_SEPARATOR_LINE = re.compile("sep=.[;,\t]*", re.IGNORECASE)  # a line that tells Excel the separator
_MAX_SHOWN = 40  # maximum number of characters of a faulty cell in an error
_SAMPLE = 400  # maximum number of lines from which the separator is chosen


@dataclass(frozen=True)
class Grid:
    """Rows of cells.

    Attributes
    ----------
    source
        The file.
    rows
        Cells of each row, without surrounding spaces; row lengths differ.
    lines
        Line number of each row in the file, from 1.
    separator
        Cell separator of a text file; empty for a workbook.
    sheet
        Worksheet name, for a workbook.
    ends_in_break
        Whether the last line ends with a line break; if not, the file may be truncated.
    comments
        Line numbers and contents of the lines that begin with ``#``.
    column_offset
        Number of columns of the file on the left of the grid's first column.
    """

    source: Source
    rows: list[list[str]]
    lines: list[int]
    separator: str = ","
    sheet: str = ""
    ends_in_break: bool = True
    comments: list[tuple[int, str]] = field(default_factory=list)
    column_offset: int = 0

    def address(self, row: int, column: int | None = None) -> str:
        """Return the address of a cell: row and column, or worksheet and cell."""
        line = self.lines[row]
        column = None if column is None else column + self.column_offset
        if self.sheet:
            return f"sheet {self.sheet}, " + (f"row {line}" if column is None else f"cell {_letters(column)}{line}")
        return f"line {line}" + ("" if column is None else f", column {column + 1}")

    def error(
        self, row: int, column: int | None, limit: str, remedy: str = "correct it, or export the file again"
    ) -> DataError:
        """Return the error for a row, or for one of its cells, with the cell's content."""
        cells = self.rows[row]
        value = cells[column] if column is not None and column < len(cells) else ""
        shown = value if len(value) <= _MAX_SHOWN else f"{value[:_MAX_SHOWN]}…"
        return self.source.error(self.address(row, column), limit, remedy, shown or None)

    def truncation_note(self, body: list[int]) -> str:
        """Return a note if the file ends after the last row of numbers without a line break; otherwise empty.

        Raise `DataError` if that row has lost cells, or if its last number is shorter than every number above it.
        """
        last = body[-1]
        if self.ends_in_break or self.lines[last] != self.lines[-1]:
            return ""
        cells, above = self.rows[last], [self.rows[row] for row in body[:-1]]
        last_column = len(cells) - 1
        shortest = min(
            (len(row[last_column]) for row in above if last_column < len(row) and row[last_column]), default=0
        )
        if above and (len(cells) != len(above[-1]) or len(cells[last_column]) < shortest):
            limit = "is incomplete and has no line break: the file was cut off"
            raise self.error(last, None, limit, "export it again")
        if not cells[last_column]:  # a separator after the last number shows that the number is complete
            return ""
        return truncated_number(cells[last_column])

    def is_blank(self, row: int) -> bool:
        """Return whether a row is empty."""
        return not any(self.rows[row])

    def width(self, row: int) -> int:
        """Return the number of cells in a row up to the last cell that is not empty."""
        cells = self.rows[row]
        return next((n for n in range(len(cells), 0, -1) if cells[n - 1]), 0)

    def cells(self, column: int, rows: Sequence[int]) -> list[str]:
        """Return the cells of a column in the given rows, empty where a row is too short."""
        return [cells[column] if column < len(cells) else "" for cells in map(self.rows.__getitem__, rows)]

    def mark(self, rows: Sequence[int], cells_by_column: Mapping[int, Sequence[str]]) -> str:
        """Return the decimal mark, ``.`` or ``,``; raise `DataError` if the numbers use both.

        ``cells_by_column`` contains the cells of each column in these rows.
        """
        texts = ["\n".join(cells) for cells in cells_by_column.values()]
        if not any("," in text for text in texts):
            return "."
        if not any("." in text for text in texts):
            self._check_thousands(rows, cells_by_column)
            return ","
        first_cells: dict[str, tuple[int, int]] = {}
        counts = {".": 0, ",": 0}
        for column, cells in cells_by_column.items():
            for row, cell in zip(rows, cells, strict=True):
                for mark in (".", ","):
                    if mark in cell and is_number(cell):
                        counts[mark] += 1
                        first_cells.setdefault(mark, (row, column))
        if counts["."] and counts[","]:
            minority = min(counts, key=counts.__getitem__)
            limit = "has a different decimal mark from other numbers"
            raise self.error(*first_cells[minority], limit, "use either a decimal point or a decimal comma throughout")
        return "," if counts[","] else "."

    def _check_thousands(self, rows: Sequence[int], cells_by_column: Mapping[int, Sequence[str]]) -> None:
        """Raise `DataError` if commas may separate thousands: 1,250 next to 980, without any 0,5 or 12,75."""
        with_comma = [cell for cells in cells_by_column.values() for cell in cells if "," in cell]
        if not all(map(_THOUSANDS_COMMA.fullmatch, with_comma)):
            return
        for column, cells in cells_by_column.items():
            marked = [index for index, cell in enumerate(cells) if "," in cell]
            if marked and any(cell and "," not in cell for cell in cells):
                limit = "may be a number in the thousands or one with three decimals"
                raise self.error(rows[marked[0]], column, limit, "omit the thousands comma, or use a decimal point")

    def column(
        self, column: int, rows: Sequence[int], cells: Sequence[str], mark: str, *, machine: bool = False
    ) -> FloatArray:
        """Return the numbers of a column in rows, NaN for empty cells; raise `DataError` at any other cell."""
        values = np.empty(len(rows))
        if all_numbers(cells, machine=machine) and _ascii_with(mark, cells):
            values[:] = [
                float(cell) for cell in (cells if mark == "." else "\n".join(cells).replace(",", ".").split("\n"))
            ]
            if np.isfinite(values).all():
                return values
        for index, (row, cell) in enumerate(zip(rows, cells, strict=True)):
            try:
                values[index] = parse(cell, mark, machine=machine)
            except ValueError as bad:
                raise self.error(row, column, str(bad)) from None
        return values


def _ascii_with(mark: str, cells: Sequence[str]) -> bool:
    """Return whether the cells contain neither the other decimal mark nor a non-ASCII minus sign."""
    text = "".join(cells)
    return text.isascii() and ("," if mark == "." else ".") not in text


def of_text(source: Source) -> Grid:
    """Return the rows of a text file; lines that begin with ``#`` become comments."""
    lines = source.lines()
    ends_in_break = not lines[-1]
    if ends_in_break:
        lines = lines[:-1]
    numbered = list(enumerate(lines, 1))
    comments = [(number, line.lstrip()[1:].strip()) for number, line in numbered if line.lstrip().startswith("#")]
    numbered_rows = [(number, line) for number, line in numbered if not line.lstrip().startswith("#")]
    if numbered_rows and _SEPARATOR_LINE.fullmatch(numbered_rows[0][1]):
        numbered_rows = numbered_rows[1:]
    separator = _separator([line for _, line in numbered_rows])
    split = splitter(separator)
    rows = [split(line) for _, line in numbered_rows]
    return Grid(source, rows, [number for number, _ in numbered_rows], separator, "", ends_in_break, comments)


def truncated_number(last: str) -> str:
    """Return the note on the last number of a file without a line break at its end."""
    return f"the file ends without a line break after {last}: that number may be cut off"


def splitter(separator: str) -> Callable[[str], list[str]]:
    """Return a function that splits a line into cells; a line with unpaired quotation marks remains one cell."""

    def split(line: str) -> list[str]:
        if separator == " ":
            return line.split()
        if '"' not in line:
            return [cell.strip() for cell in line.split(separator)]
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True))]
        except csv.Error:
            return [line.strip()]

    return split


def _separator(lines: list[str]) -> str:
    """Return the separator that gives the most numbers, then the fewest other cells; without numbers, the most cells.

    Two columns with decimal commas, ``0,5;1,25``, also give two numbers if they are split at the commas, but ``5;1``
    remains between them.
    """
    filled = [line for line in lines if line.strip()]
    sample = filled[:: max(1, len(filled) // _SAMPLE)]

    def score(separator: str) -> tuple[int, int, int]:
        cells = 0 if separator == " " else sum(line.count(separator) for line in sample)
        counts = list(map(_numbers_by(separator), sample))
        return sum(count for count, _ in counts), -sum(others for _, others in counts), cells

    return max(_SEPARATORS, key=score)


def _numbers_by(separator: str) -> Callable[[str], tuple[int, int]]:
    """Return a function that counts numeric and other cells of a line split at a separator.

    Both counts are 0 if the line is not split or contains no number.
    """
    split = splitter(separator)

    def numbers(line: str) -> tuple[int, int]:
        cells = split(line)
        count = sum(map(is_number, cells))
        prose = separator == " " and count < max(2, len(cells) - 1)  # sentences contain spaces, too
        if len(cells) < 2 or prose or not count:
            return 0, 0
        return count, sum(bool(cell) for cell in cells) - count

    return numbers


def _letters(column: int) -> str:
    """Return the letters of a worksheet column."""
    name = ""
    column += 1
    while column:
        column, digit = divmod(column - 1, 26)
        name = chr(65 + digit) + name
    return name

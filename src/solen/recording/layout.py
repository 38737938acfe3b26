"""Layout of a table in a file: lines above it, header, units, rows.

A header is a row of words above rows of numbers with the same number of cells. It may be preceded by titles and
parameter blocks, but not by rows of numbers. All rows from the header to the end of the file must belong to the table:
any other row is treated as damaged and causes an error when the rows are read. Text after an empty line at the end is a
comment.

`find_layout` returns the `Layout` of a `Grid`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from solen.errors import DataError
from solen.recording.grid import Grid, splitter
from solen.recording.headings import AXES, heading, is_measurement_unit, is_mode
from solen.recording.numbers import is_missing, is_number

_RECOGNITION_ROWS = 100
"""Number of rows below a header that are used to recognise it."""
_HEADER_ROWS = 1000
"""Number of rows at the beginning among which the header must be."""
_HEADER = "add a first line that names the columns, such as wavelength_nm,T,R or time_s,angle_deg,left_V"
_SPECTRUM = (8, 150.0, 50_000.0)
"""Minimum number of rows of a spectrum without a header, and limits for its wavelengths in nm."""
MAX_COLUMNS = 10_000
"""Largest number of columns in a table."""


@dataclass(frozen=True)
class Layout:
    """Position of a table in a grid.

    Attributes
    ----------
    header
        Header row, or the first row of the table if the caller names the columns.
    names
        Header text of each column.
    units
        Unit of each column from the unit row; empty if there is no such row.
    before
        Non-empty rows above the header.
    body
        Rows of the table.
    after
        Rows of text after the table.
    repetitions
        Number of repetitions of the header in the table, as when a logger appends to its file.
    """

    header: int
    names: list[str]
    units: list[str]
    before: list[int]
    body: list[int]
    after: list[int]
    repetitions: int = 0


def find_layout(grid: Grid, columns: Sequence[str] | None = None) -> Layout:
    """Return the layout of the table in a grid; raise `DataError` if there is none or its columns have no names.

    ``columns`` are names for the columns of a table without a header.
    """
    filled = [row for row in range(len(grid.rows)) if not grid.is_blank(row)]
    header = _header(grid, filled)
    if columns is not None:
        return _with_names(grid, filled, columns, header)
    if header is None:
        return _without_header(grid, filled)
    position = filled.index(header)
    before, below = filled[:position], filled[position + 1 :]
    names = grid.rows[header][: grid.width(header)]
    if len(names) > MAX_COLUMNS:
        limit = f"has {len(names)} columns; at most {MAX_COLUMNS} are read"
        raise grid.error(header, None, limit, "split the table")
    units = _units_below(grid, filled, position)
    are_units = [is_measurement_unit(name) and not is_mode(name) for name in names]
    if len(names) > 1 and 2 * sum(are_units) > len(names) and not (names[0] in AXES and names[1:] == ["A"]):
        raise grid.error(header, None, "contains units; the column names above are missing or damaged")
    for row in before:
        if is_number(grid.rows[row][0]) and _numbers(grid, row) > 1:
            limit = f"contains numbers above the header, which is in {grid.address(header)}"
            raise grid.error(row, None, limit, "remove the rows that do not belong to the table")
    below = below[1:] if units else below
    header_rows = [row for row in below if [cell.lstrip("\ufeff") for cell in grid.rows[row]] == grid.rows[header]]
    repeated = {*header_rows, *(row + 1 for row in header_rows if units)}
    body, after = _split_text_below(grid, [row for row in below if row not in repeated])
    return Layout(header, names, [*units, *[""] * (len(names) - len(units))], before, body, after, len(header_rows))


def _header(grid: Grid, filled: list[int]) -> int | None:
    """Return the header row: the first possible header row that is not that of a parameter list above the table."""
    searched = range(min(len(filled), _HEADER_ROWS))
    first = next((position for position in searched if _can_head(grid, filled, position)), None)
    while first is not None and (second := _after_parameters(grid, filled, first)) is not None:
        first = second
    return None if first is None else filled[first]


def _after_parameters(grid: Grid, filled: list[int], first: int) -> int | None:
    """Return the next header row if the rows before it are a parameter list and an empty line."""
    for position in range(first + 1, len(filled)):
        if is_number(grid.rows[filled[position]][0]):
            return None
        if filled[position] != filled[position - 1] + 1 and _can_head(grid, filled, position):
            return position
    return None


def _can_head(grid: Grid, filled: list[int], position: int) -> bool:
    """Return whether a row contains words and the row below has the same number of cells with numbers."""
    row = filled[position]
    if is_number(grid.rows[row][0]):
        return False
    words = grid.rows[row][: grid.width(row)]
    skip = 2 if _units_below(grid, filled, position) else 1
    unnamed = sum(not word for word in words) > len(words) / 2
    if position + skip >= len(filled) or unnamed or any(word and is_missing(word) for word in words):
        return False
    first = filled[position + skip]
    if any(map(is_number, words)):  # samples may be called 1, 2, 3; then all cells below are numbers
        all_numbers_below = not is_number(words[0]) and _numbers(grid, first) == grid.width(first) == len(words)
        return all_numbers_below and first == row + skip and len(words) > 1
    if not _numbers(grid, first):
        return False
    block = _block(filled, position + skip)
    return 2 * sum(_has_width(grid, below, len(words)) for below in block) >= len(block)


def _has_width(grid: Grid, row: int, width: int) -> bool:
    """Return whether a row has a number and exactly as many cells as there are columns."""
    return grid.width(row) <= width <= len(grid.rows[row]) and _numbers(grid, row) > 0


def _block(filled: list[int], position: int) -> list[int]:
    """Return the rows from a position to the next empty row, at most `_RECOGNITION_ROWS`."""
    last = min(position + _RECOGNITION_ROWS, len(filled))
    end = next((n for n in range(position + 1, last) if filled[n] != filled[n - 1] + 1), last)
    return filled[position:end]


def _units_below(grid: Grid, filled: list[int], position: int) -> list[str]:
    """Return the units in the next row; empty if it is not a unit row."""
    if position + 1 >= len(filled):
        return []
    row = filled[position + 1]
    cells = grid.rows[row][: grid.width(row)]
    units = all(is_measurement_unit(cell.strip("[]()")) and not is_number(cell) for cell in cells if cell)
    return cells if units and len(cells) <= grid.width(filled[position]) else []


def _numbers(grid: Grid, row: int) -> int:
    return sum(map(is_number, grid.rows[row]))


def _split_text_below(grid: Grid, below: list[int]) -> tuple[list[int], list[int]]:
    """Return the table rows, and the text rows after an empty line at the end."""
    end = len(below)
    while end and _numbers(grid, below[end - 1]) == 0 and grid.width(below[end - 1]) == 1 and len(below) > 1:
        end -= 1
    while end and end < len(below) and below[end] == below[end - 1] + 1:
        end += 1  # text without an empty line before it is part of the table, and is rejected there
    return below[:end], below[end:]


def _without_header(grid: Grid, filled: list[int]) -> Layout:
    """Return the layout of a table with its header in the last comment above it (numpy), or of a bare spectrum."""
    if not filled:
        raise grid.source.error("", "contains no table", "export it again")
    first = filled[0]
    above = [text for line, text in grid.comments if line < grid.lines[first]]
    names = splitter(grid.separator)(above[-1]) if above else []
    if len(names) != grid.width(first) or any(is_number(name) or not name for name in names):
        if not above and _is_spectrum(grid, filled):
            return Layout(first, ["wavelength", "spectrum"], ["", ""], [], *_split_text_below(grid, filled))
        if not _numbers(grid, first):
            raise _missing_header(grid, filled)
        limit = "the numbers have no header with column names"
        remedy = f"{_HEADER}, or name them with --columns (columns= of read)"
        raise grid.error(first, None, limit, remedy)
    return Layout(first, names, [""] * len(names), [], *_split_text_below(grid, filled))


def _is_spectrum(grid: Grid, filled: list[int]) -> bool:
    """Return whether rows can only be wavelengths in nm and values: two columns, the first of them monotonic."""
    pairs = [grid.rows[row] for row in filled]
    if len(pairs) < _SPECTRUM[0] or any(len(pair) != 2 or not all(map(is_number, pair)) for pair in pairs):
        return False
    waves = [float(pair[0].replace(",", ".")) for pair in pairs]
    rising = sum(after > before for before, after in pairwise(waves))
    return _SPECTRUM[1] <= min(waves) <= max(waves) <= _SPECTRUM[2] and rising in {0, len(waves) - 1}


def _missing_header(grid: Grid, filled: list[int]) -> DataError:
    """Return the error for words that are not followed by a table of numbers."""
    headings = [heading(cell) for cell in grid.rows[filled[0]] if cell]
    if len(filled) > 1 and any(head.unit or head.quantity for head in headings):
        above, numbers = grid.address(filled[0]), _numbers(grid, filled[1])
        limit = f"is not a row of numbers, which must follow the header in {above}"
        remedy = "write plain numbers in this row, and their unit in the header"
        if numbers == grid.width(filled[1]) > len(headings):
            limit = f"has {numbers} numbers, but the header in {above} has {len(headings)} names"
            remedy = "name each column in the header, or all columns with --columns (columns= of read)"
        return grid.error(filled[1], None, limit, remedy)
    limit = "is neither a table header nor a table row"
    return grid.error(filled[0], None, limit, f"{_HEADER} above the numbers")


def _with_names(grid: Grid, filled: list[int], columns: Sequence[str], header: int | None) -> Layout:
    """Return the layout of a table without a complete header, whose columns are named by the caller."""
    if header is not None:
        limit = "is a header, so the columns would be named twice"
        raise grid.error(header, None, limit, "omit --columns (columns= of read)")
    first = next((n for n, row in enumerate(filled) if _numbers(grid, row) == grid.width(row) == len(columns)), None)
    if filled and _numbers(grid, filled[0]):
        first = 0
    if first is None or any(_numbers(grid, row) > 1 for row in filled[:first]):
        limit = f"has no table with {len(columns)} columns of numbers"
        raise grid.source.error("", limit, "name every column of a table without a complete header")
    body, after = _split_text_below(grid, filled[first:])
    return Layout(filled[first], list(columns), [""] * len(columns), filled[:first], body, after)

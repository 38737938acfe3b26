"""Layout of a table in a file: preceding lines, header, units, rows.

A header is a row of words above rows of numbers with the same number of cells. It may be preceded by titles and
parameter blocks, but not by rows of numbers only. All rows from the header to the end of the file must belong to the
table: any other row is damaged, and raises an error when the rows are read instead of being skipped. Text after an
empty line at the end is a remark.

`find` returns the `Layout` of a `Grid`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from solen.errors import DataError
from solen.recording.grid import Grid, splitter
from solen.recording.numbers import is_missing, is_number
from solen.recording.words import AXES, heading, is_mode, stated_unit

_TELLING = 100
"""Number of rows below a header that are used to recognise it."""
_SEARCHED = 1000
"""The header must be among this number of rows at the beginning."""
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
    again
        Number of repetitions of the header in the table, for example if a logger appended to its file.
    """

    header: int
    names: list[str]
    units: list[str]
    before: list[int]
    body: list[int]
    after: list[int]
    again: int = 0


def find(grid: Grid, columns: Sequence[str] | None = None) -> Layout:
    """Find the table in a grid; raise `DataError` if there is no table or if the columns have no names.

    ``columns`` contains the column names of a table without a header.
    """
    filled = [row for row in range(len(grid.rows)) if not grid.is_blank(row)]
    header = _header(grid, filled)
    if columns is not None:
        return _named(grid, filled, columns, header)
    if header is None:
        return _remarked(grid, filled)
    place = filled.index(header)
    before, below = filled[:place], filled[place + 1 :]
    names = grid.rows[header][: grid.width(header)]
    if len(names) > MAX_COLUMNS:
        limit = f"has {len(names)} columns; at most {MAX_COLUMNS} are read"
        raise grid.refused(header, None, limit, "split the table")
    units = _units_below(grid, filled, place)
    stated = [stated_unit(name) and not is_mode(name) for name in names]
    if len(names) > 1 and 2 * sum(stated) > len(names) and not (names[0] in AXES and names[1:] == ["A"]):
        raise grid.refused(header, None, "contains units; the column names above are missing or damaged")
    for row in before:
        if is_number(grid.rows[row][0]) and _numbers(grid, row) > 1:
            limit = f"contains numbers above the header, which is in {grid.place(header)}"
            raise grid.refused(row, None, limit, "remove the rows that do not belong to the table")
    below = below[1:] if units else below
    heads = [row for row in below if [cell.lstrip("\ufeff") for cell in grid.rows[row]] == grid.rows[header]]
    repeated = {*heads, *(row + 1 for row in heads if units)}
    body, after = _parted(grid, [row for row in below if row not in repeated])
    return Layout(header, names, [*units, *[""] * (len(names) - len(units))], before, body, after, len(heads))


def _header(grid: Grid, filled: list[int]) -> int | None:
    """Return the header row: the first possible one, unless it heads a parameter list above the table."""
    searched = range(min(len(filled), _SEARCHED))
    first = next((place for place in searched if _can_head(grid, filled, place)), None)
    while first is not None and (second := _after_parameters(grid, filled, first)) is not None:
        first = second
    return None if first is None else filled[first]


def _after_parameters(grid: Grid, filled: list[int], first: int) -> int | None:
    """Return the next header row if the rows before it are a parameter list and an empty line."""
    for place in range(first + 1, len(filled)):
        if is_number(grid.rows[filled[place]][0]):
            return None
        if filled[place] != filled[place - 1] + 1 and _can_head(grid, filled, place):
            return place
    return None


def _can_head(grid: Grid, filled: list[int], place: int) -> bool:
    """Whether a row contains words and the row below has the same number of cells with numbers."""
    row = filled[place]
    if is_number(grid.rows[row][0]):
        return False
    words = grid.rows[row][: grid.width(row)]
    skip = 2 if _units_below(grid, filled, place) else 1
    unnamed = sum(not word for word in words) > len(words) / 2
    if place + skip >= len(filled) or unnamed or any(word and is_missing(word) for word in words):
        return False
    first = filled[place + skip]
    if any(map(is_number, words)):  # samples may be called 1, 2, 3; then all below are numbers
        plain = not is_number(words[0]) and _numbers(grid, first) == grid.width(first) == len(words)
        return plain and first == row + skip and len(words) > 1
    if not _numbers(grid, first):
        return False
    block = _block(filled, place + skip)
    return 2 * sum(_has_width(grid, one, len(words)) for one in block) >= len(block)


def _has_width(grid: Grid, row: int, width: int) -> bool:
    """Whether a row has a number and exactly as many cells as there are columns."""
    return grid.width(row) <= width <= len(grid.rows[row]) and _numbers(grid, row) > 0


def _block(filled: list[int], place: int) -> list[int]:
    """Return the rows from the given row to the next empty one, at most as many as are used to recognise a header."""
    last = min(place + _TELLING, len(filled))
    end = next((n for n in range(place + 1, last) if filled[n] != filled[n - 1] + 1), last)
    return filled[place:end]


def _units_below(grid: Grid, filled: list[int], place: int) -> list[str]:
    """Return the units in the next row; empty if it is not a unit row."""
    if place + 1 >= len(filled):
        return []
    row = filled[place + 1]
    cells = grid.rows[row][: grid.width(row)]
    units = all(stated_unit(cell.strip("[]()")) and not is_number(cell) for cell in cells if cell)
    return cells if units and len(cells) <= grid.width(filled[place]) else []


def _numbers(grid: Grid, row: int) -> int:
    return sum(map(is_number, grid.rows[row]))


def _parted(grid: Grid, below: list[int]) -> tuple[list[int], list[int]]:
    """Return the table rows, and the text rows after an empty line at the end."""
    end = len(below)
    while end and _numbers(grid, below[end - 1]) == 0 and grid.width(below[end - 1]) == 1 and len(below) > 1:
        end -= 1
    while end and end < len(below) and below[end] == below[end - 1] + 1:
        end += 1  # without an empty line before it, it belongs to the table and is rejected there
    return below[:end], below[end:]


def _remarked(grid: Grid, filled: list[int]) -> Layout:
    """Return the layout of a table whose header is the last remark above it, as written by numpy."""
    if not filled:
        raise grid.source.refused("", "contains no table", "export it again")
    first = filled[0]
    above = [text for line, text in grid.remarks if line < grid.lines[first]]
    names = splitter(grid.separator)(above[-1]) if above else []
    if len(names) != grid.width(first) or any(is_number(name) or not name for name in names):
        if not above and _is_spectrum(grid, filled):
            return Layout(first, ["wavelength", "spectrum"], ["", ""], [], *_parted(grid, filled))
        if not _numbers(grid, first):
            raise _headless(grid, filled)
        limit = "the numbers have no header with column names"
        remedy = f"{_HEADER}, or name them with --columns (columns= of read)"
        raise grid.refused(first, None, limit, remedy)
    return Layout(first, names, [""] * len(names), [], *_parted(grid, filled))


def _is_spectrum(grid: Grid, filled: list[int]) -> bool:
    """Whether rows without a header can only be wavelengths in nm and values: two columns, the first monotonic."""
    pairs = [grid.rows[row] for row in filled]
    if len(pairs) < _SPECTRUM[0] or any(len(pair) != 2 or not all(map(is_number, pair)) for pair in pairs):
        return False
    waves = [float(pair[0].replace(",", ".")) for pair in pairs]
    rising = sum(after > before for before, after in pairwise(waves))
    return _SPECTRUM[1] <= min(waves) <= max(waves) <= _SPECTRUM[2] and rising in {0, len(waves) - 1}


def _headless(grid: Grid, filled: list[int]) -> DataError:
    """Return the error for words that are not followed by a table of numbers."""
    heads = [heading(cell) for cell in grid.rows[filled[0]] if cell]
    if len(filled) > 1 and any(head.unit or head.quantity for head in heads):
        above, numbers = grid.place(filled[0]), _numbers(grid, filled[1])
        limit = f"is not a row of numbers, which must follow the header in {above}"
        remedy = "write plain numbers there, and their unit in the header"
        if numbers == grid.width(filled[1]) > len(heads):
            limit = f"has {numbers} numbers, but the header in {above} has {len(heads)} names"
            remedy = "name each column in the header, or all with --columns (columns= of read)"
        return grid.refused(filled[1], None, limit, remedy)
    limit = "is neither a table header nor a table row"
    return grid.refused(filled[0], None, limit, f"{_HEADER} above the numbers")


def _named(grid: Grid, filled: list[int], columns: Sequence[str], header: int | None) -> Layout:
    """Return the layout of a table without a matching header, whose columns the caller names."""
    if header is not None:
        raise grid.refused(header, None, "is a header; the columns are named twice", "omit the columns")
    first = next((n for n, row in enumerate(filled) if _numbers(grid, row) == grid.width(row) == len(columns)), None)
    if filled and _numbers(grid, filled[0]):
        first = 0
    if first is None or any(_numbers(grid, row) > 1 for row in filled[:first]):
        limit = f"has no table with {len(columns)} columns of numbers"
        raise grid.source.refused("", limit, "name every column of a table without a header, or with a broken one")
    body, after = _parted(grid, filled[first:])
    return Layout(filled[first], list(columns), [""] * len(columns), filled[:first], body, after)

"""Exports from test machines with several tables: lists of results, and the numbers of each specimen.

A row that names quantities such as force, travel, time or strain, with units below it, is the header of a specimen's
numbers, which continue to the next row of another kind. Specimens side by side have repeated columns. A list has a
header whose first cell is empty or ``Name``, and a row for each specimen that begins with its name and contains its
properties, such as width and modulus. Each specimen becomes a separate table, with its row from each list as
parameters, and is checked like every table. Every row of numbers must belong to a table.

`specimens` returns the `Table` of each specimen.

Layouts: Bluehill's raw data below its results tables; MTS Series 793, whose first line names it and whose acquisitions
follow one another; Shimadzu's Trapezium with names above each specimen's columns, as read by snpl's load_TrapeziumCSV;
testXpert's columns side by side.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from solen.recording.grid import Grid
from solen.recording.headings import heading, is_measurement_unit, plain
from solen.recording.layout import Layout
from solen.recording.numbers import is_missing, is_number

_QUANTITIES = {"force", "displacement", "crosshead", "time", "strain", "stress"}
_MTS_HEADER = re.compile(r"MTS793\|")
_EXPORT = re.compile(r"results? table\b|mts793\|", re.IGNORECASE)
_LIST_HEADERS = {"", "name", "specimen", "sample", "specimen label"}
_UNITS = {"", "unit", "units"}
_SUMMARY_ROWS = {"mean", "average", "median", "maximum", "minimum", "max", "min", "range", "mittelwert"} | {
    *("sd", "std", "s.d", "std dev", "std. dev", "standard deviation", "coefficient of variation", "cv", "c.v"),
    *("std deviation", "std.dev", "standardabweichung", "mean + sd", "mean - sd", "mean + 1 sd", "mean - 1 sd"),
}
"""First cells of the rows of a list that do not describe a specimen."""
_MIN_ROWS = 2


@dataclass(frozen=True)
class Table:
    """The table of a specimen as a separate grid, and the specimen's name, which is empty for a single specimen."""

    name: str
    grid: Grid
    layout: Layout


@dataclass(frozen=True)
class _Block:
    """A table in the file: its title, header row, rows of numbers, and columns."""

    title: str
    header: int
    body: Sequence[int]
    columns: range

    @property
    def head(self) -> range:
        """Rows of the optional title, the names and the units."""
        return range(self.header - bool(self.title), self.header + 2)


def specimens(grid: Grid) -> list[Table]:
    """Return the tables of the specimens; an empty list for files without specimens.

    Raise `DataError` at a row of numbers that belongs to no specimen.
    """
    stacked = list(_stacked(grid))
    blocks = [part for block in stacked for part in _side_by_side(grid, block)]
    table_rows = {row for block in stacked for row in (*block.head, *block.body)}
    remaining = [row for row in range(len(grid.rows)) if row not in table_rows and not grid.is_blank(row)]
    lists = _lists(grid, remaining)
    is_export = any(_EXPORT.search(cell) for cells in grid.rows for cell in cells[:1])
    if is_export and not blocks:
        limit = (
            "contains no test data, which begin with a row of names such as Time, Extension, Load and a row of units"
        )
        raise grid.source.error("", limit, "export the raw data of the specimens too")
    if len(blocks) < (1 if is_export or lists else 2):
        return []
    list_rows = {row for rows in lists for row in rows}
    for row in remaining:
        if row not in list_rows and sum(map(is_number, grid.rows[row])) > 1 and is_number(grid.rows[row][0]):
            raise grid.error(row, None, "contains numbers that belong to no table", "export the file again")
    above = [grid.rows[row] for row in remaining if row not in list_rows]
    if _MTS_HEADER.match(grid.rows[0][0]):
        return [_table(grid, _joined(grid, blocks), "", above)]
    names, titles = _names(blocks), [block.title for block in blocks]
    matched = [(rows[0], rows[1], _rows_of_specimens(grid, rows[2:], names, by_name=names == titles)) for rows in lists]
    return [
        _table(grid, block, name, [*above, *_parameter_rows(grid, matched, number)])
        for number, (name, block) in enumerate(zip(names, blocks, strict=True))
    ]


def _stacked(grid: Grid) -> Iterator[_Block]:
    """Yield the tables in the rows of a file, from top to bottom."""
    row = 0
    while row < len(grid.rows) - _MIN_ROWS:
        end = row + 2
        if _is_header(grid, row):
            while end < len(grid.rows) and not grid.is_blank(end) and _is_row(grid, end):
                end += 1
        if end - row - 2 < _MIN_ROWS:
            row += 1
            continue
        above = [cell for cell in grid.rows[row - 1] if cell] if row else []
        title = above[0] if above and len(set(above)) == 1 and not _EXPORT.search(above[0]) else ""
        yield _Block(title, row, range(row + 2, end), range(grid.width(row)))
        row = end


def _is_header(grid: Grid, row: int) -> bool:
    """Return whether a row names columns of at least two quantities of a test, with their units below."""
    names, units = grid.rows[row], grid.rows[row + 1]
    if len(names) < 2 or is_number(names[0]) or len(units) < grid.width(row):
        return False
    pairs = [(name, unit.strip("()[]")) for name, unit in zip(names, units, strict=False) if name]
    if not all(is_measurement_unit(unit) for _, unit in pairs):
        return False
    return len({heading(name, unit).quantity for name, unit in pairs} & _QUANTITIES) > 1


def _is_row(grid: Grid, row: int) -> bool:
    return all(is_number(cell) or is_missing(cell) for cell in grid.rows[row])


def _side_by_side(grid: Grid, block: _Block) -> Iterator[_Block]:
    """Yield the specimens in repeated columns, each with its rows; the block itself if no columns repeat."""
    names = [plain(name) for name in grid.rows[block.header][: len(block.columns)]]
    filled = [n for n, name in enumerate(names) if name]
    starts = [n for n in filled if names[n] == names[filled[0]]]
    if len(starts) < 2:
        yield block
        return
    for start, end in zip(starts, [*starts[1:], len(names)], strict=True):
        columns = range(start, max(n for n in filled if n < end) + 1)
        titles = [cell for cell in grid.rows[block.header - 1][start:end] if cell] if block.header else []
        filled_rows = [row for row in block.body if any(grid.rows[row][start:end])]
        yield _Block(titles[0] if titles else "", block.header, filled_rows, columns)


def _joined(grid: Grid, blocks: Sequence[_Block]) -> _Block:
    """Return consecutive acquisitions as a single test; raise `DataError` if their columns differ."""
    first = blocks[0]
    for block in blocks[1:]:
        if grid.rows[block.header : block.header + 2] != grid.rows[first.header : first.header + 2]:
            limit = "has different columns from the acquisition above it"
            raise grid.error(block.header, None, limit, "export each acquisition to a separate file")
    return replace(first, body=[row for block in blocks for row in block.body])


def _lists(grid: Grid, remaining: Sequence[int]) -> list[list[int]]:
    """Return the rows of each list of results: a header, units, and a row for each specimen."""
    lists: list[list[int]] = []
    for row, below in pairwise(remaining):
        cells, units = grid.rows[row], grid.rows[below]
        if lists and row == lists[-1][-1] + 1 and grid.width(row) > 1:
            lists[-1].append(row)
        elif plain(cells[0]) in _LIST_HEADERS and grid.width(row) > 1 and below == row + 1 and _is_unit_row(units):
            lists.append([row])
    if lists and remaining[-1] == lists[-1][-1] + 1:
        lists[-1].append(remaining[-1])
    return lists


def _is_unit_row(cells: Sequence[str]) -> bool:
    """Return whether a row below the header of a list contains units."""
    units = [cell.strip("()[]") for cell in cells[1:] if cell]
    return plain(cells[0]) in _UNITS and bool(units) and all(map(is_measurement_unit, units))


def _rows_of_specimens(grid: Grid, rows: Sequence[int], names: Sequence[str], *, by_name: bool) -> dict[int, int]:
    """Return the row of a list for each specimen, matched by name or by the number in it.

    If no name matches and there are as many rows as specimens, they are matched in order. Raise `DataError` at a row
    that matches no specimen.
    """
    rows = [row for row in rows if plain(grid.rows[row][0]).rstrip(".:") not in _SUMMARY_ROWS]
    matched: dict[int, int] = {}
    for key in (plain, _number) if by_name else ():
        keys, listed = [key(name) for name in names], [key(grid.rows[row][0]) for row in rows]
        matched = {
            keys.index(key_of_row): row
            for key_of_row, row in zip(listed, rows, strict=True)
            if key_of_row and keys.count(key_of_row) == listed.count(key_of_row) == 1
        }
        if len(matched) == len(rows):
            return matched
    if not matched and len(rows) == len(names):
        return dict(enumerate(rows))
    unmatched = next(row for row in rows if row not in matched.values())
    limit = f"matches none of the {len(names)} specimens, and the list has {len(rows)} rows"
    raise grid.error(unmatched, None, limit, "use the name of a specimen, or delete the line")


def _number(name: str) -> str:
    """Return the number at the end of a name, without leading zeros; empty if there is none."""
    match = re.search(r"(\d+)\W*$", name)
    return "" if match is None else f"{int(match[1])}"


def _parameter_rows(grid: Grid, lists: Sequence[tuple[int, int, dict[int, int]]], number: int) -> Iterator[list[str]]:
    """Yield the parameters of a specimen in the lists, each as name, value and unit."""
    for header, below, rows in lists:
        names, units, line = (
            [cell.strip("()[]") for cell in grid.rows[row]] if row is not None else []
            for row in (header, below, rows.get(number))
        )
        for layout, value in enumerate(line[: len(names)]):
            if layout and names[layout] and value:
                yield [grid.rows[header][layout], value, *units[layout : layout + 1]]


def _names(blocks: Sequence[_Block]) -> list[str]:
    """Return the name of each specimen: its title, or a number; a single specimen keeps its title, even if empty."""
    titles = [block.title for block in blocks]
    if len(blocks) == 1:
        return titles
    distinct = all(titles) and max(Counter(titles).values()) == 1
    return titles if distinct else [f"specimen {number}" for number in range(1, len(blocks) + 1)]


def _table(grid: Grid, block: _Block, name: str, above: Sequence[list[str]]) -> Table:
    """Return the table of a block: its rows as a separate grid, below the parameters."""
    chosen = [block.header, block.header + 1, *block.body]
    start, stop = block.columns.start, block.columns.stop
    extends = max(map(grid.width, chosen)) > stop and grid.width(block.header) == stop and not start
    columns = slice(start, None if extends else stop)
    rows = [grid.rows[row][columns] for row in chosen]
    count = len(above)
    cells = replace(
        grid,
        rows=[*above, *rows],
        lines=[*[grid.lines[block.header]] * count, *(grid.lines[row] for row in chosen)],
        column_offset=start,
    )
    units = [unit.strip("()[]") for unit in rows[1][: len(block.columns)]]
    names = rows[0][: len(block.columns)]
    layout = Layout(count, names, units, list(range(count)), list(range(count + 2, count + len(chosen))), [])
    return Table(name, cells, layout)

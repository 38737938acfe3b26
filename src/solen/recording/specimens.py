"""Exports from test machines that contain several tables: results first, then the numbers for each specimen.

A row that names a force, a travel, a time or a strain, with units below it, is the header of a specimen's numbers,
which continue to the next row of another kind. The columns of specimens side by side repeat. Below a header whose first
cell is empty or contains ``Name``, rows that begin with a specimen's name list properties: width, modulus. Each
specimen becomes a separate table, with its row from each list as parameters, and is checked like every table. Every row
of numbers must belong to a table.

`specimens` returns the content of such an export as `Table` objects.

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
from solen.recording.layout import Layout
from solen.recording.numbers import is_missing, is_number
from solen.recording.words import heading, plain, stated_unit

_MECHANICAL = {"force", "displacement", "crosshead", "time", "strain", "stress"}
_MTS = re.compile(r"MTS793\|")
_EXPORT = re.compile(r"results? table\b|mts793\|", re.IGNORECASE)
_LISTED = {"", "name", "specimen", "sample", "specimen label"}
_UNITS = {"", "unit", "units"}
_SUMMARIES = {"mean", "average", "median", "maximum", "minimum", "max", "min", "range", "mittelwert"} | {
    *("sd", "std", "s.d", "std dev", "std. dev", "standard deviation", "coefficient of variation", "cv", "c.v"),
    *("std deviation", "std.dev", "standardabweichung", "mean + sd", "mean - sd", "mean + 1 sd", "mean - 1 sd"),
}
"""Rows of a list that do not belong to a specimen."""
_MIN_ROWS = 2


@dataclass(frozen=True)
class Table:
    """A specimen's table as a separate grid, with the specimen's name, which is empty for a single specimen."""

    name: str
    grid: Grid
    place: Layout


@dataclass(frozen=True)
class _Block:
    """Rows of a table in the file: title, names, units, and the numbers in some columns."""

    title: str
    header: int
    body: Sequence[int]
    columns: range

    @property
    def head(self) -> range:
        """Rows of the optional title, the names and the units."""
        return range(self.header - bool(self.title), self.header + 2)


def specimens(grid: Grid) -> list[Table]:
    """Return the tables of the specimens; none for other files.

    Raises `DataError` at a row of numbers that belongs to no specimen.
    """
    stacked = list(_stacked(grid))
    blocks = [part for block in stacked for part in _side_by_side(grid, block)]
    taken = {row for block in stacked for row in (*block.head, *block.body)}
    others = [row for row in range(len(grid.rows)) if row not in taken and not grid.is_blank(row)]
    lists = _lists(grid, others)
    marked = any(_EXPORT.search(cell) for cells in grid.rows for cell in cells[:1])
    if marked and not blocks:
        limit = "contains no test data: a row of names such as Time, Extension, Load, a row of units, and numbers"
        raise grid.source.refused("", limit, "export the raw data of the specimens too")
    if len(blocks) < (1 if marked or lists else 2):
        return []
    listed = {row for rows in lists for row in rows}
    for row in others:
        if row not in listed and sum(map(is_number, grid.rows[row])) > 1 and is_number(grid.rows[row][0]):
            raise grid.refused(row, None, "contains numbers that belong to no table", "export the file again")
    above = [grid.rows[row] for row in others if row not in listed]
    if _MTS.match(grid.rows[0][0]):
        return [_table(grid, _joined(grid, blocks), "", above)]
    names, titled = _names(blocks), [block.title for block in blocks]
    chosen = [(rows[0], rows[1], _of_each(grid, rows[2:], names, by_name=names == titled)) for rows in lists]
    return [
        _table(grid, block, name, [*above, *_lines(grid, chosen, number)])
        for number, (name, block) in enumerate(zip(names, blocks, strict=True))
    ]


def _stacked(grid: Grid) -> Iterator[_Block]:
    """Return the tables of a test, one below the other."""
    row = 0
    while row < len(grid.rows) - _MIN_ROWS:
        end = row + 2
        if _heads(grid, row):
            while end < len(grid.rows) and not grid.is_blank(end) and _is_row(grid, end):
                end += 1
        if end - row - 2 < _MIN_ROWS:
            row += 1
            continue
        above = [cell for cell in grid.rows[row - 1] if cell] if row else []
        title = above[0] if above and len(set(above)) == 1 and not _EXPORT.search(above[0]) else ""
        yield _Block(title, row, range(row + 2, end), range(grid.width(row)))
        row = end


def _heads(grid: Grid, row: int) -> bool:
    """Whether a row names test columns for at least two quantities, with their units below."""
    names, units = grid.rows[row], grid.rows[row + 1]
    if len(names) < 2 or is_number(names[0]) or len(units) < grid.width(row):
        return False
    pairs = [(name, unit.strip("()[]")) for name, unit in zip(names, units, strict=False) if name]
    if not all(stated_unit(unit) for _, unit in pairs):
        return False
    return len({heading(name, unit).quantity for name, unit in pairs} & _MECHANICAL) > 1


def _is_row(grid: Grid, row: int) -> bool:
    return all(is_number(cell) or is_missing(cell) for cell in grid.rows[row])


def _side_by_side(grid: Grid, block: _Block) -> Iterator[_Block]:
    """Return specimens in repeated columns side by side, each with its rows; the block itself if no columns repeat."""
    names = [plain(name) for name in grid.rows[block.header][: len(block.columns)]]
    filled = [n for n, name in enumerate(names) if name]
    starts = [n for n in filled if names[n] == names[filled[0]]]
    if len(starts) < 2:
        yield block
        return
    for start, end in zip(starts, [*starts[1:], len(names)], strict=True):
        columns = range(start, max(n for n in filled if n < end) + 1)
        titles = [cell for cell in grid.rows[block.header - 1][start:end] if cell] if block.header else []
        held = [row for row in block.body if any(grid.rows[row][start:end])]
        yield _Block(titles[0] if titles else "", block.header, held, columns)


def _joined(grid: Grid, blocks: Sequence[_Block]) -> _Block:
    """Return consecutive acquisitions joined to a single test; raise `DataError` if their columns differ."""
    first = blocks[0]
    for block in blocks[1:]:
        if grid.rows[block.header : block.header + 2] != grid.rows[first.header : first.header + 2]:
            raise grid.refused(
                block.header, None, "has different columns from the acquisition above it", "export it alone"
            )
    return replace(first, body=[row for block in blocks for row in block.body])


def _lists(grid: Grid, others: Sequence[int]) -> list[list[int]]:
    """Return the result lists, each with a header row, an optional unit row and a row for each specimen."""
    lists: list[list[int]] = []
    for row, below in pairwise(others):
        cells, units = grid.rows[row], grid.rows[below]
        if lists and row == lists[-1][-1] + 1 and grid.width(row) > 1:
            lists[-1].append(row)
        elif plain(cells[0]) in _LISTED and grid.width(row) > 1 and below == row + 1 and _states_units(units):
            lists.append([row])
    if lists and others[-1] == lists[-1][-1] + 1:
        lists[-1].append(others[-1])
    return lists


def _states_units(cells: Sequence[str]) -> bool:
    """Whether a row of a list contains the units of its columns."""
    stated = [cell.strip("()[]") for cell in cells[1:] if cell]
    return plain(cells[0]) in _UNITS and bool(stated) and all(map(stated_unit, stated))


def _of_each(grid: Grid, rows: Sequence[int], names: Sequence[str], *, by_name: bool) -> dict[int, int]:
    """Return the list row for each specimen: matched by name, by the number in the name, or by position.

    Positions are used only if the counts agree.

    Raises
    ------
    DataError
        With the line that belongs to no specimen.
    """
    rows = [row for row in rows if plain(grid.rows[row][0]).rstrip(".:") not in _SUMMARIES]
    found: dict[int, int] = {}
    for key in (plain, _number) if by_name else ():
        keys, listed = [key(name) for name in names], [key(grid.rows[row][0]) for row in rows]
        found = {
            keys.index(one): row
            for one, row in zip(listed, rows, strict=True)
            if one and keys.count(one) == listed.count(one) == 1
        }
        if len(found) == len(rows):
            return found
    if not found and len(rows) == len(names):
        return dict(enumerate(rows))
    left = next(row for row in rows if row not in found.values())
    limit = f"matches none of the {len(names)} specimens, and {len(rows)} are listed: the assignment is ambiguous"
    raise grid.refused(left, None, limit, "use the same name, or delete its line")


def _number(name: str) -> str:
    """Return the number at the end of a name, without leading zeros; empty if there is none."""
    match = re.search(r"(\d+)\W*$", name)
    return "" if match is None else f"{int(match[1])}"


def _lines(grid: Grid, lists: Sequence[tuple[int, int, dict[int, int]]], number: int) -> Iterator[list[str]]:
    """Return a specimen's parameters from lists as rows of names, units and values."""
    for header, below, rows in lists:
        names, units, line = (
            [cell.strip("()[]") for cell in grid.rows[row]] if row is not None else []
            for row in (header, below, rows.get(number))
        )
        for place, value in enumerate(line[: len(names)]):
            if place and names[place] and value:
                yield [grid.rows[header][place], value, *units[place : place + 1]]


def _names(blocks: Sequence[_Block]) -> list[str]:
    """Return the name of each specimen: its title or number; empty for a single specimen."""
    titles = [block.title for block in blocks]
    if len(blocks) == 1:
        return titles
    whole = all(titles) and max(Counter(titles).values()) == 1
    return titles if whole else [f"specimen {number}" for number in range(1, len(blocks) + 1)]


def _table(grid: Grid, block: _Block, name: str, above: Sequence[list[str]]) -> Table:
    """Return a block as a separate grid, below its parameters."""
    chosen = [block.header, block.header + 1, *block.body]
    start, stop = block.columns.start, block.columns.stop
    beyond = max(map(grid.width, chosen)) > stop and grid.width(block.header) == stop and not start
    cut = slice(start, None if beyond else stop)
    rows = [grid.rows[row][cut] for row in chosen]
    count = len(above)
    own = replace(
        grid,
        rows=[*above, *rows],
        lines=[*[grid.lines[block.header]] * count, *(grid.lines[row] for row in chosen)],
        left=start,
    )
    units = [unit.strip("()[]") for unit in rows[1][: len(block.columns)]]
    names = rows[0][: len(block.columns)]
    place = Layout(count, names, units, list(range(count)), list(range(count + 2, count + len(chosen))), [])
    return Table(name, own, place)

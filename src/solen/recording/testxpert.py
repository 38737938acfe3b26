"""Exports from test machines: settings, results and channels of a test, from testXpert and similar programs.

An export has a block of parameters with values and units, a row of names (in German or English), a row of units, and
rows of numbers. It is read as a table; but because a machine wrote it, irregularities that a table made by hand may
have are damage here: a number in another form, an empty line or a comment among the numbers, a decreasing time, a
repeated line, a last line without a line break. Results computed by the machine (modulus, maximum force) are kept as
metadata, as the machine wrote them.

`program` recognises the header; `read` reads a `Grid`; `parameter` returns a parameter as a number.

Other programs write a single test in the same form and are recognised by their own words: MTS TestSuite by the lines
``File Path:``, ``Test:``, ``Test Run:`` and ``Date:`` above the names, which published readers of its CSV skip; Lloyd's
NEXYGEN by its names for extensions. NEXYGEN's layout is not published, so the header alone is used.
"""

import re
from collections import Counter
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.recording import scan, table
from solen.recording.grid import Grid
from solen.recording.headings import heading, plain
from solen.recording.layout import Layout
from solen.recording.model import Recording
from solen.recording.numbers import is_number, parse
from solen.units import factor

CHANNEL_NAMES = {
    *("standardkraft", "standardweg", "traverse abs.", "traversenweg absolut", "traversenweg", "prüfzeit", "pruefzeit"),
    *("standard force", "standard travel", "test time", "crosshead absolute", "absolute crosshead travel"),
    *("crosshead travel", "grip to grip separation", "nominelle dehnung"),
}
"""Channel names that only testXpert uses."""
_TEST_RUN, _NEXYGEN = "test run:", ("machine extension", "extension from preload")
_LIMITS = {"time": 1e8, "force": 1e8, "strain": 1e5, "displacement": 1e5, "crosshead": 1e5}
"""Limits that readings of test machines do not exceed in any unit, unless a decimal point was lost."""
_ATYPICAL = 0.002  # fraction of rows below which a feature is not typical of the program
_NUMBER_AND_UNIT = re.compile(r"(\S+)(?:\s+(\S.*))?")


def is_characteristic(cell: str) -> bool:
    """Return whether a cell is characteristic of these programs; only then is a table examined more closely."""
    text = plain(cell)
    return text in CHANNEL_NAMES or text.startswith((_TEST_RUN, *_NEXYGEN))


def program(grid: Grid, layout: Layout) -> str:
    """Return the program that wrote a table, from its column names and units or the lines above; empty if unknown."""
    names = {plain(name) for name in layout.names}
    units = [unit or heading(name).unit for name, unit in zip(layout.names, layout.units, strict=True)]
    if len(names) < 2 or not all(units):
        return ""
    if names & CHANNEL_NAMES and all(layout.units):
        return "testxpert"
    above = [plain(grid.rows[row][0]) for row in layout.before]
    if any(text.startswith(_TEST_RUN) for text in above) and any(text.startswith("file path:") for text in above):
        return "mts-testsuite"
    return "lloyd-nexygen" if any(name.startswith(_NEXYGEN) for name in names) else ""


def read(grid: Grid, layout: Layout, kind: str = "testxpert") -> Recording:
    """Read an export of one of these programs; raise `DataError` with the line and column of any damage."""
    _check_single_test(grid, layout)
    table.check_rows(grid, layout)
    columns = table.columns(grid, layout, machine=True)
    for column in columns:
        if column.values is None:
            raise grid.error(layout.body[0], column.index, "is not a number", "export only the test channels")
        _check(grid, layout, column, column.values)
    clock = next((column for column in columns if factor(column.head.unit, "s") is not None), None)
    if clock is not None and clock.values is not None:
        _check_time(grid, layout, clock, clock.values)
    _check_repeats(grid, layout)
    scan.check_digits(grid, [(column.index, layout.body) for column in columns])
    recording = table.recorded(grid, layout, columns, kind)
    locations = [f"in line {grid.lines[row]}" for row in layout.body]
    *others, last = (
        replace(channel, note=scan.outlier_note(channel.values, locations)) for channel in recording.channels
    )
    return replace(recording, channels=(*others, last.noted(grid.truncation_note(layout.body))))


def parameter(recording: Recording, *names: str) -> tuple[float, str] | None:
    """Return the value and unit of the first parameter with one of the names; None if there is none with a value.

    The names are those in the file, such as ``E-Modul`` or ``Probendicke a0``; case and spaces are ignored.
    """
    for name in names:
        for key, value in recording.provenance.metadata.items():
            match = _NUMBER_AND_UNIT.fullmatch(value)
            if plain(key) == plain(name) and match and is_number(match[1]):
                return parse(match[1], "," if "," in match[1] else "."), match[2] or ""
    return None


def _check_single_test(grid: Grid, layout: Layout) -> None:
    """Raise `DataError` unless the lines belong to one complete test."""
    repeated = [name for name, count in Counter(map(plain, layout.names)).items() if count > 1]
    if repeated:
        column = max(n for n, name in enumerate(layout.names) if plain(name) == repeated[0])
        limit = f"occurs in {layout.names.count(layout.names[column])} columns: several specimens side by side"
        raise grid.error(layout.header, column, limit, "export each specimen to a separate file")
    first, last = grid.lines[layout.body[0]], grid.lines[layout.body[-1]]
    comment = next((line for line, _ in grid.comments if first < line < last), None)
    if comment is not None:
        raise grid.source.error(f"line {comment}", "begins with # within the numbers", "restore it")
    gap = next((a for a, b in zip(layout.body, layout.body[1:], strict=False) if b != a + 1), None)
    if gap is not None:
        raise grid.error(gap + 1, None, "is empty, and numbers follow", "export each test to a separate file")
    if layout.after:
        raise grid.error(layout.after[0], None, "follows the numbers", "export a single test")


def _check(grid: Grid, layout: Layout, column: table.Column, values: FloatArray) -> None:
    """Raise `DataError` if a machine cannot have recorded the numbers of a channel."""
    quantity = column.head.quantity
    above = np.flatnonzero(np.abs(values) > _LIMITS.get(quantity, np.inf))
    if above.size:
        limit = f"exceeds {_LIMITS[quantity]:g}, which no {quantity} does"
        raise grid.error(layout.body[int(above[0])], column.index, limit)
    gap = np.isnan(values[1:-1]) & np.isfinite(values[:-2]) & np.isfinite(values[2:])
    if 0 < gap.sum() <= _ATYPICAL * values.size + 1:
        raise grid.error(layout.body[int(np.flatnonzero(gap)[0]) + 1], column.index, "is empty between numbers")
    scan.check_outliers(grid, column.index, layout.body, values)


def _check_time(grid: Grid, layout: Layout, column: table.Column, values: FloatArray) -> None:
    """Raise `DataError` if the time decreases, or is repeated at few points."""
    steps = np.diff(values)
    wrong = ~(steps >= 0.0)
    constant = steps == 0.0
    if (
        constant.sum() <= _ATYPICAL * values.size + 1
    ):  # in fast recordings, many times may be rounded to the same number
        wrong |= constant
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        limit = f"follows {values[first]:g}: the time of a test must increase"
        raise grid.error(layout.body[first + 1], column.index, limit)


def _check_repeats(grid: Grid, layout: Layout) -> None:
    """Raise `DataError` at a repeated row, because the printed time of a test always increases."""
    if len(layout.names) < 3:
        return
    for before, row in zip(layout.body, layout.body[1:], strict=False):
        if grid.rows[row] == grid.rows[before]:
            raise grid.error(row, None, "repeats the previous line", "remove one of the two lines")

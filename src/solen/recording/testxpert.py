"""Exports from test machines: settings and results, then the test channels; testXpert in German or English.

An export has a block of parameters with values and units, a row of names, a row of units, and rows of numbers. It is
read as a table; but because a machine wrote it, irregularities that are allowed in a handwritten table are damage here:
a number in another form, an empty line or a remark among the numbers, a decreasing time, a repeated line, a last line
without a line break. Results computed by the machine (modulus, maximum force) stay in the metadata of the recording, as
written by the machine.

`program` recognises the header; `read` reads a `Grid`; `stated` returns a parameter as a number.

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
from solen.recording.layout import Layout
from solen.recording.model import Recording
from solen.recording.numbers import is_number, parse
from solen.recording.words import heading, plain
from solen.units import factor

WORDS = {
    *("standardkraft", "standardweg", "traverse abs.", "traversenweg absolut", "traversenweg", "prüfzeit", "pruefzeit"),
    *("standard force", "standard travel", "test time", "crosshead absolute", "absolute crosshead travel"),
    *("crosshead travel", "grip to grip separation", "nominelle dehnung"),
}
"""Channel names that only the program in question uses."""
_TEST_RUN, _NEXYGEN = "test run:", ("machine extension", "extension from preload")
_LIMITS = {"time": 1e8, "force": 1e8, "strain": 1e5, "displacement": 1e5, "crosshead": 1e5}
"""Limits that no test machine reading exceeds in any unit unless a decimal point was lost."""
_RARE = 0.002  # fraction of rows below which a feature is not typical of the program
_STATED = re.compile(r"(\S+)(?:\s+(\S.*))?")


def mentioned(cell: str) -> bool:
    """Whether a cell may come from such a program.

    Most tables have no such cell, and their layout is then searched for only once.
    """
    text = plain(cell)
    return text in WORDS or text.startswith((_TEST_RUN, *_NEXYGEN))


def program(grid: Grid, place: Layout) -> str:
    """Return the program that wrote a table, recognised by column names and units or by the lines above.

    Empty if unknown.
    """
    names = {plain(name) for name in place.names}
    units = [unit or heading(name).unit for name, unit in zip(place.names, place.units, strict=True)]
    if len(names) < 2 or not all(units):
        return ""
    if names & WORDS and all(place.units):
        return "testxpert"
    above = [plain(grid.rows[row][0]) for row in place.before]
    if any(text.startswith(_TEST_RUN) for text in above) and any(text.startswith("file path:") for text in above):
        return "mts-testsuite"
    return "lloyd-nexygen" if any(name.startswith(_NEXYGEN) for name in names) else ""


def read(grid: Grid, place: Layout, kind: str = "testxpert") -> Recording:
    """Read an export of this or another program; raise `DataError` with the line and column of any damage."""
    _check_whole(grid, place)
    table.check_rows(grid, place)
    columns = table.columns(grid, place, machine=True)
    for column in columns:
        if column.values is None:
            raise grid.refused(place.body[0], column.place, "is not a number", "export only the test channels")
        _check(grid, place, column, column.values)
    clock = next((column for column in columns if factor(column.head.unit, "s") is not None), None)
    if clock is not None and clock.values is not None:
        _check_time(grid, place, clock, clock.values)
    _check_repeats(grid, place)
    scan.check_digits(grid, [(column.place, place.body) for column in columns])
    made = table.recorded(grid, place, columns, kind)
    where = [f"in line {grid.lines[row]}" for row in place.body]
    *others, last = (replace(channel, note=scan.alone_note(channel.values, where)) for channel in made.channels)
    return replace(made, channels=(*others, last.noted(grid.ending(place.body))))


def stated(recording: Recording, *names: str) -> tuple[float, str] | None:
    """Return number and unit of the first parameter with one of the names; None if absent or without value.

    The names are those used in the file, ``E-Modul`` or ``Probendicke a0``; case and spaces do not matter.
    """
    for name in names:
        for key, value in recording.provenance.metadata.items():
            match = _STATED.fullmatch(value)
            if plain(key) == plain(name) and match and is_number(match[1]):
                return parse(match[1], "," if "," in match[1] else "."), match[2] or ""
    return None


def _check_whole(grid: Grid, place: Layout) -> None:
    """Raise `DataError` unless the lines belong to one complete test."""
    twice = [name for name, count in Counter(map(plain, place.names)).items() if count > 1]
    if twice:
        column = max(n for n, name in enumerate(place.names) if plain(name) == twice[0])
        limit = f"occurs in {place.names.count(place.names[column])} columns: several specimens side by side"
        raise grid.refused(place.header, column, limit, "export each specimen to a separate file")
    first, last = grid.lines[place.body[0]], grid.lines[place.body[-1]]
    remark = next((line for line, _ in grid.remarks if first < line < last), None)
    if remark is not None:
        raise grid.source.refused(f"line {remark}", "begins with # within the numbers", "restore it")
    hole = next((a for a, b in zip(place.body, place.body[1:], strict=False) if b != a + 1), None)
    if hole is not None:
        raise grid.refused(hole + 1, None, "is empty, and numbers follow", "export each test to a separate file")
    if place.after:
        raise grid.refused(place.after[0], None, "follows the numbers", "export a single test")


def _check(grid: Grid, place: Layout, column: table.Column, values: FloatArray) -> None:
    """Raise `DataError` if a machine cannot have recorded the numbers in a channel."""
    quantity = column.head.quantity
    beyond = np.flatnonzero(np.abs(values) > _LIMITS.get(quantity, np.inf))
    if beyond.size:
        limit = f"no {quantity} exceeds {_LIMITS[quantity]:g}"
        raise grid.refused(place.body[int(beyond[0])], column.place, limit)
    hole = np.isnan(values[1:-1]) & np.isfinite(values[:-2]) & np.isfinite(values[2:])
    if 0 < hole.sum() <= _RARE * values.size + 1:
        raise grid.refused(place.body[int(np.flatnonzero(hole)[0]) + 1], column.place, "is empty between numbers")
    scan.check_wild(grid, column.place, place.body, values)


def _check_time(grid: Grid, place: Layout, column: table.Column, values: FloatArray) -> None:
    """Raise `DataError` if the time decreases or stays constant at a single point."""
    steps = np.diff(values)
    wrong = ~(steps >= 0.0)
    still = steps == 0.0
    if still.sum() <= _RARE * values.size + 1:  # in a fast recording several times may be rounded to the same number
        wrong |= still
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        limit = f"follows {values[first]:g}: the time of a test must increase"
        raise grid.refused(place.body[first + 1], column.place, limit)


def _check_repeats(grid: Grid, place: Layout) -> None:
    """Raise `DataError` at a repeated row, since the printed time of a test always advances."""
    if len(place.names) < 3:
        return
    for before, row in zip(place.body, place.body[1:], strict=False):
        if grid.rows[row] == grid.rows[before]:
            raise grid.refused(row, None, "repeats the previous line", "remove one of the two lines")

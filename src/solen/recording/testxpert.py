"""Exports of test machines: settings and results, then the channels of the test; testXpert's in German or English.

The idea: a block of parameters, each with its value and unit, a row of names, a row of units, rows of numbers. It is a
table, and read as one; but a machine wrote it, so all that a hand would do to a table is damage here: a number in
another form, an empty line or a remark inside, a time that runs back, the same line twice, a last line without an end.
What the machine computed itself (modulus, greatest force) stays in the recording's metadata, by the machine's words.

The interface: `program` recognises the header, `read` a `Grid`; `stated` gives a parameter as a number.

Other programs write one test alone in the same way, and are known by their own words: MTS TestSuite's lines ``File
Path:``, ``Test:``, ``Test Run:`` and ``Date:`` above the names, as published readers of its CSV skip them; Lloyd's
NEXYGEN by its names of extensions. NEXYGEN's layout is nowhere described: it is read by its header alone.
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
"""Names of channels that only this program gives."""
_TEST_RUN, _NEXYGEN = "test run:", ("machine extension", "extension from preload")
_LIMITS = {"time": 1e8, "force": 1e8, "strain": 1e5, "displacement": 1e5, "crosshead": 1e5}
"""No test machine shows a number beyond these, in any unit that it writes: a lost decimal point does."""
_RARE = 0.002  # share of rows: what happens less often than this is not a habit of the program
_STATED = re.compile(r"(\S+)(?:\s+(\S.*))?")


def mentioned(cell: str) -> bool:
    """Whether a cell may be of such a program: most tables have none, and their layout is sought once only."""
    text = plain(cell)
    return text in WORDS or text.startswith((_TEST_RUN, *_NEXYGEN))


def program(grid: Grid, place: Layout) -> str:
    """Program that wrote a table, recognised by column names and units or the lines above; empty if unknown."""
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
    """Recording of an export of this or another program; `DataError` with the line and column of any damage."""
    _check_whole(grid, place)
    table.check_rows(grid, place)
    columns = table.columns(grid, place, machine=True)
    for column in columns:
        if column.values is None:
            raise grid.refused(place.body[0], column.place, "is not a number", "export the channels of the test alone")
        _check(grid, place, column, column.values)
    clock = next((one for one in columns if factor(one.head.unit, "s") is not None), None)
    if clock is not None and clock.values is not None:
        _check_time(grid, place, clock, clock.values)
    _check_repeats(grid, place)
    scan.check_digits(grid, [(column.place, place.body) for column in columns])
    made = table.recorded(grid, place, columns, kind)
    where = [f"in line {grid.lines[row]}" for row in place.body]
    *others, last = (replace(channel, note=scan.alone_note(channel.values, where)) for channel in made.channels)
    return replace(made, channels=(*others, last.noted(grid.ending(place.body))))


def stated(recording: Recording, *names: str) -> tuple[float, str] | None:
    """Number and unit of the first parameter with one of the given names; None if it is absent or has no value.

    The names are the file's own, ``E-Modul`` or ``Probendicke a0``; case and spaces do not matter.
    """
    for name in names:
        for key, value in recording.provenance.metadata.items():
            match = _STATED.fullmatch(value)
            if plain(key) == plain(name) and match and is_number(match[1]):
                return parse(match[1], "," if "," in match[1] else "."), match[2] or ""
    return None


def _check_whole(grid: Grid, place: Layout) -> None:
    """`DataError` unless the lines belong to one complete test."""
    twice = [name for name, count in Counter(map(plain, place.names)).items() if count > 1]
    if twice:
        column = max(n for n, name in enumerate(place.names) if plain(name) == twice[0])
        limit = f"occurs in {place.names.count(place.names[column])} columns: several specimens side by side"
        raise grid.refused(place.header, column, limit, "export each specimen to a file of its own")
    first, last = grid.lines[place.body[0]], grid.lines[place.body[-1]]
    remark = next((line for line, _ in grid.remarks if first < line < last), None)
    if remark is not None:
        raise grid.source.refused(f"line {remark}", "begins with #, among the numbers", "restore it")
    hole = next((a for a, b in zip(place.body, place.body[1:], strict=False) if b != a + 1), None)
    if hole is not None:
        raise grid.refused(hole + 1, None, "is empty, and numbers follow", "export each test to a file of its own")
    if place.after:
        raise grid.refused(place.after[0], None, "follows the numbers", "export one test alone")


def _check(grid: Grid, place: Layout, column: table.Column, values: FloatArray) -> None:
    """`DataError` if a machine cannot have recorded the numbers of a channel."""
    quantity = column.head.quantity
    beyond = np.flatnonzero(np.abs(values) > _LIMITS.get(quantity, np.inf))
    if beyond.size:
        limit = f"no {quantity} is beyond {_LIMITS[quantity]:g}"
        raise grid.refused(place.body[int(beyond[0])], column.place, limit)
    hole = np.isnan(values[1:-1]) & np.isfinite(values[:-2]) & np.isfinite(values[2:])
    if 0 < hole.sum() <= _RARE * values.size + 1:
        raise grid.refused(place.body[int(np.flatnonzero(hole)[0]) + 1], column.place, "is empty between numbers")
    scan.check_wild(grid, column.place, place.body, values)


def _check_time(grid: Grid, place: Layout, column: table.Column, values: FloatArray) -> None:
    """`DataError` if time runs backwards, or stands still at a single point."""
    steps = np.diff(values)
    wrong = ~(steps >= 0.0)
    still = steps == 0.0
    if still.sum() <= _RARE * values.size + 1:  # prints of a fast recording may round many times alike
        wrong |= still
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        limit = f"follows {values[first]:g}: the time of a test moves on"
        raise grid.refused(place.body[first + 1], column.place, limit)


def _check_repeats(grid: Grid, place: Layout) -> None:
    """`DataError` at a repeated row: the printed time of a test always advances."""
    if len(place.names) < 3:
        return
    for before, row in zip(place.body, place.body[1:], strict=False):
        if grid.rows[row] == grid.rows[before]:
            raise grid.refused(row, None, "repeats the previous line", "remove one of them")

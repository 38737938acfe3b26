"""Plain tables: a header with units and rows of numbers and words, from a spreadsheet, a script or an editor.

The header names the columns (`solen.recording.words`), and `solen.recording.layout` finds the table in the file; this
module converts the columns to channels. A number column with one non-numeric cell is treated as damaged, not as a text
column. A wavelength column is the axis of the others, and so is a time column.

Public names: `read`, `columns` and `recorded`.
"""

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray
from solen.ranks import note
from solen.recording import dates
from solen.recording.grid import Grid, cut_note
from solen.recording.layout import Layout
from solen.recording.model import FROM_WAVENUMBERS, Channel, Provenance, Recording
from solen.recording.numbers import all_numbers, is_missing, is_number
from solen.recording.scan import RANGE_NM, alone_note, disorder
from solen.recording.source import Source
from solen.recording.words import Heading, heading, is_label, plain
from solen.units import factor

_STAMPS = ("timestamp", "time stamp", "datetime", "date time", "date/time", "zeitstempel", "clock", "uhrzeit")
"""Names of columns that may contain clock times."""
_TAKEN_NM = (150.0, 50_000.0)
"""Range in which wavelengths without a unit are assumed to be in nm: in µm they would be far infrared, in Å X-rays."""

SIMULATED = re.compile(
    r"((this|the) (table|file|data|recording)s? (is|are|was|were) )?(simulat(ed|ion)|synthetic)\b", re.IGNORECASE
)
"""Beginning of a remark saying that the numbers were computed."""


@dataclass(frozen=True)
class Column:
    """A column before it becomes a channel: its position, header and heading, and its numbers, words or both."""

    place: int
    text: str
    head: Heading
    values: FloatArray | None
    words: tuple[str, ...] | None


def read(grid: Grid, place: Layout) -> Recording:
    """Read a plain table; raise `DataError` with the line and column of any damage."""
    check_rows(grid, place)
    found = columns(grid, place)
    for column in found:
        _check_range(grid, place, column)
    return recorded(grid, place, found, "table")


def check_rows(grid: Grid, place: Layout) -> None:
    """Raise `DataError` at the first row that has more or fewer cells than the header."""
    expected = len(place.names)
    unnamed = next((n for n, name in enumerate(place.names) if n and not name), None)  # only an index may be unnamed
    if unnamed is not None and any(any(grid.rows[row][unnamed : unnamed + 1]) for row in place.body):
        limit = f"has no header above column {unnamed + 1}"
        raise grid.refused(place.header, None, limit, "name every column that contains values")
    if not place.body:
        raise grid.source.refused("", "has a header but no rows", "export it again")
    for row in place.body:
        if len(grid.rows[row]) != len(grid.rows[place.body[0]]) and _begins_another(grid, place, row):
            raise grid.refused(row, None, "begins another table", "keep only one table in each file or worksheet")
        if grid.width(row) > expected:
            raise grid.refused(row, expected, f"is beyond the {expected} columns of the header")
        if len(grid.rows[row]) < expected:
            count = len(grid.rows[row])
            limit = f"has {count} cell{'s' * (count != 1)}, the header {expected}: something is missing or cut off"
            raise grid.refused(row, None, limit, "restore it, with a separator for each empty cell")


def _begins_another(grid: Grid, place: Layout, row: int) -> bool:
    """Whether a row of words follows an empty one."""
    return row != place.body[0] and grid.is_blank(row - 1) and not any(map(is_number, grid.rows[row]))


def columns(grid: Grid, place: Layout, *, machine: bool = False) -> list[Column]:
    """Return the table columns, with numbers or words according to their cells.

    ``machine`` tells whether a program wrote the table.
    """
    held = [n for n, name in enumerate(place.names) if name or n == 0]
    cells = {column: grid.cells(column, place.body) for column in held}
    kinds = {column: _kind(cells[column], place.names[column]) for column in held}
    mark = grid.mark(place.body, {column: cells[column] for column in held if "number" in kinds[column]})
    found = []
    for column, head in zip(held, _headings(place, held), strict=True):
        kind = kinds[column]
        stamps = dates.seconds(cells[column]) if kind == "word" and _is_time(head) else None
        if stamps is not None:
            head = replace(head, unit="s", quantity="time")
            found.append(Column(column, place.names[column], head, stamps, tuple(cells[column])))
            continue
        if kind == "word" and (head.unit or head.quantity):
            row = next(row for row, cell in zip(place.body, cells[column], strict=True) if not is_missing(cell))
            raise grid.refused(row, column, "is not a number", f"write plain numbers below {place.names[column]}")
        values = None
        if "number" in kind:
            values = grid.column(column, place.body, cells[column], mark, machine=machine)
        words = tuple(cells[column]) if "word" in kind else None
        if values is None or place.names[column] or not np.array_equal(values, np.arange(values.size)):
            found.append(Column(column, place.names[column], head, values, words))  # except pandas' row numbers
    return found


def _is_time(head: Heading) -> bool:
    """Whether a text column may contain clock times."""
    return head.quantity == "time" or (not head.unit and plain(head.name) in _STAMPS)


def _headings(place: Layout, held: Sequence[int]) -> list[Heading]:
    """Return the meaning of the headers in context: T is a transmittance if there are wavelengths."""
    texts = [(place.names[column] or f"column {column + 1}", place.units[column]) for column in held]
    optical = any(heading(name, unit).quantity in {"wavelength", "wavenumber"} for name, unit in texts)
    return [heading(name, unit, optical=optical) for name, unit in texts]


def _check_range(grid: Grid, place: Layout, column: Column) -> None:
    """Raise `DataError` at an impossible wavelength, as after a displacement of the column names."""
    if column.head.quantity != "wavelength" or column.values is None or not column.head.unit:
        return
    nm = column.values * (factor(column.head.unit, "nm") or math.nan)
    outside = np.flatnonzero((nm < RANGE_NM[0]) | (nm > RANGE_NM[1]))
    if outside.size:
        limit = f"no wavelength in nm is outside {RANGE_NM[0]:g} to {RANGE_NM[1]:g}"
        raise grid.refused(place.body[int(outside[0])], column.place, limit, "correct it, or the unit in the header")


def _kind(cells: list[str], name: str) -> str:
    """Return ``number``, ``word``, or ``number and word`` for numbers that label the rows."""
    if all_numbers(cells):
        return "number and word" if is_label(name) else "number"
    numbers = [cell for cell in cells if is_number(cell)]
    whole = len(numbers) == sum(not is_missing(cell) for cell in cells)
    if is_label(name):
        return "number and word" if whole else "word"
    return "number" if numbers or whole else "word"


def recorded(grid: Grid, place: Layout, result: list[Column], kind: str) -> Recording:
    """Make a recording from the columns and the entries about them in the file."""
    names = unique([column.head.name for column in result])
    channels = [
        Channel(name, column.head.quantity, column.head.unit, column.values, note=_ending(grid, place, column))
        for name, column in zip(names, result, strict=True)
        if column.values is not None
    ]
    if place.again and channels:
        times = "once" if place.again == 1 else f"{place.again} times"
        where = f"the header is repeated {times} among the rows, as in appended files"
        channels[0] = channels[0].noted(note(where))
    texts = {name: column.words for name, column in zip(names, result, strict=True) if column.words is not None}
    metadata = parameters(grid, place)
    instrument = _first(metadata, ("instrument", "machine", "prüfmaschine", "spectrometer", "spektrometer", "gerät"))
    provenance = stated_provenance(grid.source, kind, metadata, instrument)
    labels = {
        channel.name
        for channel in channels
        if channel.name in texts and not np.any(np.nan_to_num(channel.values) % 1.0)
    }  # 1, 2, 3; 0, 90
    return Recording(tuple(along_axes(_with_percent(channels), labels)), provenance, texts)


def stated_provenance(source: Source, kind: str, stated: Mapping[str, str], instrument: str) -> Provenance:
    """Return the provenance of a file, with the date and origin given in the file."""
    return Provenance(
        source.name, source.sha256, kind, instrument, dates.among(stated), stated, simulated=is_simulated(stated)
    )


def is_simulated(metadata: Mapping[str, str]) -> bool:
    """Whether parameters or remarks say that the numbers were computed: ``simulated: yes``, ``# simulated from``."""
    stated = [value for key, value in metadata.items() if plain(key) in {"simulated", "simulation", "synthetic"}]
    if stated:
        return plain(stated[0]) not in {"no", "false", "0", "nein", "none"}
    return any(SIMULATED.match(value.strip()) for value in metadata.values())


def unique(names: Sequence[str]) -> list[str]:
    """Return names made unique by numbering the repetitions: ``sample``, ``sample (2)``."""
    seen: Counter[str] = Counter()
    taken = set(names)
    found = []
    for name in names:
        seen[name] += 1
        made = name
        while seen[name] > 1 and (made := f"{name} ({seen[name]})") in taken:
            seen[name] += 1
        taken.add(made)
        found.append(made)
    return found


def parameters(grid: Grid, place: Layout) -> dict[str, str]:
    """Return the lines above and below the table: named values and remarks."""
    pairs = [_parameter([cell for cell in grid.rows[row] if cell]) for row in place.before]
    found = dict(zip(unique([key for key, _ in pairs]), (value for _, value in pairs), strict=True))
    remarks = [text for _, text in grid.remarks if text] + [" ".join(grid.rows[row]).strip() for row in place.after]
    for text in remarks:
        key, separator, value = text.partition(":")
        if separator and value.strip() and len(key) < 40 and key.strip().replace(" ", "").isalnum():
            found[key.strip()] = value.strip()
    texts = [text for text in remarks if text]
    return found | ({"remarks": " | ".join(texts)} if texts else {})


def _parameter(cells: list[str]) -> tuple[str, str]:
    """Return the name and value on a line above the table; a line without a name is a title."""
    key, separator, value = cells[0].partition(":")
    if len(cells) > 1:
        return cells[0].rstrip(": "), " ".join(cells[1:])
    return (key.strip(), value.strip()) if separator and value.strip() else ("title", cells[0])


def along_axes(channels: list[Channel], labels: Collection[str]) -> list[Channel]:
    """Return the channels with their axes: the wavelength to their left, or else the time; none for labels."""
    channels = _with_wavelengths(channels)
    waves = [channel for channel in channels if channel.quantity == "wavelength"]
    if waves:
        return _along_waves(channels, labels)
    times = [channel for channel in channels if channel.quantity == "time"]
    if len(times) != 1 or not np.all(np.diff(times[0].values) >= 0):  # exposure times side by side are not an axis
        return channels
    free = {times[0].name, *labels}
    return [replace(channel, axis="" if channel.name in free else times[0].name) for channel in channels]


def _with_wavelengths(channels: list[Channel]) -> list[Channel]:
    """Add wavelengths computed from wavenumbers if the file has none."""
    numbers = [channel for channel in channels if channel.quantity == "wavenumber" and channel.unit]
    if len(numbers) != 1 or any(channel.quantity == "wavelength" for channel in channels):
        return channels
    with np.errstate(divide="ignore"):
        waves_nm = 1e7 / numbers[0].to("1/cm")
    place = channels.index(numbers[0]) + 1
    made = Channel("wavelength", "wavelength", "nm", waves_nm, note=FROM_WAVENUMBERS)
    return [*channels[:place], made, *channels[place:]]


def _along_waves(channels: list[Channel], labels: Collection[str]) -> list[Channel]:
    axis = next(channel.name for channel in channels if channel.quantity == "wavelength")
    along_waves = []
    for channel in channels:
        if channel.quantity == "wavelength":
            axis = channel.name
            along_waves.append(_in_nm(channel).noted(disorder(channel.values)))
        elif channel.name in labels or channel.quantity == "wavenumber":
            along_waves.append(channel)
        else:
            waves = next(channel for channel in channels if channel.name == axis).values
            alone = alone_note(channel.values, [f"at wavelength {wave:g}" for wave in waves.tolist()])
            along_waves.append(replace(channel, axis=axis).noted(alone))
    return along_waves


def _in_nm(channel: Channel) -> Channel:
    """Set the wavelength unit to nm if the file gives none and no other is possible."""
    values = channel.values[np.isfinite(channel.values)]
    if channel.unit or not values.size or values.min() < _TAKEN_NM[0] or values.max() > _TAKEN_NM[1]:
        return channel
    note = f"no unit is given; {values.min():g} to {values.max():g} are assumed to be in nm"
    return replace(channel, unit="nm", note=note)


def _with_percent(channels: list[Channel]) -> list[Channel]:
    """Set the unit of spectra to %T if only an adjacent baseline indicates it, as in manually edited tables."""
    optical = any(channel.quantity == "wavelength" for channel in channels)
    baselines = [
        channel for channel in channels if channel.unit == "%" and channel.name.casefold().startswith("baseline")
    ]
    if not optical or not baselines:
        return channels
    known = {(baseline.quantity, baseline.unit) for baseline in baselines}
    if len(known) > 1:
        return channels
    quantity, unit = known.pop()
    note = f"no unit is given; assumed to be that of {baselines[0].name}"
    return [
        replace(channel, quantity=quantity, unit=unit, note=note)
        if not channel.unit and not channel.quantity
        else channel
        for channel in channels
    ]


def _ending(grid: Grid, place: Layout, column: Column) -> str:
    """Return a note on the last number, which may be truncated if the last line of the file has no line break."""
    cells = [grid.rows[row][column.place] for row in place.body]
    if grid.source.padding and column.place == len(place.names) - 1:
        return f"{grid.source.padding} NUL bytes follow the last row: the recorder may have stopped without warning"
    last = column.place == len(place.names) - 1 and grid.lines[place.body[-1]] == grid.lines[-1]
    if grid.ends or not last or len(cells) < 3 or len(cells[-1]) >= min(map(len, cells[:-1])):
        return ""
    return cut_note(cells[-1])


def _first(metadata: dict[str, str], names: tuple[str, ...]) -> str:
    return next((value for key, value in metadata.items() if plain(key) in names), "")

"""Plain tables from spreadsheets, scripts or editors: a header with units, and rows of numbers and words.

The header names the columns (`solen.recording.headings`), and `solen.recording.layout` finds the table in the file;
this module converts the columns to channels. A column of numbers with one non-numeric cell is treated as damaged, not
as a text column. A wavelength column is the axis of the others, and so is a time column.

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
from solen.recording.grid import Grid, truncated_number
from solen.recording.headings import Heading, heading, is_label, plain
from solen.recording.layout import Layout
from solen.recording.model import FROM_WAVENUMBERS, Channel, Provenance, Recording
from solen.recording.numbers import all_numbers, is_missing, is_number
from solen.recording.scan import RANGE_NM, order_note, outlier_note
from solen.recording.source import Source
from solen.units import factor

_CLOCK_NAMES = ("timestamp", "time stamp", "datetime", "date time", "date/time", "zeitstempel", "clock", "uhrzeit")
"""Names of columns that may contain clock times."""
_ASSUMED_NM = (150.0, 50_000.0)
"""Range in which wavelengths without a unit are assumed to be in nm; in µm they would be far infrared, in Å X-rays."""

SIMULATED = re.compile(
    r"((this|the) (table|file|data|recording)s? (is|are|was|were) )?(simulat(ed|ion)|synthetic)\b", re.IGNORECASE
)
"""Pattern of the beginning of a comment which says that the numbers were computed."""


@dataclass(frozen=True)
class Column:
    """A column of a table: its index, its header as text and interpreted, and its numbers, words or both."""

    index: int
    text: str
    head: Heading
    values: FloatArray | None
    words: tuple[str, ...] | None


def read(grid: Grid, layout: Layout) -> Recording:
    """Read a plain table; raise `DataError` with the line and column of any damage."""
    check_rows(grid, layout)
    table_columns = columns(grid, layout)
    for column in table_columns:
        _check_range(grid, layout, column)
    return recorded(grid, layout, table_columns, "table")


def check_rows(grid: Grid, layout: Layout) -> None:
    """Raise `DataError` at the first row that has more or fewer cells than the header."""
    expected = len(layout.names)
    unnamed = next(
        (n for n, name in enumerate(layout.names) if n and not name), None
    )  # only row numbers may be unnamed
    if unnamed is not None and any(any(grid.rows[row][unnamed : unnamed + 1]) for row in layout.body):
        limit = f"has no name for column {unnamed + 1}"
        raise grid.error(layout.header, None, limit, "name every column that contains values")
    if not layout.body:
        raise grid.source.error("", "has a header but no rows", "export it again")
    for row in layout.body:
        if len(grid.rows[row]) != len(grid.rows[layout.body[0]]) and _begins_another(grid, layout, row):
            raise grid.error(row, None, "begins another table", "keep only one table in each file or worksheet")
        if grid.width(row) > expected:
            raise grid.error(row, expected, f"is outside the {expected} columns of the header")
        if len(grid.rows[row]) < expected:
            count = len(grid.rows[row])
            limit = f"has {count} cell{'s' * (count != 1)}, but the header has {expected}: the line is incomplete"
            raise grid.error(row, None, limit, "restore the line, with a separator for each empty cell")


def _begins_another(grid: Grid, layout: Layout, row: int) -> bool:
    """Return whether a row of words follows an empty one."""
    return row != layout.body[0] and grid.is_blank(row - 1) and not any(map(is_number, grid.rows[row]))


def columns(grid: Grid, layout: Layout, *, machine: bool = False) -> list[Column]:
    """Return the columns of a table, with numbers or words according to their cells.

    ``machine`` is whether an instrument's program wrote the table.
    """
    indices = [n for n, name in enumerate(layout.names) if name or n == 0]
    cells = {column: grid.cells(column, layout.body) for column in indices}
    kinds = {column: _kind(cells[column], layout.names[column]) for column in indices}
    mark = grid.mark(layout.body, {column: cells[column] for column in indices if "number" in kinds[column]})
    table_columns = []
    for column, head in zip(indices, _headings(layout, indices), strict=True):
        kind = kinds[column]
        times_s = dates.seconds(cells[column]) if kind == "word" and _is_time(head) else None
        if times_s is not None:
            head = replace(head, unit="s", quantity="time")
            table_columns.append(Column(column, layout.names[column], head, times_s, tuple(cells[column])))
            continue
        if kind == "word" and (head.unit or head.quantity):
            row = next(row for row, cell in zip(layout.body, cells[column], strict=True) if not is_missing(cell))
            raise grid.error(row, column, "is not a number", f"write plain numbers below {layout.names[column]}")
        values = None
        if "number" in kind:
            values = grid.column(column, layout.body, cells[column], mark, machine=machine)
        words = tuple(cells[column]) if "word" in kind else None
        if values is None or layout.names[column] or not np.array_equal(values, np.arange(values.size)):
            table_columns.append(
                Column(column, layout.names[column], head, values, words)
            )  # without the row numbers of pandas
    return table_columns


def _is_time(head: Heading) -> bool:
    """Return whether a column of words may contain clock times."""
    return head.quantity == "time" or (not head.unit and plain(head.name) in _CLOCK_NAMES)


def _headings(layout: Layout, indices: Sequence[int]) -> list[Heading]:
    """Return the headings in context: T is a transmittance if there are wavelengths."""
    texts = [(layout.names[column] or f"column {column + 1}", layout.units[column]) for column in indices]
    optical = any(heading(name, unit).quantity in {"wavelength", "wavenumber"} for name, unit in texts)
    return [heading(name, unit, optical=optical) for name, unit in texts]


def _check_range(grid: Grid, layout: Layout, column: Column) -> None:
    """Raise `DataError` at an impossible wavelength, as with displaced column names."""
    if column.head.quantity != "wavelength" or column.values is None or not column.head.unit:
        return
    nm = column.values * (factor(column.head.unit, "nm") or math.nan)
    outside = np.flatnonzero((nm < RANGE_NM[0]) | (nm > RANGE_NM[1]))
    if outside.size:
        limit = f"is a wavelength outside {RANGE_NM[0]:g} to {RANGE_NM[1]:g} nm, the range of laboratory instruments"
        raise grid.error(
            layout.body[int(outside[0])], column.index, limit, "correct the value, or the unit in the header"
        )


def _kind(cells: list[str], name: str) -> str:
    """Return the kind of a column: ``number``, ``word``, or, if numbers label the rows, ``number and word``."""
    if all_numbers(cells):
        return "number and word" if is_label(name) else "number"
    numbers = [cell for cell in cells if is_number(cell)]
    only_numbers = len(numbers) == sum(not is_missing(cell) for cell in cells)
    if is_label(name):
        return "number and word" if only_numbers else "word"
    return "number" if numbers or only_numbers else "word"


def recorded(grid: Grid, layout: Layout, table_columns: list[Column], kind: str) -> Recording:
    """Return a recording from the columns of a table; its metadata are the entries above and below the table."""
    names = unique([column.head.name for column in table_columns])
    channels = [
        Channel(
            name, column.head.quantity, column.head.unit, column.values, note=_last_number_note(grid, layout, column)
        )
        for name, column in zip(names, table_columns, strict=True)
        if column.values is not None
    ]
    if layout.repetitions and channels:
        times = "once" if layout.repetitions == 1 else f"{layout.repetitions} times"
        text = f"the header is repeated {times} among the rows, as if files were appended"
        channels[0] = channels[0].noted(note(text))
    texts = {name: column.words for name, column in zip(names, table_columns, strict=True) if column.words is not None}
    metadata = parameters(grid, layout)
    instrument = _first_of(metadata, ("instrument", "machine", "prüfmaschine", "spectrometer", "spektrometer", "gerät"))
    provenance = provenance_of(grid.source, kind, metadata, instrument)
    labels = {
        channel.name
        for channel in channels
        if channel.name in texts and not np.any(np.nan_to_num(channel.values) % 1.0)
    }  # 1, 2, 3; 0, 90
    return Recording(tuple(along_axes(_with_percent(channels), labels)), provenance, texts)


def provenance_of(source: Source, kind: str, metadata: Mapping[str, str], instrument: str) -> Provenance:
    """Return the provenance of a file, with the date and simulation mark in its metadata."""
    return Provenance(
        source.name,
        source.sha256,
        kind,
        instrument,
        dates.date_of(metadata),
        metadata,
        simulated=is_simulated(metadata),
    )


def is_simulated(metadata: Mapping[str, str]) -> bool:
    """Return whether entries say that the numbers were computed: ``simulated: yes``, ``# simulated from``."""
    flags = [value for key, value in metadata.items() if plain(key) in {"simulated", "simulation", "synthetic"}]
    if flags:
        return plain(flags[0]) not in {"no", "false", "0", "nein", "none"}
    return any(SIMULATED.match(value.strip()) for value in metadata.values())


def unique(names: Sequence[str]) -> list[str]:
    """Return names made unique by numbering the repetitions: ``sample``, ``sample (2)``."""
    counts: Counter[str] = Counter()
    used = set(names)
    unique_names = []
    for name in names:
        counts[name] += 1
        candidate = name
        while counts[name] > 1 and (candidate := f"{name} ({counts[name]})") in used:
            counts[name] += 1
        used.add(candidate)
        unique_names.append(candidate)
    return unique_names


def parameters(grid: Grid, layout: Layout) -> dict[str, str]:
    """Return the entries above and below the table: named values and comments."""
    pairs = [_parameter([cell for cell in grid.rows[row] if cell]) for row in layout.before]
    entries = dict(zip(unique([key for key, _ in pairs]), (value for _, value in pairs), strict=True))
    remarks = [text for _, text in grid.comments if text] + [" ".join(grid.rows[row]).strip() for row in layout.after]
    for text in remarks:
        key, separator, value = text.partition(":")
        if separator and value.strip() and len(key) < 40 and key.strip().replace(" ", "").isalnum():
            entries[key.strip()] = value.strip()
    comments = [text for text in remarks if text]
    return entries | ({"comments": " | ".join(comments)} if comments else {})


def _parameter(cells: list[str]) -> tuple[str, str]:
    """Return the name and value on a line above the table; a line without a name is a title."""
    key, separator, value = cells[0].partition(":")
    if len(cells) > 1:
        return cells[0].rstrip(": "), " ".join(cells[1:])
    return (key.strip(), value.strip()) if separator and value.strip() else ("title", cells[0])


def along_axes(channels: list[Channel], labels: Collection[str]) -> list[Channel]:
    """Return the channels with their axes: the last wavelength to the left, or the time; labels have no axis."""
    channels = _with_wavelengths(channels)
    waves = [channel for channel in channels if channel.quantity == "wavelength"]
    if waves:
        return _along_waves(channels, labels)
    times = [channel for channel in channels if channel.quantity == "time"]
    if len(times) != 1 or not np.all(np.diff(times[0].values) >= 0):  # several exposure times are not an axis
        return channels
    free = {times[0].name, *labels}
    return [replace(channel, axis="" if channel.name in free else times[0].name) for channel in channels]


def _with_wavelengths(channels: list[Channel]) -> list[Channel]:
    """Return the channels with wavelengths computed from wavenumbers if the file has none."""
    numbers = [channel for channel in channels if channel.quantity == "wavenumber" and channel.unit]
    if len(numbers) != 1 or any(channel.quantity == "wavelength" for channel in channels):
        return channels
    with np.errstate(divide="ignore"):
        waves_nm = 1e7 / numbers[0].to("1/cm")
    layout = channels.index(numbers[0]) + 1
    wavelengths = Channel("wavelength", "wavelength", "nm", waves_nm, note=FROM_WAVENUMBERS)
    return [*channels[:layout], wavelengths, *channels[layout:]]


def _along_waves(channels: list[Channel], labels: Collection[str]) -> list[Channel]:
    axis = next(channel.name for channel in channels if channel.quantity == "wavelength")
    along_waves = []
    for channel in channels:
        if channel.quantity == "wavelength":
            axis = channel.name
            along_waves.append(_in_nm(channel).noted(order_note(channel.values)))
        elif channel.name in labels or channel.quantity == "wavenumber":
            along_waves.append(channel)
        else:
            waves = next(channel for channel in channels if channel.name == axis).values
            outliers = outlier_note(channel.values, [f"at wavelength {wave:g}" for wave in waves.tolist()])
            along_waves.append(replace(channel, axis=axis).noted(outliers))
    return along_waves


def _in_nm(channel: Channel) -> Channel:
    """Return a wavelength channel in nm if the file gives no unit and no other unit is possible."""
    values = channel.values[np.isfinite(channel.values)]
    if channel.unit or not values.size or values.min() < _ASSUMED_NM[0] or values.max() > _ASSUMED_NM[1]:
        return channel
    note = f"no known unit is given: {values.min():g} to {values.max():g} are assumed to be in nm"
    return replace(channel, unit="nm", note=note)


def _with_percent(channels: list[Channel]) -> list[Channel]:
    """Return the channels; those without unit and quantity get those of a baseline in the table (manual editing)."""
    optical = any(channel.quantity == "wavelength" for channel in channels)
    baselines = [
        channel for channel in channels if channel.unit == "%" and channel.name.casefold().startswith("baseline")
    ]
    if not optical or not baselines:
        return channels
    kinds = {(baseline.quantity, baseline.unit) for baseline in baselines}
    if len(kinds) > 1:
        return channels
    quantity, unit = kinds.pop()
    note = f"no unit is given: the unit of {baselines[0].name} is assumed"
    return [
        replace(channel, quantity=quantity, unit=unit, note=note)
        if not channel.unit and not channel.quantity
        else channel
        for channel in channels
    ]


def _last_number_note(grid: Grid, layout: Layout, column: Column) -> str:
    """Return a note on the last number if it may be truncated or the recorder stopped; otherwise empty."""
    cells = [grid.rows[row][column.index] for row in layout.body]
    if grid.source.padding and column.index == len(layout.names) - 1:
        return f"{grid.source.padding} NUL bytes follow the last row: the recorder may have stopped unexpectedly"
    last = column.index == len(layout.names) - 1 and grid.lines[layout.body[-1]] == grid.lines[-1]
    if grid.ends_in_break or not last or len(cells) < 3 or len(cells[-1]) >= min(map(len, cells[:-1])):
        return ""
    return truncated_number(cells[-1])


def _first_of(metadata: dict[str, str], keys: tuple[str, ...]) -> str:
    return next((value for key, value in metadata.items() if plain(key) in keys), "")

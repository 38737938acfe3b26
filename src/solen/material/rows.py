"""Selection of the table rows that may be evaluated together: of one resin, one wavelength, one specimen.

A fit to pooled rows of several resins, or of several wavelengths, gives a number that is valid for none of them. If a
column that an evaluation does not use varies, the rows differ; the table is therefore rejected, unless the user selects
the rows with one of its values or declares that the column has no effect. Columns with comments and dates are only
named in a note.

Replicates in parallel columns (``disc 1``, ``disc 2``) are converted to a single column.

`RowOptions` contains the options of a command, `chosen_rows` returns the selected rows, `stacked_replicates` handles
replicates in parallel columns, `refuse_unused` checks the remaining columns, and `constant_number` reads a column with
the same value in all rows.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from solen.errors import DataError, SpecError
from solen.ranks import Caution, note
from solen.recording import Channel, Recording
from solen.recording.headings import AXES, heading, plain, quantity_of
from solen.spec.strict import Options
from solen.units import factor

REPEATS = ("replicate", "repeat", "wiederholung", "reading", "run")
"""Names of columns that number repeated readings, which are averaged."""
_COMMENT_COLUMNS = frozenset(
    {"note", "notes", "comment", "comments", "remark", "remarks", "kommentar", "bemerkung", "date", "datum"}
    | {"timestamp", "file", "datei", "picture", "image", "operator", "nr", "nr.", "no", "no.", "#", "row", "column 1"}
)
"""Names of columns that do not describe what was measured."""
_NUMBERED = re.compile(r"(.*?)[\s_#.-]*\(?(\d+)\)?")
"""Pattern of a name with the number of a replicate: disc 1, thickness_2, depth (3)."""
_MAX_VALUES = 4  # number of values of a column that a message lists
_RATIO_TOLERANCE = 1e-6  # largest relative scatter of the ratio of two columns with one quantity in two units


class RowOptions(Options):
    """Options for selecting the rows of a table."""

    map: tuple[str, ...] = ()
    """Rename a column, OLD=NEW, for example stroke=displacement or reading=force_N; repeatable."""
    where: tuple[str, ...] = ()
    """Use only the rows with this value of a column, for example material=RA-139; repeatable."""
    ignore: tuple[str, ...] = ()
    """Name of a column that varies without effect on the result; repeatable."""


def chosen_rows(recording: Recording, options: RowOptions) -> Recording:
    """Return a recording with renamed columns (``map``), and only the selected rows (``where``).

    Raises
    ------
    SpecError
        If an option is malformed, or no row has the value.
    DataError
        If the table has no column with that name, or already has one with the new name.
    """
    for pair in options.map:
        recording = _renamed(recording, *_name_and_value(pair, "--map", "stroke=displacement"))
    for condition in options.where:
        name, value = _name_and_value(condition, "--where", "material=RA-139")
        column = _column(recording, name, "--where")
        keep = np.array([_equals(cell, value) for cell in _cells(recording, column)])
        if not keep.any():
            raise SpecError(
                "--where", value=condition, limit=f"no row has this value; {column} is {_values(recording, column)}"
            )
        recording = replace(
            recording,
            channels=tuple(replace(channel, values=channel.values[keep]) for channel in recording.channels),
            texts={
                key: tuple(cell for cell, kept in zip(cells, keep.tolist(), strict=True) if kept)
                for key, cells in recording.texts.items()
            },
        )
    return recording


def _name_and_value(text: str, option: str, example: str) -> tuple[str, str]:
    """Return the strings before and after the equals sign."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise SpecError(option, value=text, limit="is not of the form NAME=VALUE", remedy=f"write it as in {example}")
    return name, value


def _renamed(recording: Recording, name: str, new_name: str) -> Recording:
    """Return the recording with a column renamed, in the unit of the new name if the file specifies none."""
    optical = any(channel.quantity in AXES.values() for channel in recording.channels)
    column, head = _column(recording, name, "--map"), heading(new_name, optical=optical)
    if head.name != column and head.name in {*recording.names, *recording.texts}:
        limit = f"the column {head.name} already exists"
        raise DataError(f"--map {name}={new_name}", limit=limit, remedy="rename that column as well")
    texts = {head.name if key == column else key: cells for key, cells in recording.texts.items()}
    return replace(
        recording,
        channels=tuple(
            _with_name(channel, head.name, head.unit, optical=optical)
            if channel.name == column
            else replace(channel, axis=head.name if channel.axis == column else channel.axis)
            for channel in recording.channels
        ),
        texts=texts,
    )


def _with_name(channel: Channel, name: str, unit: str, *, optical: bool) -> Channel:
    if unit and channel.unit and factor(unit, channel.unit) != 1.0:
        limit = f"the unit in the header of the column is {channel.unit}"
        raise SpecError(f"--map {channel.name}", value=unit, limit=limit, remedy="omit the unit")
    quantity = quantity_of(name, unit or channel.unit, optical=optical)
    return replace(channel, name=name, quantity=quantity, unit=channel.unit or unit)


def stacked_replicates(recording: Recording, names: Sequence[str], labels: Sequence[str]) -> Recording:
    """Return a recording with replicate columns stacked into one column, and a text column that numbers the replicates.

    Parameters
    ----------
    recording
        A table; it is returned unchanged if it has no replicate columns.
    names
        Names of the quantity; columns with one of these names and a number are replicates. The first is the name of the
        stacked column.
    labels
        Names of replicates; columns with one of these names and a number are replicates, too. The first is the name of
        the text column.
    """
    known = {plain(name) for name in (*names, *labels)}
    columns = [
        channel
        for channel in recording.channels
        if plain(channel.name) in {plain(name) for name in names}
        or ((match := _NUMBERED.fullmatch(channel.name)) and plain(match[1]) in known)
    ]
    numbered = [column.name for column in columns if _NUMBERED.fullmatch(column.name)]
    unnumbered = [column.name for column in columns if column.name not in numbered]
    if unnumbered and len(numbered) > 1:
        raise DataError(
            f"column {unnumbered[0]}",
            limit=f"may be the mean of the replicates {', '.join(numbered)} and not another replicate",
            remedy=f"delete the column, or exclude it with --map {unnumbered[0]}=summary --ignore summary",
        )
    if len(columns) < 2 or any(recording.label(label) is not None for label in labels):
        return recording
    count, first = len(columns), columns[0]
    values = np.concatenate(
        [column.values if column.unit == first.unit else column.to(first.unit) for column in columns]
    )
    others = [
        replace(channel, values=np.tile(channel.values, count), axis="")
        for channel in recording.channels
        if channel not in columns
    ]
    numbers = [f"{number}" for number in range(1, count + 1) for _ in first.values]
    return replace(
        recording,
        channels=(
            *others,
            replace(first, name=names[0], quantity=quantity_of(names[0], first.unit), values=values, axis=""),
        ),
        texts={name: cells * count for name, cells in recording.texts.items()} | {labels[0]: tuple(numbers)},
    )


def refuse_unused(
    recording: Recording, options: RowOptions, used: Collection[str], *, labels_only: bool = False
) -> list[Caution]:
    """Raise if a column that is not used varies; otherwise return a note that names the unused comment columns.

    Parameters
    ----------
    recording, options
        A table, and the options that list the columns without effect.
    used
        Names of the columns that the evaluation uses.
    labels_only
        Check only the text columns, as for traces in parallel columns.

    Raises
    ------
    DataError
        If an unused column varies; the message contains its name and values.
    """
    ignored = {_column(recording, name, "--ignore") for name in options.ignore}
    known = ignored | {plain(name) for name in used} | set(used)
    traces = {channel.name for channel in recording.channels if channel.axis}
    names = [name for name in recording.texts if name not in traces]
    names += [] if labels_only else [name for name in recording.names if name not in names]
    varying = [name for name in names if not {name, plain(name)} & known and len(set(_cells(recording, name))) > 1]
    unused = [
        name for name in varying if plain(name) not in _COMMENT_COLUMNS and not _is_repeated(recording, name, used)
    ]
    if unused:
        column = unused[0]
        value = _cells(recording, column)[0]
        raise DataError(
            f"{recording.provenance.file or 'table'}: column {column}",
            value=_values(recording, column),
            limit="differs from row to row and is not used: rows that differ must not be pooled",
            remedy=f"select the rows with one value with --where {column}={value}, or declare "
            f"that this column has no effect with --ignore {column}",
        )
    comments = [name for name in varying if plain(name) in _COMMENT_COLUMNS]
    return [note(f"not used: column{'s' * (len(comments) > 1)} {', '.join(comments)}")] if comments else []


def constant_number(recording: Recording, names: Sequence[str], unit: str) -> float | None:
    """Return the number in a column, converted to a unit, if it is the same in all rows; otherwise None."""
    channel = recording.find(*names)
    if channel is None:
        return None
    values = channel.to(unit)
    return float(values[0]) if values.size and np.all(values == values[0]) else None


def _column(recording: Recording, name: str, option: str) -> str:
    """Return the name of a column in the recording; raise `DataError` if there is none."""
    columns = dict.fromkeys((*recording.texts, *recording.names))
    for column in columns:
        if plain(column) == plain(name):
            return column
    if (channel := recording.find(name)) is not None:
        return channel.name
    raise DataError(f"{option} {name}", limit=f"there is no such column; the columns are {', '.join(columns)}")


def _cells(recording: Recording, column: str) -> tuple[str, ...]:
    """Return the cells of a column as strings."""
    cells = recording.texts.get(column)
    return cells if cells is not None else tuple(f"{value:.9g}" for value in recording.channel(column).values)


def _equals(cell: str, value: str) -> bool:
    """Whether a cell equals a value, as a number or as a word."""
    try:
        return float(cell.replace(",", ".")) == float(value.replace(",", "."))
    except ValueError:
        return cell.strip().casefold() == value.casefold()


def _values(recording: Recording, column: str) -> str:
    """Return a list of a column's different values for a message."""
    values = list(dict.fromkeys(_cells(recording, column)))
    more = len(values) - _MAX_VALUES
    return ", ".join(values[:_MAX_VALUES]) + (f" and {more} more" if more > 0 else "")


def _is_repeated(recording: Recording, column: str, used: Collection[str]) -> bool:
    """Whether a column of numbers is a used column in another unit."""
    if column in recording.texts:
        return False
    others = [channel for channel in recording.channels if channel.name in used]
    return any(_proportional(recording.channel(column), other) for other in others)


def _proportional(channel: Channel, other: Channel) -> bool:
    with np.errstate(all="ignore"):
        ratio = channel.values / other.values
    return bool(np.isfinite(ratio).all() and np.ptp(ratio) <= _RATIO_TOLERANCE * abs(float(np.mean(ratio))))

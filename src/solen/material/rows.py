"""Selection of the table rows that belong together: one resin, one wavelength, one specimen, and no unused column.

A fit to pooled rows of several resins, or of several wavelengths, gives a number that is valid for none of them. A
column that varies means that the rows differ. A column that an evaluation does not use is therefore rejected by name,
unless the user selects the rows with one of its values or declares that it has no effect. Columns with comments and
dates are only named in a warning.

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
"""Names of columns that number repeated readings, used when they are averaged."""
_REMARKS = frozenset(
    {"note", "notes", "comment", "comments", "remark", "remarks", "kommentar", "bemerkung", "date", "datum"}
    | {"timestamp", "file", "datei", "picture", "image", "operator", "nr", "nr.", "no", "no.", "#", "row", "column 1"}
)
"""Names of columns that do not describe what was measured."""
_NUMBERED = re.compile(r"(.*?)[\s_#.-]*\(?(\d+)\)?")
"""A name with the number of a replicate: disc 1, thickness_2, depth (3)."""
_SHOWN = 4
_SAME = 1e-6  # largest relative scatter of the ratio of two columns with the same quantity in two units


class RowOptions(Options):
    """Options for selecting table rows that belong together."""

    map: tuple[str, ...] = ()
    """Read a column under another name, for example stroke=displacement or reading=force_N; repeatable."""
    where: tuple[str, ...] = ()
    """Use only the rows with one value of a column, for example material=RA-139; repeatable."""
    ignore: tuple[str, ...] = ()
    """Name of a column that varies without effect on the result; repeatable."""


def chosen_rows(recording: Recording, options: RowOptions) -> Recording:
    """Return the rows that meet the options' conditions.

    Raises
    ------
    SpecError
        If a condition is malformed, or no row meets it.
    DataError
        If the table has no column with that name, or already has one with the new name.
    """
    for pair in options.map:
        recording = _renamed(recording, *_sides(pair, "--map", "stroke=displacement"))
    for condition in options.where:
        name, value = _sides(condition, "--where", "material=RA-139")
        column = _column(recording, name, "--where")
        keep = np.array([_is(text, value) for text in _texts(recording, column)])
        if not keep.any():
            raise SpecError(
                "--where", value=condition, limit=f"no row has this value; {column} is {_values(recording, column)}"
            )
        recording = replace(
            recording,
            channels=tuple(replace(channel, values=channel.values[keep]) for channel in recording.channels),
            texts={
                key: tuple(text for text, kept in zip(texts, keep.tolist(), strict=True) if kept)
                for key, texts in recording.texts.items()
            },
        )
    return recording


def _sides(text: str, option: str, example: str) -> tuple[str, str]:
    """Return the texts before and after the equals sign."""
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise SpecError(option, value=text, limit="is not a name and a value", remedy=f"write it like {example}")
    return name, value


def _renamed(recording: Recording, name: str, wanted: str) -> Recording:
    """Return the recording with a column renamed, in the unit of the new name if the file specifies none."""
    optical = any(channel.quantity in AXES.values() for channel in recording.channels)
    column, head = _column(recording, name, "--map"), heading(wanted, optical=optical)
    if head.name != column and head.name in {*recording.names, *recording.texts}:
        raise DataError(
            f"--map {name}={wanted}", limit=f"a column {head.name} already exists", remedy="map that column as well"
        )
    texts = {head.name if key == column else key: cells for key, cells in recording.texts.items()}
    return replace(
        recording,
        channels=tuple(
            _as(channel, head.name, head.unit, optical=optical)
            if channel.name == column
            else replace(channel, axis=head.name if channel.axis == column else channel.axis)
            for channel in recording.channels
        ),
        texts=texts,
    )


def _as(channel: Channel, name: str, unit: str, *, optical: bool) -> Channel:
    if unit and channel.unit and factor(unit, channel.unit) != 1.0:
        limit = f"its header specifies {channel.unit}"
        raise SpecError(f"--map {channel.name}", value=unit, limit=limit, remedy="omit the unit")
    quantity = quantity_of(name, unit or channel.unit, optical=optical)
    return replace(channel, name=name, quantity=quantity, unit=channel.unit or unit)


def stacked_replicates(recording: Recording, names: Sequence[str], labels: Sequence[str]) -> Recording:
    """Return a recording with replicate columns stacked as rows of one column, and a text column that numbers them.

    Parameters
    ----------
    names
        Names of the quantity; the first becomes the column's name, those with numbers are replicates.
    labels
        Names of replicates; the first becomes the text's name.
    """
    known = {plain(name) for name in (*names, *labels)}
    columns = [
        channel
        for channel in recording.channels
        if plain(channel.name) in {plain(name) for name in names}
        or ((match := _NUMBERED.fullmatch(channel.name)) and plain(match[1]) in known)
    ]
    numbered = [column.name for column in columns if _NUMBERED.fullmatch(column.name)]
    alone = [column.name for column in columns if column.name not in numbered]
    if alone and len(numbered) > 1:
        raise DataError(
            f"column {alone[0]}",
            limit=f"occurs together with its replicates {', '.join(numbered)}: it may be their mean, not one of them",
            remedy=f"delete it, or omit it with --map {alone[0]}=summary --ignore summary",
        )
    if len(columns) < 2 or any(recording.label(label) is not None for label in labels):
        return recording
    times, first = len(columns), columns[0]
    values = np.concatenate(
        [column.values if column.unit == first.unit else column.to(first.unit) for column in columns]
    )
    beside = [
        replace(channel, values=np.tile(channel.values, times), axis="")
        for channel in recording.channels
        if channel not in columns
    ]
    numbers = [f"{number}" for number in range(1, times + 1) for _ in first.values]
    return replace(
        recording,
        channels=(
            *beside,
            replace(first, name=names[0], quantity=quantity_of(names[0], first.unit), values=values, axis=""),
        ),
        texts={name: cells * times for name, cells in recording.texts.items()} | {labels[0]: tuple(numbers)},
    )


def refuse_unused(
    recording: Recording, options: RowOptions, used: Collection[str], *, labels_only: bool = False
) -> list[Caution]:
    """Raise if an unused column varies; otherwise return warnings about unused columns.

    Parameters
    ----------
    used
        Names of the columns that the evaluation uses.
    labels_only
        Whether numbers are in parallel columns, as traces are, so that only row labels could differ unnoticed.

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
    varying = [name for name in names if not {name, plain(name)} & known and len(set(_texts(recording, name))) > 1]
    left = [name for name in varying if plain(name) not in _REMARKS and not _restates(recording, name, used)]
    if left:
        value = next(iter(_texts(recording, left[0])))
        raise DataError(
            f"{recording.provenance.file or 'table'}: column {left[0]}",
            value=_values(recording, left[0]),
            limit="differs from row to row and is not used: rows that differ must not be pooled",
            remedy=f"select the rows with one value with --where {left[0]}={value}, or declare "
            f"that this column has no effect with --ignore {left[0]}",
        )
    remarks = [name for name in varying if plain(name) in _REMARKS]
    return [note(f"not used: column{'s' * (len(remarks) > 1)} {', '.join(remarks)}")] if remarks else []


def constant_number(recording: Recording, names: Sequence[str], unit: str) -> float | None:
    """Return the number in a column, in a unit, if it is the same in all rows; otherwise None."""
    channel = recording.find(*names)
    if channel is None:
        return None
    values = channel.to(unit)
    return float(values[0]) if values.size and np.all(values == values[0]) else None


def _column(recording: Recording, name: str, option: str) -> str:
    """Return a column by its name in the recording; `DataError` if there is none."""
    for column in (*recording.texts, *recording.names):
        if plain(column) == plain(name):
            return column
    if (channel := recording.find(name)) is not None:
        return channel.name
    every = ", ".join(dict.fromkeys((*recording.texts, *recording.names)))
    raise DataError(f"{option} {name}", limit=f"there is no such column; the columns are {every}")


def _texts(recording: Recording, column: str) -> tuple[str, ...]:
    """Return a column's cells as texts."""
    texts = recording.texts.get(column)
    return texts if texts is not None else tuple(f"{value:.9g}" for value in recording.channel(column).values)


def _is(text: str, value: str) -> bool:
    """Whether a cell contains a value, as a word or as a number."""
    try:
        return float(text.replace(",", ".")) == float(value.replace(",", "."))
    except ValueError:
        return text.strip().casefold() == value.casefold()


def _values(recording: Recording, column: str) -> str:
    values = list(dict.fromkeys(_texts(recording, column)))
    return ", ".join(values[:_SHOWN]) + (f" and {len(values) - _SHOWN} more" if len(values) > _SHOWN else "")


def _restates(recording: Recording, column: str, used: Collection[str]) -> bool:
    """Whether a column of numbers repeats a used one in another unit."""
    if column in recording.texts:
        return False
    others = [channel for channel in recording.channels if channel.name in used]
    return any(_proportional(recording.channel(column), other) for other in others)


def _proportional(channel: Channel, other: Channel) -> bool:
    with np.errstate(all="ignore"):
        ratio = channel.values / other.values
    return bool(np.isfinite(ratio).all() and np.ptp(ratio) <= _SAME * abs(float(np.mean(ratio))))

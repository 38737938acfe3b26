"""LabVIEW measurement files (.lvm): text files with channels in packets, each with a header.

A file has a header and any number of packets with headers. The packet header gives the channels, the number of samples
per channel, the units in words, and the start and step of the time. The rows below have one time column, one for each
channel, or none, and an optional comment at the end. The headers are checked against the rows: a missing row means a
truncated file. Packets with the same channels follow each other in time; if their X restarts, as in files that were
appended to, it is counted from the date and time in each packet header.

Public names: `is_lvm` and `read`. Format: "Specification for the LabVIEW Measurement File (.lvm)", National
Instruments.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.recording import dates
from solen.recording.model import Channel, Recording
from solen.recording.numbers import parse
from solen.recording.source import Source
from solen.recording.table import along_axes, stated_provenance, unique
from solen.recording.words import heading

FIRST, END, COMMENT = "LabVIEW Measurement", "***End_of_Header***", "Comment"
_SEPARATORS = {"tab": "\t", "comma": ","}
_NEAR = 1e-3
"""Tolerance for a reported time relative to the header, as a fraction of a step."""


def is_lvm(source: Source) -> bool:
    """Whether a file begins like an .lvm file or contains the end of an .lvm header."""
    return source.data.removeprefix(b"\xef\xbb\xbf").startswith(FIRST.encode()) or END.encode() in source.data


@dataclass(frozen=True)
class _Line:
    """A line's number in the file and the cells of that line."""

    number: int
    cells: list[str]

    @property
    def blank(self) -> bool:
        return not any(self.cells)


@dataclass(frozen=True)
class _Packet:
    """Channels in a packet: names and units, times (n,) and values (n, c)."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: FloatArray
    values: FloatArray
    stamp: str = ""


def read(source: Source) -> Recording:
    """Read an .lvm file; raise `DataError` with the line of damaged or unsupported content."""
    texts = source.lines()
    if not texts[0].startswith(FIRST):
        raise source.refused("line 1", f"is not {FIRST}, as required by the headers of the file", "export it again")
    stated = _stated(source, texts)
    mark = stated.get("Decimal_Separator", ".")
    separator = _SEPARATORS.get(stated.get("Separator", "Tab").casefold(), "\t")
    lines = [_Line(n, [cell.strip() for cell in text.split(separator)]) for n, text in enumerate(texts, 1)]
    start = next(n for n, line in enumerate(lines) if line.cells[0] == END) + 1
    packets = list(_packets(source, lines[start:], stated, mark))
    if not packets:
        raise source.refused("", "contains no packet of numbers", "export it again")
    for number, packet in enumerate(packets[1:], 2):
        if (packet.names, packet.units) != (packets[0].names, packets[0].units):
            limit = f"has different channels from the first packet: {', '.join(packet.names)}"
            raise source.refused(f"packet {number}", limit, "write each set of channels to a separate file")
    time = np.concatenate(
        [packet.time + shift_s for packet, shift_s in zip(packets, _shifts(source, packets), strict=True)]
    )
    values = np.concatenate([packet.values for packet in packets])
    channels = [Channel("time", "time", "s", time)]
    heads = [heading(name, unit) for name, unit in zip(packets[0].names, packets[0].units, strict=True)]
    for name, head, column in zip(unique([head.name for head in heads]), heads, values.T, strict=True):
        channels.append(Channel(name, head.quantity, head.unit, column))
    return Recording(tuple(along_axes(channels, ())), stated_provenance(source, "lvm", stated, ""))


def _shifts(source: Source, packets: Sequence[_Packet]) -> FloatArray:
    """Return the time to add to each packet: 0 for consecutive packets, otherwise the offset of the time stamp."""
    none = np.zeros(len(packets))
    if _follow(packets, none):
        return none
    stamps = dates.seconds([packet.stamp for packet in packets])
    if stamps is not None and np.isfinite(stamps).all() and _follow(packets, stamps - stamps[0]):
        return np.asarray(stamps - stamps[0])
    limit = "restart the time, and Date and Time do not show how the packets follow one another"
    raise source.refused("packets", limit, "split the file before each packet")


def _follow(packets: Sequence[_Packet], shifts_s: FloatArray) -> bool:
    """Whether each packet begins after the end of the previous one."""
    ends = [
        (packet.time[0] + shift, packet.time[-1] + shift)
        for packet, shift in zip(packets, shifts_s, strict=True)
        if packet.time.size
    ]
    return all(after[0] > before[1] for before, after in pairwise(ends))


def _stated(source: Source, texts: Sequence[str]) -> dict[str, str]:
    """Return the entries in the file's header, by key."""
    found: dict[str, str] = {}
    for number, text in enumerate(texts, 1):
        if text.startswith(END):
            return found
        key, value = (text.replace(",", "\t", 1) if "\t" not in text else text).partition("\t")[::2]
        if number > 1 and key.strip():
            found[key.strip()] = value.strip()
    raise source.refused("", f"has no {END}: the header was cut off", "export it again")


def _packets(source: Source, lines: Sequence[_Line], stated: dict[str, str], mark: str) -> Iterator[_Packet]:
    """Return the packets in order; a file without packet headers contains only rows of numbers."""
    place = 0
    while place < len(lines):
        if lines[place].blank:
            place += 1
            continue
        if lines[place].cells[0] == FIRST:  # a file was appended to this one
            place = next((n for n in range(place, len(lines)) if lines[n].cells[0] == END), len(lines)) + 1
            continue
        header: dict[str, list[str]] = {}
        while place < len(lines) and lines[place].cells[0] != END:
            if not lines[place].blank:
                header[lines[place].cells[0]] = lines[place].cells[1:]
            place += 1
        if place + 1 >= len(lines) or "Channels" not in header:
            where = f"line {lines[min(place, len(lines) - 1)].number}"
            raise source.refused(where, "is in a packet whose header is incomplete", "export the file again")
        last = place + 2
        while last < len(lines) and not lines[last].blank and lines[last].cells[0] not in {"Channels", END, FIRST}:
            last += 1
        yield _packet(source, header, lines[place + 1], lines[place + 2 : last], stated.get("X_Columns", "One"), mark)
        place = last


def _packet(
    source: Source, header: dict[str, list[str]], heads: _Line, rows: Sequence[_Line], x_columns: str, mark: str
) -> _Packet:
    """Return the times and values of a packet's rows."""
    count = _count(source, heads, header["Channels"][:1])
    samples = _count(source, heads, header.get("Samples", [])[:1])
    width = {"No": 1 + count, "One": 1 + count, "Multi": 2 * count}.get(x_columns, 1 + count)
    names = [name for name in heads.cells if name]
    names = names[:-1] if names[-1:] == [COMMENT] else names
    if len(names) != width:
        held = (len(names) - width) // (2 if x_columns == "Multi" else 1) + count
        limit = f"names {held} channel{'s' * (held != 1)}, but the header specifies {count}"
        raise source.refused(f"line {heads.number}", limit, "export the file again")
    if len(rows) != samples or {*header["Samples"][:count]} != {header["Samples"][0]}:
        limit = (
            f"has {len(rows)} rows, but the header specifies {samples} samples per channel: "
            "the packet was cut off or damaged"
        )
        raise source.refused(f"packet at line {heads.number}", limit, "export the file again")
    cells = [_numbers(source, row, width, x_columns, mark) for row in rows]
    table: FloatArray = np.array(cells, dtype=np.float64).reshape(len(rows), width)
    start, step = (_one(source, heads, header.get(key, []), count, mark) for key in ("X0", "Delta_X"))
    even: FloatArray = np.asarray(start + step * np.arange(samples), dtype=np.float64)
    if x_columns == "No":
        time, values = even, table[:, 1:]
    elif x_columns == "Multi":
        time, values = table[:, 0], table[:, 1::2]
        _check_times(source, rows, np.abs(table[:, ::2] - time[:, None]).max(axis=1), step)
    else:
        time, values = table[:, 0], table[:, 1:]
    if step > 0.0:
        _check_times(source, rows, np.abs(time - even), max(step, 1e-6))
    first = {"No": 1, "One": 1}.get(x_columns, 1)
    kept = names[first:] if x_columns != "Multi" else names[1::2]
    units = [*header.get("Y_Unit_Label", []), *[""] * count][:count]
    stamp = " ".join(stated[0] for key in ("Date", "Time") if (stated := header.get(key)))
    return _Packet(tuple(kept), tuple(units), time, values, stamp)


def _count(source: Source, near: _Line, cells: Sequence[str]) -> int:
    if not cells or not cells[0].isdecimal():
        limit = "is in a packet without the numbers of channels and samples"
        raise source.refused(f"line {near.number}", limit, "export the file again")
    return int(cells[0])


def _one(source: Source, near: _Line, cells: Sequence[str], count: int, mark: str) -> float:
    """Return a number from a header that must be equal for all channels; 0 if the header does not contain it."""
    held = {cell for cell in cells[:count] if cell}
    if len(held) > 1:
        limit = f"is in a packet whose channels have different times: {', '.join(sorted(held)[:4])}"
        raise source.refused(f"line {near.number}", limit, "write only channels with a common clock to one file")
    try:
        return parse(held.pop(), mark) if held else 0.0
    except ValueError as bad:
        raise source.refused(f"packet at line {near.number}", str(bad), "export the file again") from None


def _numbers(source: Source, row: _Line, width: int, x_columns: str, mark: str) -> list[float]:
    """Return the numbers in a row, which may end with a comment."""
    cells = row.cells
    if len(cells) < width or len(cells) > width + 1:
        limit = f"has {len(cells)} cells; expected are {width} numbers and an optional comment"
        raise source.refused(f"line {row.number}", limit, "export the file again")
    found = []
    for place, cell in enumerate(cells[:width]):
        if x_columns == "No" and place == 0:
            found.append(np.nan)
            continue
        try:
            found.append(parse(cell, mark))
        except ValueError as bad:
            where = f"line {row.number}, column {place + 1}"
            raise source.refused(where, str(bad), "export the file again", cell) from None
        if np.isnan(found[-1]):
            where = f"line {row.number}, column {place + 1}"
            raise source.refused(where, "holds no number", "export the file again")
    return found


def _check_times(source: Source, rows: Sequence[_Line], off: FloatArray, step: float) -> None:
    """Raise `DataError` at the first row whose time contradicts the header."""
    wrong = np.flatnonzero(off > _NEAR * step + 1e-6)
    if wrong.size:
        limit = "has a different time from the packet's header or the other columns"
        raise source.refused(f"line {rows[int(wrong[0])].number}", limit, "export the file again")

"""LabVIEW measurement files (.lvm): text files with channels in packets, each with a header.

A file has a header and any number of packets with headers. The packet header contains the channels, the number of
samples per channel, the units in words, and the start and step of the time. The rows below have one time column, one
for each channel, or none, and an optional comment at the end. The headers are checked against the rows: a missing row
means that the file was truncated. Packets with the same channels follow one another in time; if their X restarts, as in
files that were appended to, the time is that of the date and time in each packet header.

Public names: `is_lvm` and `read`. Format: "Specification for the LabVIEW Measurement File (.lvm)", National
Instruments.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.recording import dates
from solen.recording.headings import heading
from solen.recording.model import Channel, Recording
from solen.recording.numbers import parse
from solen.recording.source import Source
from solen.recording.table import along_axes, provenance_of, unique

FIRST, END, COMMENT = "LabVIEW Measurement", "***End_of_Header***", "Comment"
_SEPARATORS = {"tab": "\t", "comma": ","}
_NEAR = 1e-3
"""Tolerance of a time relative to the header, as a fraction of a step."""


def is_lvm(source: Source) -> bool:
    """Return whether a file begins like an .lvm file or contains the end of an .lvm header."""
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
    """Channels of a packet: names and units, times (n,) and values (n, c), and the date and time of its header."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    time: FloatArray
    values: FloatArray
    timestamp: str = ""


def read(source: Source) -> Recording:
    """Read an .lvm file; raise `DataError` with the line of damaged or unsupported content."""
    texts = source.lines()
    if not texts[0].startswith(FIRST):
        raise source.error("line 1", f"does not begin with {FIRST}", "export it again")
    entries = _file_header(source, texts)
    mark = entries.get("Decimal_Separator", ".")
    separator = _SEPARATORS.get(entries.get("Separator", "Tab").casefold(), "\t")
    lines = [_Line(n, [cell.strip() for cell in text.split(separator)]) for n, text in enumerate(texts, 1)]
    start = next(n for n, line in enumerate(lines) if line.cells[0] == END) + 1
    packets = list(_packets(source, lines[start:], entries, mark))
    if not packets:
        raise source.error("", "contains no packet of numbers", "export it again")
    for number, packet in enumerate(packets[1:], 2):
        if (packet.names, packet.units) != (packets[0].names, packets[0].units):
            limit = f"has different channels from the first packet: {', '.join(packet.names)}"
            raise source.error(f"packet {number}", limit, "write each set of channels to a separate file")
    time = np.concatenate(
        [packet.time + shift_s for packet, shift_s in zip(packets, _shifts(source, packets), strict=True)]
    )
    values = np.concatenate([packet.values for packet in packets])
    channels = [Channel("time", "time", "s", time)]
    headings = [heading(name, unit) for name, unit in zip(packets[0].names, packets[0].units, strict=True)]
    for name, head, column in zip(unique([head.name for head in headings]), headings, values.T, strict=True):
        channels.append(Channel(name, head.quantity, head.unit, column))
    return Recording(tuple(along_axes(channels, ())), provenance_of(source, "lvm", entries, ""))


def _shifts(source: Source, packets: Sequence[_Packet]) -> FloatArray:
    """Return the time to add to each packet: the time since the first time stamp, or 0 for consecutive packets."""
    no_shift = np.zeros(len(packets))
    if _are_consecutive(packets, no_shift):
        return no_shift
    stamps = dates.seconds([packet.timestamp for packet in packets])
    if stamps is not None and np.isfinite(stamps).all() and _are_consecutive(packets, stamps - stamps[0]):
        return np.asarray(stamps - stamps[0])
    limit = "contains packets whose times overlap, and their Date and Time do not show the order"
    raise source.error("", limit, "split the file before each packet")


def _are_consecutive(packets: Sequence[_Packet], shifts_s: FloatArray) -> bool:
    """Return whether each packet begins after the end of the previous one."""
    ends = [
        (packet.time[0] + shift, packet.time[-1] + shift)
        for packet, shift in zip(packets, shifts_s, strict=True)
        if packet.time.size
    ]
    return all(after[0] > before[1] for before, after in pairwise(ends))


def _file_header(source: Source, texts: Sequence[str]) -> dict[str, str]:
    """Return the entries of the file's header, keyed by name."""
    entries: dict[str, str] = {}
    for number, text in enumerate(texts, 1):
        if text.startswith(END):
            return entries
        key, value = (text.replace(",", "\t", 1) if "\t" not in text else text).partition("\t")[::2]
        if number > 1 and key.strip():
            entries[key.strip()] = value.strip()
    raise source.error("", f"has no {END}: the header was cut off", "export it again")


def _packets(source: Source, lines: Sequence[_Line], entries: dict[str, str], mark: str) -> Iterator[_Packet]:
    """Yield the packets in order."""
    index = 0
    while index < len(lines):
        if lines[index].blank:
            index += 1
            continue
        if lines[index].cells[0] == FIRST:  # a file was appended to this one
            index = next((n for n in range(index, len(lines)) if lines[n].cells[0] == END), len(lines)) + 1
            continue
        header: dict[str, list[str]] = {}
        while index < len(lines) and lines[index].cells[0] != END:
            if not lines[index].blank:
                header[lines[index].cells[0]] = lines[index].cells[1:]
            index += 1
        if index + 1 >= len(lines) or "Channels" not in header:
            where = f"line {lines[min(index, len(lines) - 1)].number}"
            raise source.error(where, "is in a packet whose header is incomplete", "export the file again")
        last = index + 2
        while last < len(lines) and not lines[last].blank and lines[last].cells[0] not in {"Channels", END, FIRST}:
            last += 1
        yield _packet(source, header, lines[index + 1], lines[index + 2 : last], entries.get("X_Columns", "One"), mark)
        index = last


def _packet(
    source: Source, header: dict[str, list[str]], names_line: _Line, rows: Sequence[_Line], x_columns: str, mark: str
) -> _Packet:
    """Return a packet from its header, the row of names, and the rows of numbers."""
    count = _count(source, names_line, header["Channels"][:1])
    samples = _count(source, names_line, header.get("Samples", [])[:1])
    width = 2 * count if x_columns == "Multi" else 1 + count
    names = [name for name in names_line.cells if name]
    names = names[:-1] if names[-1:] == [COMMENT] else names
    if len(names) != width:
        channels = (len(names) - width) // (2 if x_columns == "Multi" else 1) + count
        limit = f"names {channels} channel{'s' * (channels != 1)}, but the header specifies {count}"
        raise source.error(f"line {names_line.number}", limit, "export the file again")
    if len(rows) != samples or {*header["Samples"][:count]} != {header["Samples"][0]}:
        limit = (
            f"has {len(rows)} rows, but the header specifies {samples} samples per channel: "
            "the packet was cut off or damaged"
        )
        raise source.error(f"packet at line {names_line.number}", limit, "export the file again")
    cells = [_numbers(source, row, width, x_columns, mark) for row in rows]
    table: FloatArray = np.array(cells, dtype=np.float64).reshape(len(rows), width)
    start, step = (_common_number(source, names_line, header.get(key, []), count, mark) for key in ("X0", "Delta_X"))
    uniform: FloatArray = np.asarray(start + step * np.arange(samples), dtype=np.float64)
    if x_columns == "No":
        time, values = uniform, table[:, 1:]
    elif x_columns == "Multi":
        time, values = table[:, 0], table[:, 1::2]
        _check_times(source, rows, np.abs(table[:, ::2] - time[:, None]).max(axis=1), step)
    else:
        time, values = table[:, 0], table[:, 1:]
    if step > 0.0:
        _check_times(source, rows, np.abs(time - uniform), max(step, 1e-6))
    kept = names[1:] if x_columns != "Multi" else names[1::2]
    units = [*header.get("Y_Unit_Label", []), *[""] * count][:count]
    timestamp = " ".join(header[key][0] for key in ("Date", "Time") if header.get(key))
    return _Packet(tuple(kept), tuple(units), time, values, timestamp)


def _count(source: Source, line: _Line, cells: Sequence[str]) -> int:
    if not cells or not cells[0].isdecimal():
        limit = "is in a packet whose header lacks the number of channels or samples"
        raise source.error(f"line {line.number}", limit, "export the file again")
    return int(cells[0])


def _common_number(source: Source, line: _Line, cells: Sequence[str], count: int, mark: str) -> float:
    """Return a number from a header that must be equal for all channels; 0 if the header lacks it."""
    texts = {cell for cell in cells[:count] if cell}
    if len(texts) > 1:
        limit = f"is in a packet whose channels have different times: {', '.join(sorted(texts)[:4])}"
        raise source.error(f"line {line.number}", limit, "write only channels with a common clock to one file")
    try:
        return parse(texts.pop(), mark) if texts else 0.0
    except ValueError as bad:
        raise source.error(f"packet at line {line.number}", str(bad), "export the file again") from None


def _numbers(source: Source, row: _Line, width: int, x_columns: str, mark: str) -> list[float]:
    """Return the numbers in a row, which may end with a comment."""
    cells = row.cells
    if len(cells) < width or len(cells) > width + 1:
        limit = f"has {len(cells)} cells; {width} numbers and an optional comment are expected"
        raise source.error(f"line {row.number}", limit, "export the file again")
    numbers = []
    for index, cell in enumerate(cells[:width]):
        if x_columns == "No" and index == 0:
            numbers.append(np.nan)
            continue
        try:
            numbers.append(parse(cell, mark))
        except ValueError as bad:
            where = f"line {row.number}, column {index + 1}"
            raise source.error(where, str(bad), "export the file again", cell) from None
        if np.isnan(numbers[-1]):
            where = f"line {row.number}, column {index + 1}"
            raise source.error(where, "contains no number", "export the file again")
    return numbers


def _check_times(source: Source, rows: Sequence[_Line], error_s: FloatArray, step: float) -> None:
    """Raise `DataError` at the first row whose time contradicts the header."""
    wrong_rows = np.flatnonzero(error_s > _NEAR * step + 1e-6)
    if wrong_rows.size:
        limit = "has a time that differs from the packet's header or the other time columns"
        raise source.error(f"line {rows[int(wrong_rows[0])].number}", limit, "export the file again")

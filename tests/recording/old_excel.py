"""Writer of .xls files, from Microsoft's [MS-XLS] and [MS-CFB]: BIFF8 records in a compound file.

A cell is a string, a number, a Boolean, the stored result of a formula, or a number with a format.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

SECTOR = 512
FREE, END, FAT = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD
GENERAL, PERCENT, DATE = 0, 1, 2
FORMATS = {GENERAL: 0, PERCENT: 10, DATE: 14}
"""Built-in number formats of the kinds of cells: General, 0.00 % and a date."""


@dataclass(frozen=True)
class Shown:
    """A number in a format: its value, the kind of cell, and whether it is the result of a formula."""

    value: float
    kind: int = GENERAL
    formula: bool = False


Cell = str | float | bool | Shown | None


def record(kind: int, data: bytes = b"") -> bytes:
    return struct.pack("<HH", kind, len(data)) + data


def xls(sheets: Mapping[str, Sequence[Sequence[Cell]]]) -> bytes:
    bodies = [_sheet(rows) for rows in sheets.values()]
    head = record(0x0809, struct.pack("<HHHHII", 0x0600, 0x0005, 0, 0, 0, 0)) + record(0x0042, struct.pack("<H", 1200))
    head += record(0x0031, struct.pack("<HHHHHBBBB", 200, 0, 0x7FFF, 400, 0, 0, 0, 0, 0) + _text("Arial", "<B")) * 5
    head += b"".join(
        record(0x00E0, struct.pack("<HHH", 0, number_format, 0) + bytes(14)) for number_format in FORMATS.values()
    )
    size = len(head) + sum(len(record(0x0085, bytes(6) + _text(name, "<B"))) for name in sheets) + 4
    for name, body in zip(sheets, bodies, strict=True):
        head += record(0x0085, struct.pack("<IH", size, 0) + _text(name, "<B"))
        size += len(body)
    return _compound(b"".join([head, record(0x000A), *bodies]))


def _text(text: str, count: str) -> bytes:
    return struct.pack(count, len(text)) + b"\1" + text.encode("utf-16-le")


def _sheet(rows: Sequence[Sequence[Cell]]) -> bytes:
    cells = [_cell(r, c, cell) for r, row in enumerate(rows) for c, cell in enumerate(row) if cell is not None]
    return b"".join([record(0x0809, struct.pack("<HHHHII", 0x0600, 0x0010, 0, 0, 0, 0)), *cells, record(0x000A)])


def _cell(row: int, column: int, cell: Cell) -> bytes:
    if isinstance(cell, str):
        return record(0x0204, struct.pack("<HHH", row, column, 0) + _text(cell, "<H"))
    if isinstance(cell, bool):
        return record(0x0205, struct.pack("<HHHBB", row, column, 0, cell, 0))
    number = cell if isinstance(cell, Shown) else Shown(float(cell or 0.0))
    content = struct.pack("<HHHd", row, column, number.kind, number.value)
    return record(0x0006, content + struct.pack("<HIH", 0, 0, 0)) if number.formula else record(0x0203, content)


def _compound(stream: bytes) -> bytes:
    """Return a compound file with one stream: header, sector table, directory, stream."""
    stream = stream.ljust(max(4096, -(-len(stream) // SECTOR) * SECTOR), b"\0")
    count = len(stream) // SECTOR
    chain = [FAT, END, *range(3, 2 + count), END]
    table = struct.pack(f"<{SECTOR // 4}I", *(chain + [FREE] * (SECTOR // 4 - len(chain))))
    header = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(16) + struct.pack("<HHHHH", 0x3E, 3, 0xFFFE, 9, 6) + bytes(6)
    header += struct.pack("<IIIIIIIII", 0, 1, 1, 0, 4096, END, 0, END, 0) + struct.pack("<109I", 0, *[FREE] * 108)
    entries = [_entry("Root Entry", 5, 1, END, 0), _entry("Workbook", 2, FREE, 2, len(stream)), bytes(256)]
    return b"".join([header, table, *entries, stream])


def _entry(name: str, kind: int, child: int, start: int, size: int) -> bytes:
    text = name.encode("utf-16-le")
    links = struct.pack("<HBBIII", len(text) + 2, kind, 1, FREE, FREE, child)
    return text.ljust(64, b"\0") + links + bytes(36) + struct.pack("<IQ", start, size)

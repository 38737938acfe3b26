r"""Records of a journal as bytes: framed so that what is whole is found again after any damage.

The idea: a record begins with a word that hardly occurs by chance, then says what it is, which one, and how long, under
one checksum. Where a record is not whole, the next one is looked for by its word: a flipped bit costs one record, and
numbers say how many are missing, and put in order what a disk has mixed up. All numbers are little-endian:

====== ===== ================================================================
offset bytes what
====== ===== ================================================================
0      8     ``SOLENJ2\n``, once at the beginning of the file
0      4     F5 0D 53 4A, the beginning; then for each record:
4      1     kind: 1 header, 2 rows, 3 event, 4 end
5      1     number of the stream, in the header's order; 0 for others
6      4     number of the record, from 0
10     4     length of the payload, n
14     4     CRC-32 of bytes 4 to 13 and the payload
18     n     payload: JSON, or rows
====== ===== ================================================================

Version 1 (``SOLENJ1\n``) had neither the word nor the number: it is read up to its first damage.

The interface: `record` makes one; `scan` finds the whole ones of a file, each a `Record` with its payload;
`unfinished` knows the beginning of one.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

MAGIC, MAGIC_1 = b"SOLENJ2\n", b"SOLENJ1\n"
HEADER, ROWS, EVENT, END = 1, 2, 3, 4
SYNC = b"\xf5\x0dSJ"
LONGEST = 1 << 26
"""A longer payload is none: its length is damaged."""
_HEAD, _HEAD_1 = struct.Struct("<4sBBIII"), struct.Struct("<BBII")
_CHUNK = 1 << 20


class Record(NamedTuple):
    """A whole record: its kind and number, where it and its payload begin, and the payload's length."""

    kind: int
    stream: int
    number: int
    begin: int
    place: int
    length: int

    @property
    def end(self) -> int:
        """Where the next one begins."""
        return self.place + self.length

    def payload(self, file: BinaryIO) -> bytes:
        """Its payload, read again."""
        file.seek(self.place)
        return file.read(self.length)


def record(kind: int, stream: int, number: int, payload: bytes) -> bytes:
    """Bytes of a record."""
    head = _HEAD.pack(SYNC, kind, stream, number & 0xFFFFFFFF, len(payload), 0)[:-4]
    return head + struct.pack("<I", zlib.crc32(payload, zlib.crc32(head[4:]))) + payload


def version_of(begun: bytes) -> int:
    """Version of a journal by its first bytes; 0 for another file, or one too short to say."""
    return {MAGIC: 2, MAGIC_1: 1}.get(begun, 0)


def scan(file: BinaryIO, version: int, begin: int, size: int) -> Iterator[tuple[Record, bytes]]:
    """Whole records from a place on, with their payloads; version 1 up to the first that is not whole."""
    place, number = begin, 0
    while place < size:
        found = _at(file, version, place, size, number)
        if found is not None:
            yield found
            place, number = found[0].end, number + 1
        elif version == 1:
            return
        else:
            place = _next(file, place + 1, size)


def unfinished(file: BinaryIO, version: int, place: int, size: int) -> bool:
    """Whether what is left from a place on is the beginning of a record whose writing was cut short."""
    form = _HEAD if version == 2 else _HEAD_1
    file.seek(place)
    head = file.read(min(form.size, size - place))
    if version == 2 and not (head.startswith(SYNC) or SYNC.startswith(head)):
        return False
    if len(head) < form.size:
        return True
    length = form.unpack(head)[-2]
    return bool(length <= LONGEST and place + form.size + length > size)


def _at(file: BinaryIO, version: int, place: int, size: int, number: int) -> tuple[Record, bytes] | None:
    """The record that begins at a place, and its payload; None if none that is whole does."""
    form = _HEAD if version == 2 else _HEAD_1
    file.seek(place)
    head = file.read(form.size)
    if len(head) < form.size or (version == 2 and not head.startswith(SYNC)):
        return None
    if version == 2:
        _, kind, stream, number, length, crc = form.unpack(head)
    else:
        kind, stream, length, crc = form.unpack(head)
    if length > min(LONGEST, size - place - form.size):
        return None
    payload = file.read(length)
    summed = head[4:-4] if version == 2 else head[:-4]
    if len(payload) < length or zlib.crc32(payload, zlib.crc32(summed)) != crc:
        return None
    return Record(kind, stream, number, place, place + form.size, length), payload


def _next(file: BinaryIO, place: int, size: int) -> int:
    """Offset of the next word that begins a record, or the end."""
    while place < size:
        file.seek(place)
        chunk = file.read(_CHUNK + len(SYNC) - 1)
        found = chunk.find(SYNC)
        if found >= 0:
            return place + found
        place += _CHUNK
    return size

r"""Records of a journal as bytes, framed in a way that complete ones are found after any damage.

A record begins with a word that hardly occurs by chance, then states its kind, its number and its length, under one
checksum. If a record is not complete, the next one is found by its word: a flipped bit costs one record. The numbers
show how many are missing, and restore the order of records that a disk has mixed up. All numbers are little-endian:

====== ===== ================================================================ offset bytes content ====== =====
================================================================ 0      8     ``SOLENJ2\n``, once at the beginning of
the file 0      4     F5 0D 53 4A, the beginning; then for each record: 4      1     kind: 1 header, 2 rows, 3 event, 4
end 5      1     number of the stream, in the header's order; 0 for others 6      4     number of the record, from 0 10
4     length of the payload, n 14     4     CRC-32 of bytes 4 to 13 and the payload 18     n     payload: JSON, or rows
====== ===== ================================================================

Version 1 (``SOLENJ1\n``) had neither the word nor the number: it is read up to its first damage.

`record` makes one; `scan` finds the complete ones of a file, each a `Record` with its payload; `unfinished` recognises
the beginning of one.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

MAGIC, MAGIC_1 = b"SOLENJ2\n", b"SOLENJ1\n"
HEADER, ROWS, EVENT, END = 1, 2, 3, 4
SYNC = b"\xf5\x0dSJ"
MAX_PAYLOAD_BYTES = 1 << 26
"""Longest payload in bytes; a greater length is damaged."""
_HEAD, _HEAD_1 = struct.Struct("<4sBBIII"), struct.Struct("<BBII")
_CHUNK = 1 << 20


class Record(NamedTuple):
    """A complete record: kind, number, offsets of the record and of its payload, and length of the payload."""

    kind: int
    stream: int
    number: int
    begin: int
    place: int
    length: int

    @property
    def end(self) -> int:
        """Offset at which the next record begins."""
        return self.place + self.length

    def payload(self, file: BinaryIO) -> bytes:
        """Read the payload again."""
        file.seek(self.place)
        return file.read(self.length)


def record(kind: int, stream: int, number: int, payload: bytes) -> bytes:
    """Return the bytes of a record."""
    head = _HEAD.pack(SYNC, kind, stream, number & 0xFFFFFFFF, len(payload), 0)[:-4]
    return head + struct.pack("<I", zlib.crc32(payload, zlib.crc32(head[4:]))) + payload


def version_of(begun: bytes) -> int:
    """Return the journal version from the first bytes of a file; 0 if it is not a journal or is too short."""
    return {MAGIC: 2, MAGIC_1: 1}.get(begun, 0)


def scan(file: BinaryIO, version: int, begin: int, size: int) -> Iterator[tuple[Record, bytes]]:
    """Find the complete records from an offset on, with their payloads.

    For version 1 up to the first incomplete one.
    """
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
    """Whether the bytes from an offset on are the beginning of a record whose writing was interrupted."""
    form = _HEAD if version == 2 else _HEAD_1
    file.seek(place)
    head = file.read(min(form.size, size - place))
    if version == 2 and not (head.startswith(SYNC) or SYNC.startswith(head)):
        return False
    if len(head) < form.size:
        return True
    length = form.unpack(head)[-2]
    return bool(length <= MAX_PAYLOAD_BYTES and place + form.size + length > size)


def _at(file: BinaryIO, version: int, place: int, size: int, number: int) -> tuple[Record, bytes] | None:
    """Return the record that begins at an offset, and its payload; None if no complete record begins there."""
    form = _HEAD if version == 2 else _HEAD_1
    file.seek(place)
    head = file.read(form.size)
    if len(head) < form.size or (version == 2 and not head.startswith(SYNC)):
        return None
    if version == 2:
        _, kind, stream, number, length, crc = form.unpack(head)
    else:
        kind, stream, length, crc = form.unpack(head)
    if length > min(MAX_PAYLOAD_BYTES, size - place - form.size):
        return None
    payload = file.read(length)
    summed = head[4:-4] if version == 2 else head[:-4]
    if len(payload) < length or zlib.crc32(payload, zlib.crc32(summed)) != crc:
        return None
    return Record(kind, stream, number, place, place + form.size, length), payload


def _next(file: BinaryIO, place: int, size: int) -> int:
    """Return the offset of the next word that begins a record, or the end."""
    while place < size:
        file.seek(place)
        chunk = file.read(_CHUNK + len(SYNC) - 1)
        found = chunk.find(SYNC)
        if found >= 0:
            return place + found
        place += _CHUNK
    return size

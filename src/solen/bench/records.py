r"""Records of a journal as bytes, framed so that complete records are found after any damage.

A record begins with a marker that hardly occurs by chance, followed by its kind, its number and its length, under one
checksum. If a record is not complete, the next one is found by its marker: a flipped bit costs one record. The numbers
show how many records are missing, and restore the order of records that a disk has mixed up. All numbers are
little-endian. A journal begins with ``SOLENJ2\n`` (8 bytes); a record contains, by offset in bytes:

- 0 (4 bytes): F5 0D 53 4A, the marker
- 4 (1 byte): kind: 1 header, 2 rows, 3 event, 4 end
- 5 (1 byte): number of the stream, in the order of the header; 0 for other kinds
- 6 (4 bytes): number of the record, from 0
- 10 (4 bytes): length n of the payload
- 14 (4 bytes): CRC-32 of bytes 4 to 13 and the payload
- 18 (n bytes): payload: JSON, or rows

Version 1 (``SOLENJ1\n``) had neither the marker nor the number; it is read up to its first damage.

Public names: `record_bytes` makes the bytes of a record; `scan` yields the complete records of a file, each a `Record`
with its payload; `unfinished` recognises the beginning of a record.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

MAGIC, MAGIC_1 = b"SOLENJ2\n", b"SOLENJ1\n"
HEADER, ROWS, EVENT, END = 1, 2, 3, 4
SYNC = b"\xf5\x0dSJ"
MAX_PAYLOAD_BYTES = 1 << 26
"""Longest payload in bytes; a greater length is corrupt."""
_HEAD, _HEAD_1 = struct.Struct("<4sBBIII"), struct.Struct("<BBII")
_CHUNK = 1 << 20


class Record(NamedTuple):
    """A complete record: kind, stream, number, offsets of the record and of its payload, and length of the payload."""

    kind: int
    stream: int
    number: int
    begin: int
    payload_begin: int
    length: int

    @property
    def end(self) -> int:
        """Offset at which the next record begins."""
        return self.payload_begin + self.length

    def payload(self, file: BinaryIO) -> bytes:
        """Read the payload again."""
        file.seek(self.payload_begin)
        return file.read(self.length)


def record_bytes(kind: int, stream: int, number: int, payload: bytes) -> bytes:
    """Return the bytes of a record."""
    head = _HEAD.pack(SYNC, kind, stream, number & 0xFFFFFFFF, len(payload), 0)[:-4]
    return head + struct.pack("<I", zlib.crc32(payload, zlib.crc32(head[4:]))) + payload


def version_of(magic: bytes) -> int:
    """Return the journal version from the first bytes of a file; 0 if it is not a journal or is too short."""
    return {MAGIC: 2, MAGIC_1: 1}.get(magic, 0)


def scan(file: BinaryIO, version: int, begin: int, size: int) -> Iterator[tuple[Record, bytes]]:
    """Yield the complete records from an offset on, with their payloads; in version 1 up to the first damage."""
    offset, number = begin, 0
    while offset < size:
        complete = _record_at(file, version, offset, size, number)
        if complete is not None:
            yield complete
            offset, number = complete[0].end, number + 1
        elif version == 1:
            return
        else:
            offset = _next_marker(file, offset + 1, size)


def unfinished(file: BinaryIO, version: int, offset: int, size: int) -> bool:
    """Whether the bytes from an offset on are the beginning of a record whose writing was interrupted."""
    head_format = _HEAD if version == 2 else _HEAD_1
    file.seek(offset)
    head = file.read(min(head_format.size, size - offset))
    if version == 2 and not (head.startswith(SYNC) or SYNC.startswith(head)):
        return False
    if len(head) < head_format.size:
        return True
    length = head_format.unpack(head)[-2]
    return bool(length <= MAX_PAYLOAD_BYTES and offset + head_format.size + length > size)


def _record_at(file: BinaryIO, version: int, offset: int, size: int, number: int) -> tuple[Record, bytes] | None:
    """Return the record that begins at an offset, and its payload; None if no complete record begins there."""
    head_format = _HEAD if version == 2 else _HEAD_1
    file.seek(offset)
    head = file.read(head_format.size)
    if len(head) < head_format.size or (version == 2 and not head.startswith(SYNC)):
        return None
    if version == 2:
        _, kind, stream, number, length, crc = head_format.unpack(head)
    else:
        kind, stream, length, crc = head_format.unpack(head)
    payload_begin = offset + head_format.size
    if length > min(MAX_PAYLOAD_BYTES, size - payload_begin):
        return None
    payload = file.read(length)
    checked_head = head[4:-4] if version == 2 else head[:-4]
    if len(payload) < length or zlib.crc32(payload, zlib.crc32(checked_head)) != crc:
        return None
    return Record(kind, stream, number, offset, payload_begin, length), payload


def _next_marker(file: BinaryIO, offset: int, size: int) -> int:
    """Return the offset of the next marker of a record, or the end."""
    while offset < size:
        file.seek(offset)
        index = file.read(_CHUNK + len(SYNC) - 1).find(SYNC)
        if index >= 0:
            return offset + index
        offset += _CHUNK
    return size

"""The journal of a run: samples are written to disk as they arrive, so that a kill or disk damage loses few records.

A journal is a file that only grows. Each record (`solen.bench.records`) is passed to the operating system in a single
call, before it is processed further. A killed process leaves at most one unfinished record at the end; damage destroys
only the records that it affects, and the reader lists the missing records. The header, without which nothing can be
read, is repeated at intervals. The records of a stream are rows of a table whose columns the header defines; the
journal itself is independent of boards and stages. Streams that the header lists as ``bulky`` are not kept in memory,
but read again record by record.

Public names: `Journal`, `read_journal` and `read_from`.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from io import FileIO
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np

from solen.bench.journal_content import JournalContent, Missing, Rows, described, dtypes_of
from solen.bench.records import (
    END,
    EVENT,
    HEADER,
    MAGIC,
    MAGIC_1,
    ROWS,
    Record,
    record_bytes,
    scan,
    unfinished,
    version_of,
)
from solen.errors import BenchError, DataError

SUFFIX = ".journal"
MIN_HEADER_INTERVAL, MAX_HEADER_INTERVAL = 1 << 14, 1 << 20
"""Bytes after which the header is repeated, at first and at most; the interval doubles each time."""
RESERVE_BYTES = 1 << 16
"""Bytes reserved on the disk while a journal is written, so that the reason for the end of a run can be written even if
the disk is full.
"""
_MAX_TIME_DISTANCE = 20
"""Number of records on either side of a gap that are searched for a time."""


class Journal:
    """A journal that is being written; use it in a ``with`` statement, or `close` it."""

    def __init__(self, path: Path, file: BinaryIO, header: Mapping[str, Any], number: int = 0) -> None:
        self.path = path
        self._file = file
        self._dtypes = dtypes_of(header, path)
        self._streams = {name: stream for stream, name in enumerate(self._dtypes)}
        self._header, self._number = _json(header), number
        self._bytes_since_header, self._header_interval = 0, MIN_HEADER_INTERVAL
        self._reserve = reserve_of(path)
        with suppress(OSError):  # if the disk is already full, the first record raises the error
            self._reserve.write_bytes(os.urandom(RESERVE_BYTES))

    @classmethod
    def create(cls, path: Path, header: Mapping[str, Any], dtypes: Mapping[str, np.dtype[np.void]]) -> Self:
        """Create a journal; raise `BenchError` if the file already exists or cannot be written.

        ``dtypes`` are the structured types of the streams, keyed by name.
        """
        try:
            file = FileIO(path, "xb")
        except FileExistsError:
            limit = "already exists, from a run that was not closed"
            raise BenchError(str(path), limit=limit, remedy="use solen bench recover") from None
        except OSError as bad:
            raise BenchError(str(path), limit=f"cannot be written: {bad.strerror}") from None
        streams = {name: described(dtype) for name, dtype in dtypes.items()}
        journal = cls(path, file, {**header, "streams": streams})
        try:
            journal._write(MAGIC + journal._next_record(HEADER, 0, journal._header))
        except BenchError:
            file.close()
            path.unlink(missing_ok=True)
            raise
        return journal

    @classmethod
    def resume(cls, path: Path) -> tuple[Self, JournalContent]:
        """Continue an unfinished journal after its last complete record; return the journal and its content."""
        content = read_journal(path)
        if content.end is not None or content.version == 1:
            limit = "is of a run that has ended" if content.version > 1 else "was begun by an older version of solen"
            raise BenchError(str(path), limit=limit, remedy="close it with solen bench recover")
        if content.lost_bytes:
            with path.open("r+b") as file:
                file.truncate(content.complete_bytes)
        number = max((record.number for record in content.records), default=-1) + 1
        journal = cls(path, FileIO(path, "ab"), content.header, number)
        journal._put(HEADER, 0, journal._header)
        return journal, content

    def dtype(self, stream: str) -> np.dtype[np.void]:
        """Return the structured type of a stream's rows."""
        return self._dtypes[stream]

    def rows(self, stream: str, rows: Rows) -> None:
        """Append rows of a stream."""
        if len(rows) == 0:
            return
        data = np.ascontiguousarray(rows, self._dtypes[stream]).tobytes()
        self._put(ROWS, self._streams[stream], data)

    def event(self, t_s: float, what: str, **entries: Any) -> None:
        """Append an event."""
        self._put(EVENT, 0, _json({"t_s": t_s, "what": what, **entries}))

    def end(self, **entries: Any) -> None:
        """Append the end record, and flush the journal to the disk."""
        self._put(END, 0, _json(entries))
        self.sync()

    def sync(self) -> None:
        """Flush all records to the disk, where not even a power cut loses them."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        with suppress(OSError):
            self._reserve.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _next_record(self, kind: int, stream: int, payload: bytes) -> bytes:
        number, self._number = self._number, self._number + 1
        return record_bytes(kind, stream, number, payload)

    def _put(self, kind: int, stream: int, payload: bytes) -> None:
        """Append a record, and repeat the header at intervals."""
        self._write(self._next_record(kind, stream, payload))
        self._bytes_since_header += len(payload)
        if self._bytes_since_header >= self._header_interval:
            self._bytes_since_header = 0
            self._header_interval = min(2 * self._header_interval, MAX_HEADER_INTERVAL)
            self._write(self._next_record(HEADER, 0, self._header))

    def _write(self, data: bytes) -> None:
        """Append a record completely or not at all."""
        begin: int | None = None
        try:
            begin = self._file.seek(0, os.SEEK_END)
            remaining = memoryview(data)
            while remaining:
                remaining = remaining[self._file.write(remaining) :]
        except OSError as bad:
            with suppress(OSError):  # space for the reason why the run ends
                self._reserve.unlink(missing_ok=True)
                if begin is not None:
                    self._file.truncate(begin)
                self._number -= 1
            remedy = "free some space; the records written so far are kept"
            raise BenchError(str(self.path), limit=f"cannot be written: {bad.strerror}", remedy=remedy) from None


def reserve_of(path: Path) -> Path:
    """Return the path of the file that reserves disk space; a killed process leaves the file behind."""
    return path.with_name(f".{path.name}.reserve")


def read_journal(path: Path) -> JournalContent:
    """Read all complete records of a journal, whether its run ended or was killed.

    Raises
    ------
    DataError
        If the file cannot be read, is not a journal, or was damaged before its end.
    """
    try:
        with path.open("rb") as file:
            return _read(file, path)
    except OSError as bad:
        raise DataError(str(path), limit=f"cannot be read: {bad.strerror}", remedy="check the path") from None


def _read(file: BinaryIO, path: Path) -> JournalContent:
    """Read the structure first and then the rows, so that a long journal needs little more memory than its rows."""
    size = file.seek(0, os.SEEK_END)
    version, intact = _version(file, path)
    records: list[Record] = []
    headers: list[bytes] = []
    entries: dict[int, dict[str, Any]] = {}
    for record, payload in scan(file, version, len(MAGIC), size):
        records.append(record)
        if record.kind == HEADER and not headers:
            headers.append(payload)
        elif record.kind in {EVENT, END}:
            entries[record.number] = json.loads(payload)
    complete = max((record.end for record in records), default=len(MAGIC))
    lost = size - complete if unfinished(file, version, complete, size) else 0
    damaged = size - lost - len(MAGIC) * intact - sum(record.end - record.begin for record in records)
    if not headers:
        raise _without_header(path, len(records)) if records or damaged else _empty(path)
    header = json.loads(headers[0])
    by_number = {record.number: record for record in records}
    ordered = tuple(by_number[number] for number in sorted(by_number))
    streams, counts = _streams(file, ordered, header, path)
    ends = [entries[record.number] for record in ordered if record.kind == END]
    return JournalContent(
        header=header,
        streams=streams,
        events=tuple(entries[record.number] for record in ordered if record.kind == EVENT),
        end=ends[-1] if ends else None,
        complete_bytes=complete,
        lost_bytes=lost,
        damaged_bytes=damaged,
        missing=tuple(_missing(file, ordered, dtypes_of(header, path))),
        version=version,
        path=path,
        records=ordered,
        counts=counts,
    )


def _version(file: BinaryIO, path: Path) -> tuple[int, bool]:
    """Return the version of a journal, and whether its first bytes are intact.

    If they are not, but a record of version 2 follows, the version is 2.
    """
    file.seek(0)
    magic = file.read(len(MAGIC))
    if len(magic) < len(MAGIC) and (MAGIC.startswith(magic) or MAGIC_1.startswith(magic)):
        raise _empty(path)
    size = file.seek(0, os.SEEK_END)
    version = version_of(magic)
    if version == 0 and (path.suffix != SUFFIX or next(scan(file, 2, 0, size), None) is None):
        raise DataError(str(path), limit="is not a journal of solen", remedy=f"specify a {SUFFIX} file")
    return version or 2, version > 0


def _streams(
    file: BinaryIO, records: Sequence[Record], header: Mapping[str, Any], path: Path
) -> tuple[dict[str, Rows], dict[str, int]]:
    """Return the rows of each stream that is not bulky, and the number of rows of each stream."""
    streams, counts = {}, {}
    for number, (name, dtype) in enumerate(dtypes_of(header, path).items()):
        of_stream = [record for record in records if (record.kind, record.stream) == (ROWS, number)]
        size = sum(record.length for record in of_stream)
        counts[name] = size // dtype.itemsize
        if name not in header.get("bulky", ()):
            data, offset = bytearray(size), 0
            for record in of_stream:
                data[offset : offset + record.length] = record.payload(file)
                offset += record.length
            streams[name] = np.frombuffer(data, dtype)
    return streams, counts


def _missing(file: BinaryIO, records: Sequence[Record], dtypes: Mapping[str, np.dtype[np.void]]) -> Iterator[Missing]:
    """Yield the ranges of record numbers that are missing, with the nearest times before and after each."""
    stream_dtypes = list(dtypes.values())

    def time_s(nearest_first: Iterable[Record], row: int) -> float | None:
        for record in nearest_first:
            if record.kind == EVENT:
                return float(json.loads(record.payload(file))["t_s"])
            if record.kind == ROWS and "t_s" in ((dtype := stream_dtypes[record.stream]).names or ()):
                return float(np.frombuffer(record.payload(file), dtype)["t_s"][row])
        return None

    if records and records[0].number > 0:
        yield Missing(0, records[0].number - 1, None, time_s(records[:_MAX_TIME_DISTANCE], 0))
    for index, (before, after) in enumerate(pairwise(records), 1):
        if after.number > before.number + 1:
            earlier = reversed(records[max(0, index - _MAX_TIME_DISTANCE) : index])
            later = records[index : index + _MAX_TIME_DISTANCE]
            yield Missing(before.number + 1, after.number - 1, time_s(earlier, -1), time_s(later, 0))


def read_from(path: Path, begin: int) -> tuple[list[tuple[int, int, bytes]], int]:
    """Return kind, stream and payload of the complete records from an offset on, initially 0, and the next offset."""
    with path.open("rb") as file:
        version, _ = _version(file, path)
        size = file.seek(0, os.SEEK_END)
        records = list(scan(file, version, max(begin, len(MAGIC)), size))
    end = records[-1][0].end if records else begin
    return [(record.kind, record.stream, payload) for record, payload in records], end


def _empty(path: Path) -> DataError:
    return DataError(str(path), limit="is empty: its run was killed at the beginning", remedy="remove it")


def _without_header(path: Path, records: int) -> DataError:
    limit = f"is damaged: {records} of its records are complete, but the header that describes their content is lost"
    return DataError(str(path), limit=limit, remedy="restore it from a copy")


def _json(data: Mapping[str, Any]) -> bytes:
    return json.dumps(data, allow_nan=False, ensure_ascii=False).encode()

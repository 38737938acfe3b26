"""The journal of a run: samples are written to disk as they arrive, so that a kill or disk damage loses few records.

A journal is a file that only grows. Each record (`solen.bench.records`) is passed to the operating system in a single
call, before it is processed further. A killed process leaves at most one unfinished record at the end; damage destroys
only the records that it affects, and the reader lists the missing records. The header, without which nothing can be
read, is repeated at intervals. Records of a stream are rows of a table whose columns the header defines; the journal
itself is independent of boards and stages. Streams that the header lists as ``bulky`` are not kept in memory; they are
read again, record by record.

Public names: `Journal`, `read_journal` and `read_on`.
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
from solen.bench.records import END, EVENT, HEADER, MAGIC, MAGIC_1, ROWS, Record, record, scan, unfinished, version_of
from solen.errors import BenchError, DataError

SUFFIX = ".journal"
FIRST_GAP, MAX_GAP_STEPS = 1 << 14, 1 << 20
"""Bytes after which the header is repeated: the first and the largest interval; the interval doubles each time."""
RESERVE_BYTES = 1 << 16
"""Bytes kept free on the disk while a journal is written, so that the reason why a run ended can be written even if the
disk is full.
"""
_NEAR = 20
"""Number of records on either side of a gap that are searched for a time."""


class Journal:
    """A journal that is being written; use it in a ``with`` statement, or `close` it."""

    def __init__(self, path: Path, file: BinaryIO, header: Mapping[str, Any], number: int = 0) -> None:
        self.path = path
        self._file = file
        self._dtypes = dtypes_of(header, path)
        self._streams = {name: stream for stream, name in enumerate(self._dtypes)}
        self._header, self._number = _json(header), number
        self._since, self._gap = 0, FIRST_GAP
        self._reserve = reserve_of(path)
        with suppress(OSError):  # if the disk is full already, the first record raises the error
            self._reserve.write_bytes(os.urandom(RESERVE_BYTES))

    @classmethod
    def create(cls, path: Path, header: Mapping[str, Any], dtypes: Mapping[str, np.dtype[np.void]]) -> Self:
        """Create a new journal; raise `BenchError` if the file already exists or cannot be written.

        ``dtypes`` are structured types, one for each stream.
        """
        try:
            file = FileIO(path, "xb")
        except FileExistsError:
            raise BenchError(
                str(path), limit="already exists: a run that was not closed", remedy="use solen bench recover"
            ) from None
        except OSError as bad:
            raise BenchError(str(path), limit=f"cannot be written: {bad.strerror}") from None
        streams = {name: described(dtype) for name, dtype in dtypes.items()}
        journal = cls(path, file, {**header, "streams": streams})
        try:
            journal._write(MAGIC + journal._next(HEADER, 0, journal._header))
        except BenchError:
            file.close()
            path.unlink(missing_ok=True)
            raise
        return journal

    @classmethod
    def resume(cls, path: Path) -> tuple[Self, JournalContent]:
        """Continue an unfinished journal after its last complete record; return the journal and its content."""
        journal_content = read_journal(path)
        if journal_content.end is not None or journal_content.version == 1:
            limit = "was ended" if journal_content.version > 1 else "was begun by an older solen"
            raise BenchError(str(path), limit=limit, remedy="close it with solen bench recover")
        if journal_content.lost_bytes:
            with path.open("r+b") as file:
                file.truncate(journal_content.whole_bytes)
        number = max((one.number for one in journal_content.records), default=-1) + 1
        journal = cls(path, FileIO(path, "ab"), journal_content.header, number)
        journal._put(HEADER, 0, journal._header)
        return journal, journal_content

    def dtype(self, stream: str) -> np.dtype[np.void]:
        """Return the columns of a stream."""
        return self._dtypes[stream]

    def rows(self, stream: str, rows: Rows) -> None:
        """Append rows of a stream."""
        if len(rows) == 0:
            return
        data = np.ascontiguousarray(rows, self._dtypes[stream]).tobytes()
        self._put(ROWS, self._streams[stream], data)

    def event(self, t_s: float, what: str, **more: Any) -> None:
        """Append an event."""
        self._put(EVENT, 0, _json({"t_s": t_s, "what": what, **more}))

    def end(self, **more: Any) -> None:
        """Append the end record, and flush the journal to the disk."""
        self._put(END, 0, _json(more))
        self.sync()

    def sync(self) -> None:
        """Flush everything to the disk; after this, not even a power cut loses the data."""
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

    def _next(self, kind: int, stream: int, payload: bytes) -> bytes:
        number, self._number = self._number, self._number + 1
        return record(kind, stream, number, payload)

    def _put(self, kind: int, stream: int, payload: bytes) -> None:
        """Append a record, and repeat the header at intervals."""
        self._write(self._next(kind, stream, payload))
        self._since += len(payload)
        if self._since >= self._gap:
            self._since, self._gap = 0, min(2 * self._gap, MAX_GAP_STEPS)
            self._write(self._next(HEADER, 0, self._header))

    def _write(self, data: bytes) -> None:
        """Append a record completely or not at all."""
        begin: int | None = None
        try:
            begin = self._file.seek(0, os.SEEK_END)
            left = memoryview(data)
            while left:
                left = left[self._file.write(left) :]
        except OSError as bad:
            with suppress(OSError):  # space for the reason of the end
                self._reserve.unlink(missing_ok=True)
                if begin is not None:
                    self._file.truncate(begin)
                self._number -= 1
            remedy = "free some space; the records written so far are kept"
            raise BenchError(str(self.path), limit=f"cannot be written: {bad.strerror}", remedy=remedy) from None


def reserve_of(path: Path) -> Path:
    """Return the reserve file, which is deleted if the disk is full; a kill leaves it behind."""
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
    kept: dict[int, dict[str, Any]] = {}
    for one, payload in scan(file, version, len(MAGIC), size):
        records.append(one)
        if one.kind == HEADER and not headers:
            headers.append(payload)
        elif one.kind in {EVENT, END}:
            kept[one.number] = json.loads(payload)
    whole = max((one.end for one in records), default=len(MAGIC))
    lost = size - whole if unfinished(file, version, whole, size) else 0
    damaged = size - lost - len(MAGIC) * intact - sum(one.end - one.begin for one in records)
    if not headers:
        raise _headless(path, len(records)) if records or damaged else _nothing(path)
    header = json.loads(headers[0])
    ordered = tuple({one.number: one for one in sorted(records, key=lambda one: one.number)}.values())
    streams, counts = _streams(file, ordered, header, path)
    ends = [kept[one.number] for one in ordered if one.kind == END]
    return JournalContent(
        header=header,
        streams=streams,
        events=tuple(kept[one.number] for one in ordered if one.kind == EVENT),
        end=ends[-1] if ends else None,
        whole_bytes=whole,
        lost_bytes=lost,
        damaged_bytes=damaged,
        missing=tuple(_missing(file, ordered, dtypes_of(header, path))),
        version=version,
        path=path,
        records=ordered,
        counts=counts,
    )


def _version(file: BinaryIO, path: Path) -> tuple[int, bool]:
    """Return the version of a journal, and whether its first bytes contain the version.

    If the first bytes are damaged, the version is taken from the records.
    """
    file.seek(0)
    begun = file.read(len(MAGIC))
    if len(begun) < len(MAGIC) and (MAGIC.startswith(begun) or MAGIC_1.startswith(begun)):
        raise _nothing(path)
    size = file.seek(0, os.SEEK_END)
    version = version_of(begun)
    if version == 0 and (path.suffix != SUFFIX or next(scan(file, 2, 0, size), None) is None):
        raise DataError(str(path), limit="is not a journal of solen", remedy=f"name a {SUFFIX} file")
    return version or 2, version > 0


def _streams(
    file: BinaryIO, records: Sequence[Record], header: Mapping[str, Any], path: Path
) -> tuple[dict[str, Rows], dict[str, int]]:
    """Return the rows of each stream that is not bulky, and the number of rows of each stream."""
    streams, counts = {}, {}
    for number, (name, dtype) in enumerate(dtypes_of(header, path).items()):
        mine = [one for one in records if (one.kind, one.stream) == (ROWS, number)]
        size = sum(one.length for one in mine)
        counts[name] = size // dtype.itemsize
        if name not in header.get("bulky", ()):
            data, at = bytearray(size), 0
            for one in mine:
                data[at : at + one.length] = one.payload(file)
                at += one.length
            streams[name] = np.frombuffer(data, dtype)
    return streams, counts


def _missing(file: BinaryIO, records: Sequence[Record], dtypes: Mapping[str, np.dtype[np.void]]) -> Iterator[Missing]:
    """Return the record numbers that are missing, and the times of the adjacent records."""
    kinds = list(dtypes.values())

    def time_s(near: Iterable[Record], place: int) -> float | None:
        for one in near:
            if one.kind == EVENT:
                return float(json.loads(one.payload(file))["t_s"])
            if one.kind == ROWS and "t_s" in (kinds[one.stream].names or ()):
                return float(np.frombuffer(one.payload(file), kinds[one.stream])["t_s"][place])
        return None

    if records and records[0].number > 0:
        yield Missing(0, records[0].number - 1, None, time_s(records[:_NEAR], 0))
    for place, (before, after) in enumerate(pairwise(records), 1):
        if after.number > before.number + 1:
            left = time_s(reversed(records[max(0, place - _NEAR) : place]), -1)
            yield Missing(before.number + 1, after.number - 1, left, time_s(records[place : place + _NEAR], 0))


def read_on(path: Path, begin: int) -> tuple[list[tuple[int, int, bytes]], int]:
    """Return the complete records from an offset on (0 for the first), and the next offset.

    Each record is returned as its kind, stream and payload.
    """
    with path.open("rb") as file:
        version, _ = _version(file, path)
        size = file.seek(0, os.SEEK_END)
        found = list(scan(file, version, max(begin, len(MAGIC)), size))
    end = found[-1][0].end if found else begin
    return [(one.kind, one.stream, payload) for one, payload in found], end


def _nothing(path: Path) -> DataError:
    return DataError(str(path), limit="is empty: its run was killed at the beginning", remedy="remove it")


def _headless(path: Path, records: int) -> DataError:
    limit = f"is damaged: {records} of its records are complete, but the header that describes their content is lost"
    return DataError(str(path), limit=limit, remedy="restore it from a copy")


def _json(data: Mapping[str, Any]) -> bytes:
    return json.dumps(data, allow_nan=False, ensure_ascii=False).encode()

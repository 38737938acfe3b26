r"""The journal of a run: samples on disk as they come, so that a kill loses none that were written.

The idea: a file that only ever grows. Each record carries its length and a checksum, and is handed to the operating
system whole, in one call, before anything else is done with it; a killed process leaves at most one unfinished record
at the end, which a reader recognises and leaves out. Records of a stream are rows of a table whose columns the header
names, so that the journal knows nothing of boards or stages. Streams that the header names as ``bulky`` are not held in
memory but read again, record by record. All numbers are little-endian:

====== ===== ================================================================
offset bytes what
====== ===== ================================================================
0      8     ``SOLENJ1\n``, once at the beginning of the file
0      1     kind: 1 header, 2 rows, 3 event, 4 end; then for each record:
1      1     number of the stream, in the header's order; 0 for others
2      4     length of the payload, n
6      4     CRC-32 of bytes 0 to 5 and the payload
10     n     payload: JSON, or rows
====== ===== ================================================================

The interface: `Journal.create` or `Journal.resume`, then `rows`, `event`, `end`; `read_journal` gives its content.
"""

import json
import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from solen.errors import BenchError, DataError

MAGIC = b"SOLENJ1\n"
SUFFIX = ".journal"
HEADER, ROWS, EVENT, END = 1, 2, 3, 4
_HEAD = struct.Struct("<BBII")
_LONGEST = 1 << 26

Rows = NDArray[np.void]


@dataclass(frozen=True, eq=False)
class JournalContent:
    """What a journal holds.

    Attributes
    ----------
    header
        What was written at its beginning: design, protocol, rig, versions, seeds, clock.
    streams
        Rows of each stream that is not bulky, as one structured array.
    events
        Events in their order, each with ``t_s`` and ``what``.
    end
        What was written when it was ended; None where the run was killed.
    whole_bytes, lost_bytes
        Length of what could be read, and of the unfinished record after it.
    path
        The journal itself.
    counts
        Rows of each stream.
    """

    header: dict[str, Any]
    streams: dict[str, Rows]
    events: tuple[dict[str, Any], ...]
    end: dict[str, Any] | None
    whole_bytes: int
    lost_bytes: int
    path: Path
    counts: dict[str, int]

    @property
    def parts(self) -> int:
        """How often the run was begun."""
        return sum(event["what"] == "begun" for event in self.events)

    @property
    def cycles(self) -> int:
        """Whole cycles."""
        return sum(event["what"] == "cycle done" for event in self.events)

    @property
    def outcome(self) -> str:
        """How the run ended: ``done``, ``stopped``, ``fault`` or ``killed``."""
        ends = [event["what"] for event in self.events if event["what"] in {"done", "stopped", "fault", "begun"}]
        return ends[-1] if ends and ends[-1] != "begun" else "killed"

    @property
    def losses(self) -> dict[str, int]:
        """What the sampler lost, over all parts that ended otherwise than by a kill."""
        total: Counter[str] = Counter()
        for event in self.events:
            total.update(event.get("losses", {}))
        return dict(total)

    def blocks(self, stream: str) -> Iterator[Rows]:
        """Rows of a stream, record by record, from the disk."""
        dtypes = dtypes_of(self.header, self.path)
        number, dtype = list(dtypes).index(stream), dtypes[stream]
        with self.path.open("rb") as file:
            file.seek(len(MAGIC))
            for kind, one, payload in _records(file, self.whole_bytes):
                if kind == ROWS and one == number:
                    yield np.frombuffer(payload, dtype)


class Journal:
    """A journal that is being written. Use it in a ``with`` statement, or `close` it."""

    def __init__(self, path: Path, file: BinaryIO, dtypes: Mapping[str, np.dtype[np.void]]) -> None:
        self.path = path
        self._file = file
        self._dtypes = dtypes
        self._numbers = {name: number for number, name in enumerate(dtypes)}

    @classmethod
    def create(cls, path: Path, header: Mapping[str, Any], dtypes: Mapping[str, np.dtype[np.void]]) -> Self:
        """A new journal; `BenchError` where there is one already or none can be written.

        ``dtypes`` are structured, one for each stream.
        """
        try:
            file = FileIO(path, "xb")
        except FileExistsError:
            raise BenchError(
                str(path), limit="exists already: a run that was not closed", remedy="solen bench recover"
            ) from None
        except OSError as bad:
            raise BenchError(str(path), limit=f"cannot be written: {bad.strerror}") from None
        journal = cls(path, file, dict(dtypes))
        streams = {name: _descr(dtype) for name, dtype in dtypes.items()}
        try:
            journal._write(MAGIC + _record(HEADER, 0, _json({**header, "streams": streams})))
        except BenchError:
            file.close()
            path.unlink(missing_ok=True)
            raise
        return journal

    @classmethod
    def resume(cls, path: Path) -> tuple[Self, JournalContent]:
        """A journal that was left, to be continued after its last whole record, and its content."""
        found = read_journal(path)
        if found.end is not None:
            raise BenchError(str(path), limit="was ended", remedy="close it with solen bench recover")
        with path.open("r+b") as file:
            file.truncate(found.whole_bytes)
        return cls(path, FileIO(path, "ab"), dtypes_of(found.header, path)), found

    def dtype(self, stream: str) -> np.dtype[np.void]:
        """Columns of a stream."""
        return self._dtypes[stream]

    def rows(self, stream: str, rows: Rows) -> None:
        """Append rows of a stream."""
        if len(rows) == 0:
            return
        data = np.ascontiguousarray(rows, self._dtypes[stream]).tobytes()
        self._write(_record(ROWS, self._numbers[stream], data))

    def event(self, t_s: float, what: str, **more: Any) -> None:
        """Append an event."""
        self._write(_record(EVENT, 0, _json({"t_s": t_s, "what": what, **more})))

    def end(self, **more: Any) -> None:
        """Append the end, and have it on the disk itself."""
        self._write(_record(END, 0, _json(more)))
        self.sync()

    def sync(self) -> None:
        """Have everything on the disk itself, so that not even a power cut loses it."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, data: bytes) -> None:
        try:
            left = memoryview(data)
            while left:
                left = left[self._file.write(left) :]
        except OSError as bad:
            remedy = "make room; what is written stays"
            raise BenchError(str(self.path), limit=f"cannot be written: {bad.strerror}", remedy=remedy) from None


def read_journal(path: Path) -> JournalContent:
    """Everything that is whole in a journal, whether it was ended or killed.

    Raises
    ------
    DataError
        Where the file cannot be read, is not a journal, or was damaged before its end.
    """
    try:
        with path.open("rb") as file:
            return _read(file, path)
    except OSError as bad:
        raise DataError(str(path), limit=f"cannot be read: {bad.strerror}", remedy="check the path") from None


def _read(file: BinaryIO, path: Path) -> JournalContent:
    """Two passes, so that a long journal needs little more memory than its rows: what there is, then the rows."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    begun = file.read(len(MAGIC))
    if begun != MAGIC and MAGIC.startswith(begun):
        raise _nothing(path)
    if begun != MAGIC:
        raise DataError(str(path), limit="is not a journal of solen", remedy=f"name a {SUFFIX} file")
    header: dict[str, Any] | None = None
    sizes: dict[int, int] = {}
    events: list[dict[str, Any]] = []
    end: dict[str, Any] | None = None
    whole = len(MAGIC)
    for kind, stream, payload in _records(file, size):
        whole += _HEAD.size + len(payload)
        if kind == HEADER and header is None:
            header = json.loads(payload)
        elif kind == ROWS:
            sizes[stream] = sizes.get(stream, 0) + len(payload)
        elif kind == EVENT:
            events.append(json.loads(payload))
        elif kind == END:
            end = json.loads(payload)
    if header is None:
        raise _nothing(path)
    dtypes = dtypes_of(header, path)
    counts = {name: sizes.get(number, 0) // dtype.itemsize for number, (name, dtype) in enumerate(dtypes.items())}
    held = {number: name for number, name in enumerate(dtypes) if name not in header.get("bulky", ())}
    data = {number: bytearray(sizes.get(number, 0)) for number in held}
    _fill(data, file, whole)
    found = {name: np.frombuffer(data[number], dtypes[name]) for number, name in held.items()}
    return JournalContent(header, found, tuple(events), end, whole, size - whole, path, counts)


def read_on(path: Path, begin: int) -> tuple[list[tuple[int, int, bytes]], int]:
    """Whole records from a place on, 0 for the first: kind, stream and payload of each; and where the next begins."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        place = max(begin, len(MAGIC))
        file.seek(place)
        found = list(_records(file, size))
    return found, place + sum(_HEAD.size + len(payload) for _, _, payload in found)


def _fill(data: Mapping[int, bytearray], file: BinaryIO, whole: int) -> None:
    """Rows of each stream, one after the other."""
    at = dict.fromkeys(data, 0)
    file.seek(len(MAGIC))
    for kind, stream, payload in _records(file, whole):
        if kind == ROWS and stream in data:
            data[stream][at[stream] : at[stream] + len(payload)] = payload
            at[stream] += len(payload)


def _nothing(path: Path) -> DataError:
    return DataError(str(path), limit="holds nothing: its run was killed as it began", remedy="remove it")


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
    """Kind, stream and payload of each whole record, up to the first that is not."""
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        kind, stream, length, crc = _HEAD.unpack(head)
        if length > min(_LONGEST, size - file.tell()):
            return
        payload = file.read(length)
        if len(payload) < length or _crc(head[:6], payload) != crc:
            return
        yield kind, stream, payload


def _record(kind: int, stream: int, payload: bytes) -> bytes:
    head = _HEAD.pack(kind, stream, len(payload), 0)[:6]
    return head + struct.pack("<I", _crc(head, payload)) + payload


def _crc(head: bytes, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(head))


def _json(data: Mapping[str, Any]) -> bytes:
    return json.dumps(data, allow_nan=False, ensure_ascii=False).encode()


def _descr(dtype: np.dtype[np.void]) -> list[list[Any]]:
    """Columns of a structured type as plain data: name, type, shape."""
    fields = [(name, dtype[name]) for name in dtype.names or ()]
    return [[name, field.base.newbyteorder("<").str, list(field.shape)] for name, field in fields]


def dtypes_of(header: Mapping[str, Any], path: Path) -> dict[str, np.dtype[np.void]]:
    """Columns of each stream, in the order of their numbers; `DataError` where a header does not state them."""
    try:
        return {
            name: np.dtype([(column, kind, tuple(shape)) for column, kind, shape in columns])
            for name, columns in header["streams"].items()
        }
    except (KeyError, TypeError, ValueError):
        raise DataError(f"{path}: streams", limit="are not described as a journal's are") from None

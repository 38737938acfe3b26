"""Content of a journal: header, records, rows, events and losses."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.bench.records import ROWS, Record
from solen.errors import DataError

Rows = NDArray[np.void]


@dataclass(frozen=True)
class Missing:
    """Consecutive records missing from a journal: their first and last number, and the times before and after them."""

    first: int
    last: int
    after_s: float | None
    before_s: float | None

    def __str__(self) -> str:
        count = self.last - self.first + 1
        after = "the beginning" if self.after_s is None else f"{self.after_s:.2f} s"
        before = "the end" if self.before_s is None else f"{self.before_s:.2f} s"
        return f"{count} record{'s' * (count > 1)} between {after} and {before}"


@dataclass(frozen=True, eq=False)
class JournalContent:
    """Content of a journal.

    Attributes
    ----------
    header
        Entries of the header: designs, protocol, rig, versions, seed, clock.
    streams
        Rows of each stream that is not bulky, as a structured array.
    events
        Events in order, each with ``t_s`` and ``what``.
    end
        Entries of the end record; None if the run was not completed.
    complete_bytes, lost_bytes
        Offset at which the last complete record ends, and length of the unfinished record after it.
    damaged_bytes
        Bytes that belong neither to a complete record nor to the unfinished record.
    missing
        Lost records, as far as the numbers of the other records show.
    version
        Version of the file format.
    path
        The journal file.
    records
        The complete records in order, without duplicates.
    counts
        Number of rows of each stream.
    """

    header: dict[str, Any]
    streams: dict[str, Rows]
    events: tuple[dict[str, Any], ...]
    end: dict[str, Any] | None
    complete_bytes: int
    lost_bytes: int
    damaged_bytes: int
    missing: tuple[Missing, ...]
    version: int
    path: Path
    records: tuple[Record, ...]
    counts: dict[str, int]

    @property
    def damaged(self) -> bool:
        """Whether written records have been lost."""
        return bool(self.damaged_bytes or self.missing)

    @property
    def parts(self) -> int:
        """Number of times that the run was started."""
        return sum(event["what"] == "begun" for event in self.events)

    @property
    def cycles(self) -> int:
        """Number of complete cycles."""
        return sum(event["what"] == "cycle done" for event in self.events)

    @property
    def outcome(self) -> str:
        """How the run ended: ``done``, ``stopped``, ``fault`` or ``killed``."""
        ends = [event["what"] for event in self.events if event["what"] in {"done", "stopped", "fault", "begun"}]
        return ends[-1] if ends and ends[-1] != "begun" else "killed"

    @property
    def losses(self) -> dict[str, int]:
        """Losses of the sampler, summed over all parts of the run that were not killed."""
        total: Counter[str] = Counter()
        for event in self.events:
            total.update(event.get("losses", {}))
        return dict(total)

    @property
    def sampler_stream(self) -> str:
        """Stream that contains the data of the sampler."""
        streams = {"daq": "samples", "meter": "meter"}
        return next((stream for key, stream in streams.items() if key in self.header), "board")

    def blocks(self, stream: str) -> Iterator[Rows]:
        """Yield the rows of a stream, read from the disk record by record."""
        dtypes = dtypes_of(self.header, self.path)
        number, dtype = list(dtypes).index(stream), dtypes[stream]
        with self.path.open("rb") as file:
            for record in self.records:
                if (record.kind, record.stream) == (ROWS, number):
                    yield np.frombuffer(record.payload(file), dtype)


def described(dtype: np.dtype[np.void]) -> list[list[Any]]:
    """Return the columns of a structured type as plain data: the name, type and shape of each."""
    fields = [(name, dtype[name]) for name in dtype.names or ()]
    return [[name, field.base.newbyteorder("<").str, list(field.shape)] for name, field in fields]


def dtypes_of(header: Mapping[str, Any], path: Path) -> dict[str, np.dtype[np.void]]:
    """Return the structured types of the streams, keyed by name; raise `DataError` if the header is invalid."""
    try:
        return {
            name: np.dtype([(column, kind, tuple(shape)) for column, kind, shape in columns])
            for name, columns in header["streams"].items()
        }
    except (KeyError, TypeError, ValueError):
        raise DataError(f"{path}: streams", limit="must be defined in the header of the journal") from None


def signal_unit(header: Mapping[str, Any]) -> str:
    """Return the unit of the receiver signals, from the header of a journal."""
    return str(header.get("meter", {}).get("unit") or header.get("signal_unit", "V"))

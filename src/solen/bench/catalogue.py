"""The catalogue of a folder of recordings: one row for each recording, in an SQLite file in the same folder.

The recordings are authoritative; the catalogue only indexes them, and each row repeats values from its recording. A
recording that has been moved away is listed as missing, and a new one is entered at the next scan of the folder.

Public names: `Catalogue` and `CatalogueEntry`.
"""

import contextlib
import hashlib
import json
import sqlite3
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from solen import files
from solen.bench.journal import SUFFIX as JOURNAL
from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.ranks import Caution, warning
from solen.results import Result, reported

NAME = "recordings.sqlite"
SUFFIX = ".nc"
_TABLE = """create table if not exists recordings (
    file text primary key, sha256 text, date text, protocol text, rig text, sensors text, periods integer,
    duration_s real, outcome text, simulated integer, solen text)"""
_INSERT = """insert or replace into recordings values
    (:file, :sha256, :date, :protocol, :rig, :sensors, :periods, :duration_s, :outcome, :simulated, :solen)"""


@dataclass(frozen=True)
class CatalogueEntry:
    """Catalogue entry of a recording.

    ``sensors`` contains the names of the sensors, and ``there`` states whether the file still exists.
    """

    file: str
    sha256: str
    date: str
    protocol: str
    rig: str
    sensors: tuple[str, ...]
    periods: int
    duration_s: float
    outcome: str
    simulated: bool
    solen: str
    there: bool = True


class RecordingList(Result):
    """Recordings of a folder.

    Attributes
    ----------
    folder
        The folder.
    recordings
        Entries of the catalogue, in order of date.
    journals
        Names of the journals of runs that are in progress or were not closed.
    not_recordings
        Names of the .nc files that are not recordings of a run.
    """

    folder: Path
    recordings: tuple[CatalogueEntry, ...]
    journals: tuple[str, ...]
    not_recordings: tuple[str, ...]

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Warn of each .nc file that is not a recording."""
        return tuple(warning(f"{name} is not a recording of solen bench run") for name in self.not_recordings)


def list_recordings(folder: Path, *, look: bool = False) -> RecordingList:
    """List the recordings of a folder, and the journals of unfinished runs in it.

    Parameters
    ----------
    folder
        The folder.
    look
        Whether to scan the folder for recordings that were copied there; a folder without a catalogue is always
        scanned.
    """
    if not folder.is_dir():
        raise SpecError(str(folder), limit="is not a folder", remedy="specify the folder of the recordings")
    catalogue = Catalogue(folder)
    journals = tuple(sorted(path.name for path in folder.glob(f"*{JOURNAL}")))
    try:
        not_recordings = catalogue.scan() if look or not (folder / NAME).exists() else ()
        return RecordingList(folder, catalogue.entries(), journals, not_recordings)
    except _ReadOnlyError:
        entries, not_recordings = _read(folder)
        return RecordingList(folder, entries, journals, not_recordings)


def _read(folder: Path) -> tuple[tuple[CatalogueEntry, ...], tuple[str, ...]]:
    """Return the recordings of a folder without a writable catalogue, and the .nc files that are not recordings."""
    entries, not_recordings = [], []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        try:
            entries.append(entry_of(path))
        except DataError:
            not_recordings.append(path.name)
    return tuple(sorted(entries, key=lambda entry: (entry.date, entry.file))), tuple(not_recordings)


class _ReadOnlyError(OutputError):
    """Raised if a catalogue cannot be written; the recordings may still be readable."""


class Catalogue:
    """The catalogue of one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def add(self, path: Path) -> CatalogueEntry:
        """Enter a recording, or replace its entry."""
        entry = entry_of(path)
        with self._open() as table:
            values = asdict(entry) | {"sensors": json.dumps(entry.sensors)}
            del values["there"]
            table.execute(_INSERT, values)
        return entry

    def entries(self) -> tuple[CatalogueEntry, ...]:
        """Return the entries of all recordings, in order of date."""
        if not (self.folder / NAME).exists():
            return ()
        with self._open() as table:
            rows = table.execute("select * from recordings order by date, file")
            names = [column[0] for column in rows.description]
            return tuple(self._entry(dict(zip(names, values, strict=True))) for values in rows)

    def scan(self) -> tuple[str, ...]:
        """Enter files that are new or changed; return the names of those that are not recordings."""
        known, not_recordings = {entry.file: entry.sha256 for entry in self.entries()}, []
        for path in sorted(self.folder.glob(f"*{SUFFIX}")):
            if known.get(path.name) != _sha256(path):
                try:
                    self.add(path)
                except DataError:
                    not_recordings.append(path.name)
        return tuple(not_recordings)

    def _entry(self, values: dict[str, Any]) -> CatalogueEntry:
        values["sensors"] = tuple(json.loads(values["sensors"]))
        values["simulated"] = bool(values["simulated"])
        return CatalogueEntry(**values, there=(self.folder / values["file"]).exists())

    @contextlib.contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        path = self.folder / NAME
        try:
            with contextlib.closing(sqlite3.connect(path, timeout=10.0)) as table, table:
                table.execute(_TABLE)
                yield table
        except sqlite3.DatabaseError as bad:
            remedy = "remove it; solen bench recordings creates a new one"
            name = getattr(bad, "sqlite_errorname", "")
            error = _ReadOnlyError if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN")) else OutputError
            raise error(str(path), limit=f"cannot be used: {bad}", remedy=remedy) from None


def header_of(path: Path) -> dict[str, Any]:
    """Return the journal header stored in a recording; raise `DataError` if the file is not a recording."""
    with _reading(path) as file:
        return dict(json.loads(file.attrs["header"]))


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[Any]:
    import h5netcdf

    files.check_seal(path, DataError)
    try:
        with h5netcdf.File(path, "r") as file:
            yield file
    except SolenError:
        raise
    except Exception as bad:  # a damaged file may raise any exception
        reason = " ".join(str(bad).split())
        raise DataError(str(path), limit=f"is not a recording of solen bench run: {reason}") from None


def entry_of(path: Path) -> CatalogueEntry:
    """Return the catalogue entry of a recording; raise `DataError` if the file is not a recording."""
    with _reading(path) as file:
        header = json.loads(file.attrs["header"])
        times = file.variables["time_s"]
        periods = times.shape[0]
        duration = float(times[-1] - times[0]) if periods else 0.0
        outcome = str(file.attrs["outcome"])
    return CatalogueEntry(
        file=path.name,
        sha256=_sha256(path),
        date=header["begun_utc"],
        protocol=header["protocol_name"],
        rig=header["rig_name"],
        sensors=tuple(sensor["name"] for sensor in header["sensors"]),
        periods=int(periods),
        duration_s=duration,
        outcome=outcome,
        simulated=bool(header["simulated"]),
        solen=header["solen"],
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

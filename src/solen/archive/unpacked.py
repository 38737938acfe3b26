"""Open a received archive, which is not trusted until it has been checked.

An archive is rejected, before the new folder is created, if it contains paths that leave the folder, symbolic links,
names that are not valid on every system, more bytes than listed or allowed, missing, changed or unlisted files, or
designs that name files outside the folder.
"""

import hashlib
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from pydantic import Field

from solen.archive.contents import DESIGN, Contents, Item
from solen.archive.metadata import NAME, loads
from solen.archive.packed import CHUNK
from solen.archive.references import references
from solen.errors import DataError
from solen.files import check_name, new_folder
from solen.spec import load
from solen.spec.strict import Options

MAX_METADATA_BYTES = 32 << 20
MEGABYTE = 1_000_000
PACK_AGAIN = "ask the sender to pack the archive again"


class Limits(Options):
    """Limits for the contents of an archive."""

    most_files: int = Field(10_000, ge=1)
    """Maximum number of files."""
    most_megabytes: float = Field(4000.0, gt=0.0)
    """Maximum size in megabytes after unpacking."""


class Opened(Contents):
    """A received archive with its description; `save` checks its files and unpacks them."""

    archive: Path

    def save(self, out: Path) -> Path:
        """Unpack into a new folder, and check every checksum.

        Raises
        ------
        DataError
            If the size or checksum of a file differs from the list, or a design or rig names a file outside the folder.
        OutputError
            If the folder exists or cannot be written.
        """
        with new_folder(out) as folder, _source(self.archive) as source:
            (folder / NAME).write_text(source.text(NAME), encoding="utf-8")
            for item in self.items:
                source.copy(item, folder / item.path)
            for item in self.items:
                _check_references(folder / item.path, item.kind, folder)
        return out


def opened(archive: Path, limits: Limits | None = None) -> Opened:
    """Return the description of an archive after comparing it with the contents; nothing is unpacked.

    Parameters
    ----------
    archive
        A folder or a zip file written by `solen project pack`.
    limits
        Maximum number of files and megabytes.

    Raises
    ------
    DataError
        If it is not a solen archive, if it contains files that are not listed, if it exceeds the limits, or if one of
        its paths leaves the folder or is not valid on every system.
    """
    limits = limits or Limits()
    with _source(archive) as source:
        names = source.names
        if NAME not in names:
            remedy = "specify a folder or zip file written by solen project pack"
            raise DataError(str(archive), limit=f"is not a solen archive: it does not contain {NAME}", remedy=remedy)
        if len(names) > limits.most_files + 1:
            limit = f"must be at most {limits.most_files}"
            raise DataError(f"{archive}: files", value=len(names) - 1, limit=limit, remedy="increase --most-files")
        for name in names:
            _check_path(archive, name)
        if len({name.lower() for name in names}) < len(names):
            raise DataError(str(archive), limit="contains two files with the same path", remedy=PACK_AGAIN)
        described = loads(source.text(NAME), f"{archive}: {NAME}")
    _check_complete(archive, [item.path for item in described.items], set(names) - {NAME})
    size = sum(item.size_bytes for item in described.items)
    if size > limits.most_megabytes * MEGABYTE:
        limit = f"must be at most {limits.most_megabytes:g} MB"
        raise DataError(
            f"{archive}: size", value=f"{size / MEGABYTE:.6g} MB", limit=limit, remedy="increase --most-megabytes"
        )
    return Opened(described.name, described.description, described.licence, described.authors, described.items, archive)


def _check_complete(archive: Path, described: list[str], present: set[str]) -> None:
    """Raise `DataError` unless the files are exactly those described, each once."""
    if len(set(described)) < len(described):
        raise DataError(str(archive), limit="describes two files with the same path", remedy=PACK_AGAIN)
    for paths, limit in (
        (set(described) - present, "is listed in the archive's metadata but is missing"),
        (present - set(described), "is not listed in the archive's metadata"),
    ):
        if paths:
            raise DataError(f"{archive}: {min(paths)}", limit=limit, remedy=PACK_AGAIN)


def _check_path(archive: Path, path: str) -> None:
    """Raise `DataError` if a path leaves the folder or is not valid on every system."""
    what = f"{archive}: path"
    pure = PurePosixPath(path)
    if not path or pure.is_absolute() or ".." in pure.parts or "\\" in path or ":" in path or str(pure) != path:
        raise DataError(what, value=path, limit="must stay within the folder", remedy="do not trust this archive")
    for part in pure.parts:
        check_name(what, part, DataError, "ask the sender to rename the file and pack the archive again")


def _check_references(file: Path, kind: str, folder: Path) -> None:
    """Raise `DataError` if a design or rig names a file outside the folder, or `SpecError` if a design is invalid."""
    if kind == DESIGN:
        load(file)
    for key, reference in references(file).items():
        if not reference.path.resolve().is_relative_to(folder.resolve()):
            limit = "names a file outside the archive"
            raise DataError(f"{file.name}: {key}", value=reference.name, limit=limit, remedy=PACK_AGAIN)


@dataclass(frozen=True)
class _Source:
    """A folder or a zip file: the names of its files, and a function that opens one of them."""

    archive: Path
    names: tuple[str, ...]
    open: Callable[[str], IO[bytes]]

    def text(self, name: str) -> str:
        """Return the text of a file; raise `DataError` if it is too long or not UTF-8."""
        with self.open(name) as file:
            data = file.read(MAX_METADATA_BYTES + 1)
        try:
            if len(data) > MAX_METADATA_BYTES:
                raise ValueError(f"is longer than {MAX_METADATA_BYTES} bytes")
            return data.decode()
        except ValueError as bad:
            raise DataError(f"{self.archive}: {name}", limit=str(bad), remedy=PACK_AGAIN) from None

    def copy(self, item: Item, target: Path) -> None:
        """Unpack a file, reading no more bytes than listed; raise `DataError` if its size or checksum differs."""
        checksum, remaining = hashlib.sha256(), item.size_bytes
        target.parent.mkdir(parents=True, exist_ok=True)
        with self.open(item.path) as file, target.open("xb") as copied:
            while chunk := file.read(CHUNK):
                remaining -= len(chunk)
                if remaining < 0:
                    break
                checksum.update(chunk)
                copied.write(chunk)
        if remaining != 0 or checksum.hexdigest() != item.sha256:
            limit = "has changed since it was packed: its size or checksum differs"
            raise DataError(f"{self.archive}: {item.path}", limit=limit, remedy=PACK_AGAIN)


@contextmanager
def _source(archive: Path) -> Iterator[_Source]:
    """Yield the files of a folder or zip file; raise `DataError` for damage, encryption and symbolic links."""
    if archive.is_dir():
        yield _Source(archive, tuple(_names(archive)), lambda name: (archive / name).open("rb"))
        return
    if not archive.exists():
        raise DataError(str(archive), limit="no such file or folder", remedy="check the path")
    try:
        with zipfile.ZipFile(archive) as zip_file:
            entries = [entry for entry in zip_file.infolist() if not entry.is_dir()]
            for entry in entries:
                limit = "is encrypted" if entry.flag_bits & 1 else ""
                limit = "is a symbolic link" if stat.S_ISLNK(entry.external_attr >> 16) else limit
                if limit:
                    raise DataError(f"{archive}: {entry.filename}", limit=limit, remedy=PACK_AGAIN)
            yield _Source(archive, tuple(entry.filename for entry in entries), zip_file.open)
    # zipfile raises NotImplementedError for an unknown compression method
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError) as bad:
        if isinstance(bad, OSError) and bad.errno is not None and bad.filename != str(archive):
            raise  # an error while writing
        limit = "must be a folder or a readable zip file"
        raise DataError(str(archive), limit=f"{limit}: {bad}", remedy=PACK_AGAIN) from None


def _names(folder: Path) -> Iterator[str]:
    for file in sorted(folder.rglob("*")):
        name = file.relative_to(folder).as_posix()
        if file.is_symlink():
            raise DataError(f"{folder}: {name}", limit="is a symbolic link", remedy="replace the link with the file")
        if not file.is_dir():
            yield name

"""Collect the files of a sensor, and write them with their description as a folder or a zip file."""

import hashlib
import posixpath
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import IO

from solen import __version__, files
from solen.archive.contents import OTHER, Contents, Item, described
from solen.archive.metadata import NAME, Author, dumps, licence_name, licence_of
from solen.archive.references import Reference, references, renamed
from solen.bench.catalogue import NAME as CATALOGUE
from solen.errors import DataError, SpecError
from solen.files import check_name, new_folder
from solen.progress import Progress
from solen.results import HIDDEN
from solen.spec import load
from solen.spec.strict import Options

FIRST_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of all entries in a zip file, so that equal contents give equal files."""
EXTERNAL_FOLDER = "files"
"""Archive folder for files from outside the design folder."""
CHUNK = 1 << 20


class PackOptions(Options):
    """Authors, licence, title and description of an archive."""

    author: tuple[str, ...] = ()
    """Author, repeatable: "NAME", or "NAME <ORCID>"."""
    licence: str
    """Licence: SPDX name, for example CC-BY-4.0, or address."""
    title: str = ""
    """Title; default: the design name."""
    description: str = ""
    """Description of what was made and measured, in a sentence or two."""


@dataclass(frozen=True)
class Member:
    """A file of an archive: its description, its location, and its content if that differs from the file."""

    item: Item
    file: Path
    content: bytes | None = None

    def copy(self, target: IO[bytes]) -> None:
        """Write the content; raise `DataError` if it has changed since it was described."""
        checksum = hashlib.sha256()
        with BytesIO(self.content) if self.content is not None else self.file.open("rb") as source:
            while chunk := source.read(CHUNK):
                checksum.update(chunk)
                target.write(chunk)
        if checksum.hexdigest() != self.item.sha256:
            raise DataError(str(self.file), limit="changed while it was being packed", remedy="pack again")


class Archive(Contents):
    """The files of a sensor with their descriptions; `save` writes them."""

    metadata: str = field(metadata=HIDDEN)
    members: tuple[Member, ...] = field(metadata=HIDDEN)

    def save(self, out: Path) -> Path:
        """Write a zip file if the name ends in ``.zip``, otherwise a new folder; raise `OutputError` if this fails.

        Equal contents give equal zip files, except for the packing date.
        """
        if out.suffix.lower() == ".zip":
            files.write_all({out: self._zip})
            return out
        with new_folder(out) as folder:
            (folder / NAME).write_text(self.metadata, encoding="utf-8")
            for member in self.members:
                target = folder / member.item.path
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("xb") as file:
                    member.copy(file)
        return out

    def _zip(self, target: Path) -> None:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as zip_file:
            zip_file.writestr(_entry(NAME), self.metadata.encode())
            for member in self.members:
                with zip_file.open(_entry(member.item.path), "w", force_zip64=True) as file:
                    member.copy(file)


def _entry(path: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(path, FIRST_DATE)
    entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
    return entry


def pack(
    design: Path,
    further: Sequence[Path],
    options: PackOptions,
    *,
    exclude: Path | None = None,
    progress: Progress | None = None,
) -> Archive:
    """Collect and describe the files of a sensor.

    Parameters
    ----------
    design
        The design file. Files named by this design, or by any other design or rig in the archive, are added; a file
        from outside the design folder is put into the folder ``files``, and its name in the design is changed.
    further
        Files, and folders with all their files except hidden files: print settings, images, recordings, calibrations,
        figures.
    options
        Authors, licence, title and description.
    exclude
        A file that is not packed even if it is in one of the folders: the archive itself.
    progress
        Called with the completed fraction, up to 1.

    Raises
    ------
    SpecError
        If the design, an author or the licence is not valid.
    DataError
        If a file is missing or damaged, or two files would have the same path.
    """
    if not options.author:
        raise SpecError("--author", limit="is missing", remedy='specify --author "NAME" or --author "NAME <ORCID>"')
    authors, licence = [Author.of(text) for text in options.author], licence_of(options.licence)
    sensor_design, base = load(design), design.absolute().parent
    paths = _ArchivePaths(base)
    paths.add(design, PurePosixPath(design.name))
    for file, path in _expanded(further, base, exclude):
        paths.add(file, path)
    members = []
    for number, (file, path) in enumerate(paths.path_of.items(), 1):
        item, content = described(file, path), paths.content(file)
        if item.kind == OTHER and file in paths.referenced and file.suffix == ".toml":
            raise DataError(str(file), limit=item.remark, remedy="correct the file, or its name in the design or rig")
        if content is not None:
            item = replace(item, size_bytes=len(content), sha256=hashlib.sha256(content).hexdigest())
        members.append(Member(item, file, content))
        if progress is not None:
            progress(number / len(paths.path_of))
    items = tuple(member.item for member in members)
    title = options.title or sensor_design.name
    metadata = dumps(title, options.description, licence, authors, items, __version__)
    names = tuple(author.name for author in authors)
    return Archive(title, options.description, licence_name(licence), names, items, metadata, tuple(members))


class _ArchivePaths:
    """Paths of files within the archive, including the files that designs and rigs name."""

    def __init__(self, base: Path) -> None:
        self.path_of: dict[Path, PurePosixPath] = {}
        self.referenced: set[Path] = set()
        self._base = base
        self._references: dict[Path, dict[str, Reference]] = {}
        self._lower: dict[str, Path] = {}

    def add(self, file: Path, path: PurePosixPath) -> None:
        """Add a file and the files that it names.

        Raise `DataError` if the path is taken or not valid on every system, or a named file does not exist.
        """
        file = file.resolve()
        if file in self.path_of:
            return
        for part in path.parts:
            check_name(f"name of {file}", part, DataError, "rename it")
        other_file = self._lower.setdefault(str(path).lower(), file)
        if other_file != file:
            limit = f"would have the same name in the archive, {path}, as {other_file} on Windows and macOS"
            raise DataError(str(file), limit=limit, remedy="rename one of them")
        self.path_of[file] = path
        self._references[file] = references(file)
        for reference in self._references[file].values():
            target = _checked(reference.path).resolve()
            self.referenced.add(target)
            self.add(target, _archive_path(target, self._base))

    def content(self, file: Path) -> bytes | None:
        """Return the content of a design or rig with archive paths for its file names; None if nothing changes."""
        changed = {}
        for key, reference in self._references[file].items():
            relative = posixpath.relpath(str(self.path_of[reference.path.resolve()]), str(self.path_of[file].parent))
            if posixpath.normpath(reference.name) != relative:
                changed[key] = relative
        return renamed(file, changed).encode() if changed else None


def _checked(path: Path) -> Path:
    if not path.is_file():
        limit = "is not a file" if path.exists() else "no such file or folder"
        raise DataError(str(path), limit=limit, remedy="check the path")
    return path


def _archive_path(path: Path, base: Path) -> PurePosixPath:
    """Return the path of a file in the archive: relative to the design folder, or within ``files`` if it is outside."""
    try:
        return PurePosixPath(path.resolve().relative_to(base.resolve()).as_posix())
    except ValueError:
        return PurePosixPath(EXTERNAL_FOLDER, path.name)


def _expanded(inputs: Sequence[Path], base: Path, exclude: Path | None) -> Iterator[tuple[Path, PurePosixPath]]:
    """Yield the files, including those in the folders, with their paths in the archive."""
    for path in inputs:
        if not path.is_dir():
            yield _checked(path), _archive_path(path, base)
            continue
        folder = path.resolve()
        outside = not folder.is_relative_to(base.resolve())
        for file in sorted(path.rglob("*")):
            relative_path = file.relative_to(path)
            is_hidden = any(part.startswith((".", "__pycache__")) for part in relative_path.parts)
            is_written = file.name in {NAME, CATALOGUE} or (exclude is not None and file.resolve() == exclude.resolve())
            if not file.is_file() or is_hidden or is_written:
                continue
            if outside:
                yield file, PurePosixPath(EXTERNAL_FOLDER, folder.name, relative_path.as_posix())
            else:
                yield file, _archive_path(file, base)

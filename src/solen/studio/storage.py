"""Files of the studio next to the design: dropped on a page, or written by its jobs.

A name that a page sends becomes at most a name within one folder, never a path; files are located by comparing names,
not by opening the requested name.
"""

import json
import re
import secrets
from collections.abc import AsyncIterator, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from solen.errors import OutputError, SpecError
from solen.files import DEVICES, output_folder

MAX_FILE_BYTES = 2**28
"""Largest size in bytes of a dropped file."""
WRITTEN = {".json", ".toml", ".nc", ".journal"}
"""Suffixes of files written by jobs that other jobs accept."""
_OTHER = re.compile(r"[^\w .,()+%°µ-]+")
_MAX_NAME_LENGTH = 80


def safe_name(name: str) -> str:
    """Return a file name similar to the given one that is valid on every system and contains no path."""
    cleaned = _OTHER.sub("_", name.replace("\\", "/").rpartition("/")[2]).strip(" .")
    stem, dot, ending = cleaned.rpartition(".")
    stem, ending = (stem, f".{ending[:12]}") if dot and stem else (cleaned, "")
    stem = stem[:_MAX_NAME_LENGTH].strip(" .") or "file"
    return f"{'_' if stem.partition('.')[0].strip().upper() in DEVICES else ''}{stem}{ending}"


JOB = ".job.json"
"""File in a job's folder that describes the job."""


class Storage:
    """A folder for a document's files, created with the first file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    async def keep(self, name: str, parts: AsyncIterator[bytes]) -> str:
        """Write a file as it arrives; return its name, which is that of an earlier file with the same content.

        Raises
        ------
        OutputError
            If it is too large, or cannot be written; then nothing is kept.
        """
        with output_folder(self.folder):
            part = self.folder / f".{secrets.token_hex(8)}.part"
            try:
                size = 0
                with part.open("xb") as file:
                    async for some in parts:
                        size += len(some)
                        if size > MAX_FILE_BYTES:
                            limit = f"is larger than {MAX_FILE_BYTES // 2**20} MB"
                            raise OutputError(safe_name(name), limit=limit, remedy="use it from the command line")
                        file.write(some)
                return self._kept(part, safe_name(name))
            finally:
                part.unlink(missing_ok=True)

    def _kept(self, part: Path, name: str) -> str:
        """Rename a file to the first name that is free, or whose file has the same content."""
        stem, ending = Path(name).stem, Path(name).suffix
        number = 1
        while (path := self.folder / name).exists():
            if path.is_file() and path.read_bytes() == part.read_bytes():
                return name
            number += 1
            name = f"{stem}-{number}{ending}"
        part.rename(path)
        return name

    def names(self) -> list[str]:
        """Return names of dropped files, and of results as ``cure-1/cure.json``, in alphabetical order."""
        dropped = [one for one in self.folder.glob("[!.]*") if one.is_file()]
        written = [one for one in self.folder.glob("*/[!.]*") if one.suffix in WRITTEN]
        return sorted(one.relative_to(self.folder).as_posix() for one in (*dropped, *written))

    def path(self, name: str) -> Path:
        """Return the path of a file in the storage; `SpecError` for any other name."""
        if name not in self.names():
            raise SpecError(
                "file", value=safe_name(name), limit="is not one of the studio's files", remedy="drop it again"
            )
        return self.folder / name

    def jobs(self) -> Iterator[dict[str, Any]]:
        """Return the records of earlier jobs, the oldest first; those whose files were moved or deleted are omitted."""
        home = self.folder.parent.resolve()
        for path in sorted(self.folder.glob(f"*/{JOB}"), key=lambda one: one.stat().st_mtime):
            try:
                found = json.loads(path.read_text(encoding="utf-8"))
                files = [Path(one) for one in found["news"]["files"].values()]
                whole = all(file.exists() and file.resolve().is_relative_to(home) for file in files)
            except (OSError, ValueError, KeyError, TypeError, AttributeError):
                continue
            if whole:
                yield found

    @staticmethod
    def drop(folder: Path) -> None:
        """Remove a folder that is still empty."""
        with suppress(OSError):
            folder.rmdir()

    def new_folder(self, name: str) -> Path:
        """Make an empty folder for the files of a job: ``cure-1``, ``cure-2``."""
        number = 1
        while (folder := self.folder / f"{name}-{number}").exists():
            number += 1
        with output_folder(self.folder):
            folder.mkdir()
        return folder

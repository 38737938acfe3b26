"""Files of the studio in a folder next to the design: dropped on a page, or written by jobs.

A name sent by a page is used only as a name within this folder, never as a path; files are located by comparing names,
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
"""Maximum size of a dropped file."""
RESULT_SUFFIXES = {".json", ".toml", ".nc", ".journal"}
"""Suffixes of output files that other jobs accept."""
_INVALID = re.compile(r"[^\w .,()+%°µ-]+")
_MAX_NAME_LENGTH = 80


def safe_name(name: str) -> str:
    """Return a file name that is similar to the given one, valid on every system, and contains no path."""
    cleaned = _INVALID.sub("_", name.replace("\\", "/").rpartition("/")[2]).strip(" .")
    stem, dot, ending = cleaned.rpartition(".")
    stem, ending = (stem, f".{ending[:12]}") if dot and stem else (cleaned, "")
    stem = stem[:_MAX_NAME_LENGTH].strip(" .") or "file"
    return f"{'_' if stem.partition('.')[0].strip().upper() in DEVICES else ''}{stem}{ending}"


JOB = ".job.json"
"""File in the folder of a job that describes it."""


class Storage:
    """The folder for files of a document, created with the first file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    async def keep(self, name: str, chunks: AsyncIterator[bytes]) -> str:
        """Write a file as it arrives; return its name, or that of an earlier file with the same content.

        Raises
        ------
        OutputError
            If it is too large or cannot be written; then nothing is kept.
        """
        with output_folder(self.folder):
            temporary = self.folder / f".{secrets.token_hex(8)}.part"
            try:
                size = 0
                with temporary.open("xb") as file:
                    async for chunk in chunks:
                        size += len(chunk)
                        if size > MAX_FILE_BYTES:
                            limit = f"is larger than {MAX_FILE_BYTES // 2**20} MB"
                            raise OutputError(safe_name(name), limit=limit, remedy="use it from the command line")
                        file.write(chunk)
                return self._rename(temporary, safe_name(name))
            finally:
                temporary.unlink(missing_ok=True)

    def _rename(self, temporary: Path, name: str) -> str:
        """Rename a file to the first name that is unused or whose file has the same content."""
        stem, ending = Path(name).stem, Path(name).suffix
        number = 1
        while (path := self.folder / name).exists():
            if path.is_file() and path.read_bytes() == temporary.read_bytes():
                return name
            number += 1
            name = f"{stem}-{number}{ending}"
        temporary.rename(path)
        return name

    def names(self) -> list[str]:
        """Return names of dropped files, and of results as ``cure-1/cure.json``, in alphabetical order."""
        dropped = [file for file in self.folder.glob("[!.]*") if file.is_file()]
        written = [file for file in self.folder.glob("*/[!.]*") if file.suffix in RESULT_SUFFIXES]
        return sorted(file.relative_to(self.folder).as_posix() for file in (*dropped, *written))

    def path(self, name: str) -> Path:
        """Return the path of a file in the storage; raise `SpecError` for any other name."""
        if name not in self.names():
            raise SpecError(
                "file",
                value=safe_name(name),
                limit="is not a file of the studio",
                remedy="drop the file on the page again",
            )
        return self.folder / name

    def jobs(self) -> Iterator[dict[str, Any]]:
        """Return the records of earlier jobs, the oldest first; those whose files were moved or deleted are omitted."""
        home = self.folder.parent.resolve()
        for path in sorted(self.folder.glob(f"*/{JOB}"), key=lambda file: file.stat().st_mtime):
            try:
                record = json.loads(path.read_text(encoding="utf-8"))
                files = [Path(file) for file in record["news"]["files"].values()]
                complete = all(file.exists() and file.resolve().is_relative_to(home) for file in files)
            except (OSError, ValueError, KeyError, TypeError, AttributeError):
                continue
            if complete:
                yield record

    @staticmethod
    def remove_if_empty(folder: Path) -> None:
        """Remove a folder if it is empty."""
        with suppress(OSError):
            folder.rmdir()

    def new_folder(self, name: str) -> Path:
        """Create a folder for the files of a job: ``cure-1``, ``cure-2``."""
        number = 1
        while (folder := self.folder / f"{name}-{number}").exists():
            number += 1
        with output_folder(self.folder):
            folder.mkdir()
        return folder

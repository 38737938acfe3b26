"""Reading and writing files so that nothing is ever half-written and every failure is one line.

A file is written to a temporary name beside its target and renamed; an interrupted program leaves the old file or the
new one, never a part of it.
"""

import contextlib
import errno
import glob
import os
import secrets
import shutil
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TextIO

from solen.errors import OutputError, SolenError

DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{name}{digit}" for name in ("COM", "LPT") for digit in "0123456789¹²³")}
"""Names that are no files on Windows, whatever their ending."""
LONGEST_NAME = 200
"""Length of a name in bytes: with its ending it must be a valid file name everywhere."""
SEALED = b"SOLENSEAL1"
_SEAL = struct.Struct("<10sQI")
_APART = 1 << 13
Content = bytes | Callable[[Path], object]
"""Content of a file: its bytes, or a function that writes them to a path, for libraries that write files themselves."""


def read_text(path: Path, error: type[SolenError]) -> str:
    """Text of a UTF-8 file (a byte-order mark is dropped); ``error`` is raised in one line where that fails."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise error(str(path), limit="no such file", remedy="check the path") from None
    except IsADirectoryError:
        raise error(str(path), limit="is a folder", remedy="name a file") from None
    except UnicodeDecodeError as bad:
        raise error(str(path), limit=f"not UTF-8 text (byte {bad.start})", remedy="save it as UTF-8 text") from None
    except (OSError, ValueError) as bad:
        reason = getattr(bad, "strerror", None) or bad
        raise error(str(path), limit=f"cannot be read: {reason}", remedy="check its name and permissions") from None


@contextlib.contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Folder that results may go to, made with its parents if need be; `OutputError` where no file can be written.

    Leaving with an exception removes again what was made here and is still empty.
    """
    made: list[Path] = []
    try:
        if path.is_file():
            raise OSError(errno.ENOTDIR, "it is a file, not a folder")
        made = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except (OSError, ValueError) as bad:
        _remove_empty(made)
        raise _unwritable(path, bad, "name another output folder") from None
    try:
        yield path
    except BaseException:
        _remove_empty(made)
        raise


def write_text(path: Path, text: str) -> Path:
    """Write UTF-8 text under a temporary name and rename it to ``path``; `OutputError` where that fails."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> Path:
    """Write bytes under a temporary name and rename it to ``path``; `OutputError` where that fails.

    A file that is replaced keeps its permissions; a new one has those of any new file.
    """
    return write_all({path: data})[0]


def joined(*several: Mapping[Path, Content]) -> dict[Path, Content]:
    """Contents of several groups of files together; `OutputError` where two of them are one file."""
    contents: dict[Path, Content] = {}
    known: set[Path] = set()
    for group in several:
        for path, content in group.items():
            if path.resolve() in known:
                raise OutputError(str(path), limit="is another file of this command", remedy="rename one of the two")
            known.add(path.resolve())
            contents[path] = content
    return contents


def write_all(contents: Mapping[Path, Content]) -> list[Path]:
    """Write several files: all under temporary names first, then all renamed, one right after the other.

    `OutputError` where one of them cannot be written; then none is.
    """
    ready: dict[Path, tuple[Path, Path]] = {}
    path = Path()
    try:
        for path, data in contents.items():
            target = _target(path)
            temporary = target.with_name(f"{_hidden(target)}{secrets.token_hex(6)}.tmp")
            ready[path] = (temporary, target)
            _write_new(temporary, data, like=target)
        for path in ready:
            temporary, target = ready[path]
            temporary.replace(target)
    except (OSError, ValueError) as bad:
        raise _unwritable(path, bad, "name another place") from None
    finally:
        for temporary, _ in ready.values():
            with contextlib.suppress(OSError, ValueError):
                temporary.unlink(missing_ok=True)
    return list(contents)


@contextlib.contextmanager
def streamed(path: Path) -> Iterator[TextIO]:
    """Text file to be written to as it comes, under a temporary name until all of it is; `OutputError` where it fails.

    Leaving with an exception leaves no file.
    """
    temporary = path.with_name(f"{_hidden(path)}{secrets.token_hex(6)}.tmp")
    try:
        with temporary.open("x", encoding="utf-8", newline="\n") as file:
            yield file
        temporary.replace(path)
    except OSError as bad:
        raise _unwritable(path, bad, "name another place") from None
    finally:
        temporary.unlink(missing_ok=True)


def seal(path: Path) -> None:
    """Append a checksum of a file to it, twice and apart, so that a single damage spares one; HDF5 ignores both."""
    size, crc = path.stat().st_size, _crc(path)
    body = _SEAL.pack(SEALED, size, crc)
    one = body + zlib.crc32(body).to_bytes(4, "little")
    with path.open("ab") as file:
        file.write(one + bytes(_APART) + one)


def check_seal(path: Path, error: type[SolenError]) -> int:
    """Size of a file without its seal; ``error`` if a sealed file is not the one written."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - 2 * _APART))
            end = file.read()
        stated = _stated(end)
        if stated is None:
            return size
        if stated[0] <= size and _crc(path, stated[0]) == stated[1]:
            return stated[0]
    except OSError as bad:
        raise error(str(path), limit=f"cannot be read: {bad.strerror}", remedy="check the path") from None
    limit = "is damaged: its content is not what was written, by the checksum at its end"
    raise error(str(path), limit=limit, remedy="restore it from a copy, or from its journal")


def _stated(end: bytes) -> tuple[int, int] | None:
    """Size and checksum that a seal at a file's end states; None where no seal is whole."""
    place = end.find(SEALED)
    while place >= 0:
        body, crc = end[place : place + _SEAL.size], end[place + _SEAL.size :][:4]
        if zlib.crc32(body).to_bytes(4, "little") == crc:
            _, size, stated = _SEAL.unpack(body)
            return size, stated
        place = end.find(SEALED, place + 1)
    return None


def _crc(path: Path, size: int | None = None) -> int:
    """CRC-32 of a file's first bytes, or of all."""
    crc, left = 0, path.stat().st_size if size is None else size
    with path.open("rb") as file:
        while left and (chunk := file.read(min(left, 1 << 20))):
            crc, left = zlib.crc32(chunk, crc), left - len(chunk)
    return crc


def check_name(what: str, name: str, error: type[SolenError], remedy: str = "choose another") -> None:
    """Raise ``error`` if Windows, macOS or Linux does not allow a file's name."""
    limit = ""
    if any(sign in name for sign in '/\\:*?"<>|') or any(ord(sign) < 32 for sign in name):
        limit = 'must be the name of a file, without its folder and without any of / \\ : * ? " < > |'
    elif not name or name[0] == "." or name[-1] in ". ":
        limit = "must not begin with a dot, nor end in a dot or a blank"
    elif name.partition(".")[0].rstrip().upper() in DEVICES:
        limit = f"is a device on Windows: {name.partition('.')[0]}"
    elif (length := len(name.encode())) > LONGEST_NAME:
        name, limit = f"{name[:20]}…", f"is {length} bytes long; {LONGEST_NAME} at most"
    if limit:
        raise error(what, value=name, limit=limit, remedy=remedy)


def csv_cell(text: str) -> str:
    """A text for a CSV file: what a spreadsheet would take for a formula begins with an apostrophe."""
    shown = f"'{text}" if text[:1] in {"=", "+", "-", "@", "\t", "\r"} else text
    return '"' + shown.replace('"', '""') + '"' if any(sign in shown for sign in ',"\n\r') else shown


def remove(path: Path) -> None:
    """Remove a file, or a link to one, if it is there; `OutputError` where that fails."""
    try:
        if path.is_file() or path.is_symlink():
            path.unlink()
    except OSError as bad:
        raise OutputError(str(path), limit=f"cannot be removed: {bad.strerror or bad}", remedy="remove it") from None


def remove_left(path: Path) -> None:
    """Remove temporary files left by a killed program; no other process may be writing this file."""
    target = _target(path)
    for left in target.parent.glob(f"{glob.escape(_hidden(target))}*.tmp"):
        with contextlib.suppress(OSError):
            left.unlink()


def _hidden(target: Path) -> str:
    """Beginning of the temporary names of a file."""
    return f".{target.name[:100]}."


def _target(path: Path) -> Path:
    """The file itself where ``path`` is a link to it; `ValueError` for what is there and not an ordinary file."""
    target = path.resolve()
    if not target.name or (target.exists() and not target.is_file()):
        raise ValueError("not an ordinary file")
    return target


def _write_new(path: Path, data: Content, like: Path) -> None:
    """Write a file that must not exist yet, with the permissions of ``like`` where that exists."""
    with path.open("xb") as file:
        if isinstance(data, bytes):
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    if not isinstance(data, bytes):
        data(path)
        with path.open("rb+") as file:
            os.fsync(file.fileno())
    if like.exists():
        shutil.copymode(like, path)


def _unwritable(path: Path, bad: OSError | ValueError, remedy: str) -> OutputError:
    return OutputError(str(path), limit=f"cannot be written: {getattr(bad, 'strerror', None) or bad}", remedy=remedy)


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders that are empty, innermost first."""
    for folder in folders:
        with contextlib.suppress(OSError, ValueError):
            folder.rmdir()

"""Reading and writing files: no file is ever left incomplete, and every failure is a one-line error.

A file is written under a temporary name next to its target and then renamed; an interrupted program leaves either the
old file or the new one.
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
"""Names reserved by Windows, with any extension."""
MAX_NAME_LENGTH = 200
"""Maximum length of a name in bytes, with which name and extension are valid on every system."""
SIMULATED = "# simulated by solen, not measured\n"
"""First line of a table that solen computes from a model without measurements."""
SIMULATED_DATA = "# simulated: yes\n"
"""Line before the column names of a table based on simulated data."""
SEALED = b"SOLENSEAL1"
_SEAL = struct.Struct("<10sQI")
_COPY_DISTANCE = 1 << 13
Content = bytes | Callable[[Path], object]
"""Content of a file: its bytes, or a function that writes them to a path, for libraries that write files themselves."""


def read_text(path: Path, error: type[SolenError], *, maker: str = "") -> str:
    """Return the text of a UTF-8 file without a byte-order mark; raise ``error`` if it cannot be read.

    ``maker`` is the command that writes such a file; the error names it if the file does not exist.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        remedy = f"write it with {maker}, or check the path" if maker else "check the path"
        raise error(str(path), limit="no such file", remedy=remedy) from None
    except IsADirectoryError:
        raise error(str(path), limit="is a folder", remedy="specify a file") from None
    except UnicodeDecodeError as bad:
        raise error(str(path), limit=f"is not UTF-8 text (byte {bad.start})", remedy="save it as UTF-8 text") from None
    except (OSError, ValueError) as bad:
        raise _unreadable(path, bad, error) from None


def read_bytes(path: Path, error: type[SolenError], *, max_mb: int, remedy: str) -> bytes:
    """Return the bytes of a file; raise ``error`` if it cannot be read, is empty or is larger than ``max_mb``.

    ``remedy`` states how to obtain a smaller file.
    """
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise error(str(path), limit="is a folder or a device", remedy="specify a file")
        if size > max_mb * 1_000_000:
            limit = f"has {size / 1e6:.0f} MB; the limit is {max_mb} MB"
            raise error(str(path), limit=limit, remedy=remedy)
        data = path.read_bytes()
    except FileNotFoundError:
        raise error(str(path), limit="no such file", remedy="check the path") from None
    except (OSError, ValueError) as bad:
        raise _unreadable(path, bad, error) from None
    if not data.strip():
        raise error(str(path), limit="is empty", remedy="export it again")
    return data


@contextlib.contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Create a folder for results, with its parents; raise `OutputError` if no file can be written there.

    After an exception, folders created here that are still empty are removed.
    """
    created: list[Path] = []
    try:
        if path.is_file():
            raise OSError(errno.ENOTDIR, "it is a file, not a folder")
        created = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except (OSError, ValueError) as bad:
        _remove_empty(created)
        raise _unwritable(path, bad, "specify another folder") from None
    try:
        yield path
    except BaseException:
        _remove_empty(created)
        raise


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Create a folder that receives its name only when complete; raise `OutputError` if it exists or this fails.

    After an exception, nothing is left.
    """
    if path.exists():
        raise OutputError(str(path), limit="already exists", remedy="specify another folder, or remove it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".new-", dir=path.parent, ignore_cleanup_errors=True) as temporary:
            ready = Path(temporary) / "ready"
            ready.mkdir()
            yield ready
            ready.replace(path)
    except OSError as bad:
        raise _unwritable(path, bad, "specify another path") from None


def write_text(path: Path, text: str) -> Path:
    """Write UTF-8 text under a temporary name and rename it to ``path``; raise `OutputError` if that fails."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> Path:
    """Write bytes under a temporary name and rename it to ``path``; raise `OutputError` if that fails.

    A replaced file keeps its permissions; a new one has the default permissions.
    """
    return write_all({path: data})[0]


def joined(*several: Mapping[Path, Content]) -> dict[Path, Content]:
    """Combine the contents of several groups of files; raise `OutputError` if two have the same path."""
    contents: dict[Path, Content] = {}
    resolved: set[Path] = set()
    for group in several:
        for path, content in group.items():
            if path.resolve() in resolved:
                raise OutputError(
                    str(path), limit="is also another output of this command", remedy="rename one of them"
                )
            resolved.add(path.resolve())
            contents[path] = content
    return contents


def write_all(contents: Mapping[Path, Content]) -> list[Path]:
    """Write several files under temporary names, then rename all of them.

    Raise `OutputError` if one of them cannot be written; then none of them is.
    """
    ready: dict[Path, tuple[Path, Path]] = {}
    path = Path()
    try:
        for path, data in contents.items():
            target = _target(path)
            temporary = target.with_name(f"{_temporary_prefix(target)}{secrets.token_hex(6)}.tmp")
            ready[path] = (temporary, target)
            _write_new(temporary, data, original=target)
        for path in ready:
            temporary, target = ready[path]
            temporary.replace(target)
    except (OSError, ValueError) as bad:
        raise _unwritable(path, bad, "specify another path") from None
    finally:
        for temporary, _ in ready.values():
            with contextlib.suppress(OSError, ValueError):
                temporary.unlink(missing_ok=True)
    return list(contents)


def write_new(folder: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write files into a folder, which is created if missing; raise `OutputError` if one exists with other content.

    A name may include subfolders: ``bench/rig.toml``.
    """
    targets = {folder / name: data for name, data in contents.items()}
    with output_folder(folder):
        for target, data in targets.items():
            if target.exists() and not (target.is_file() and target.read_bytes() == data):
                raise OutputError(str(target), limit="already exists", remedy="specify another folder, or remove it")
        for target in targets:
            target.parent.mkdir(parents=True, exist_ok=True)
        return write_all(targets)


@contextlib.contextmanager
def streamed(path: Path) -> Iterator[TextIO]:
    """Open a text file for incremental writing; it has a temporary name until it is complete.

    Raise `OutputError` if writing fails. After an exception, no file is left.
    """
    temporary = path.with_name(f"{_temporary_prefix(path)}{secrets.token_hex(6)}.tmp")
    try:
        with temporary.open("x", encoding="utf-8", newline="\n") as file:
            yield file
        temporary.replace(path)
    except OSError as bad:
        raise _unwritable(path, bad, "specify another path") from None
    finally:
        temporary.unlink(missing_ok=True)


def seal(path: Path) -> None:
    """Append two copies of the checksum of a file, at a distance at which local damage leaves one intact.

    HDF5 ignores both of them.
    """
    size, crc = path.stat().st_size, _crc(path)
    body = _SEAL.pack(SEALED, size, crc)
    copy = body + zlib.crc32(body).to_bytes(4, "little")
    with path.open("ab") as file:
        file.write(copy + bytes(_COPY_DISTANCE) + copy)


def check_seal(path: Path, error: type[SolenError]) -> int:
    """Return the size of a file without its checksums; raise ``error`` if the content of a sealed file has changed."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - 2 * _COPY_DISTANCE))
            tail = file.read()
        sealed = _read_seal(tail)
        if sealed is None:
            return size
        if sealed[0] <= size and _crc(path, sealed[0]) == sealed[1]:
            return sealed[0]
    except OSError as bad:
        raise error(str(path), limit=f"cannot be read: {bad.strerror}", remedy="check the path") from None
    limit = "is damaged: its content does not match the checksum at its end"
    raise error(str(path), limit=limit, remedy="restore it from a copy, or from its journal")


def _read_seal(tail: bytes) -> tuple[int, int] | None:
    """Return the size and checksum stored at the end of a file, or None if no copy is intact."""
    position = tail.find(SEALED)
    while position >= 0:
        body, crc = tail[position : position + _SEAL.size], tail[position + _SEAL.size :][:4]
        if zlib.crc32(body).to_bytes(4, "little") == crc:
            _, size, sealed = _SEAL.unpack(body)
            return size, sealed
        position = tail.find(SEALED, position + 1)
    return None


def _crc(path: Path, size: int | None = None) -> int:
    """Return the CRC-32 of the first ``size`` bytes of a file, or of the entire file."""
    crc, remaining = 0, path.stat().st_size if size is None else size
    with path.open("rb") as file:
        while remaining and (chunk := file.read(min(remaining, 1 << 20))):
            crc, remaining = zlib.crc32(chunk, crc), remaining - len(chunk)
    return crc


def check_name(what: str, name: str, error: type[SolenError], remedy: str = "choose another") -> None:
    """Raise ``error`` if Windows, macOS or Linux does not allow a file name."""
    limit = ""
    if any(character in name for character in '/\\:*?"<>|') or any(ord(character) < 32 for character in name):
        limit = 'must be the name of a file, without its folder and without any of / \\ : * ? " < > |'
    elif not name or name[0] == "." or name[-1] in ". ":
        limit = "must not begin with a dot, or end in a dot or a space"
    elif name.partition(".")[0].rstrip().upper() in DEVICES:
        limit = f"is reserved for a device on Windows: {name.partition('.')[0]}"
    elif (length := len(name.encode())) > MAX_NAME_LENGTH:
        name, limit = f"{name[:20]}…", f"is {length} bytes long; at most {MAX_NAME_LENGTH} are allowed"
    if limit:
        raise error(what, value=name, limit=limit, remedy=remedy)


def csv_cell(text: str) -> str:
    """Return a text for a CSV file, with a leading apostrophe if a spreadsheet would interpret it as a formula."""
    cell = f"'{text}" if text[:1] in {"=", "+", "-", "@", "\t", "\r"} else text
    return '"' + cell.replace('"', '""') + '"' if any(character in cell for character in ',"\n\r') else cell


def remove(path: Path) -> None:
    """Remove a file, or a symbolic link to one, if it exists; raise `OutputError` if that fails."""
    try:
        if path.is_file() or path.is_symlink():
            path.unlink()
    except OSError as bad:
        raise OutputError(str(path), limit=f"cannot be removed: {bad.strerror or bad}", remedy="remove it") from None


def remove_leftovers(path: Path) -> None:
    """Remove temporary files that a killed program left; no other process may be writing this file."""
    target = _target(path)
    for leftover in target.parent.glob(f"{glob.escape(_temporary_prefix(target))}*.tmp"):
        with contextlib.suppress(OSError):
            leftover.unlink()


def _temporary_prefix(target: Path) -> str:
    """Return the common beginning of the temporary names of a file."""
    return f".{target.name[:100]}."


def _target(path: Path) -> Path:
    """Return the target of ``path``, with symbolic links followed; raise `ValueError` if it is not an ordinary file."""
    target = path.resolve()
    if not target.name or (target.exists() and not target.is_file()):
        raise ValueError("not an ordinary file")
    return target


def _write_new(path: Path, data: Content, original: Path) -> None:
    """Write a new file with the permissions of ``original``, if that exists; raise `OSError` if the file exists."""
    with path.open("xb") as file:
        if isinstance(data, bytes):
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    if not isinstance(data, bytes):
        data(path)
        with path.open("rb+") as file:
            os.fsync(file.fileno())
    if original.exists():
        shutil.copymode(original, path)


def _unreadable(path: Path, bad: OSError | ValueError, error: type[SolenError]) -> SolenError:
    limit = f"cannot be read: {getattr(bad, 'strerror', None) or bad}"
    return error(str(path), limit=limit, remedy="check the path and its permissions")


def _unwritable(path: Path, bad: OSError | ValueError, remedy: str) -> OutputError:
    return OutputError(str(path), limit=f"cannot be written: {getattr(bad, 'strerror', None) or bad}", remedy=remedy)


def _remove_empty(folders: list[Path]) -> None:
    """Remove empty folders, innermost first."""
    for folder in folders:
        with contextlib.suppress(OSError, ValueError):
            folder.rmdir()

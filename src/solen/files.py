"""Reading and writing files so that nothing is ever half-written and every failure is one line.

A file is written to a temporary name beside its target and renamed; whoever is interrupted leaves the old file or the
new one, never a part of it.
"""

import contextlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from solen.errors import OutputError, SolenError


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
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(6)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            shutil.copymode(path, temporary)
        temporary.replace(path)
    except (OSError, ValueError) as bad:
        raise _unwritable(path, bad, "name another place") from None
    finally:
        with contextlib.suppress(OSError, ValueError):
            temporary.unlink(missing_ok=True)
    return path


def _unwritable(path: Path, bad: OSError | ValueError, remedy: str) -> OutputError:
    return OutputError(str(path), limit=f"cannot be written: {getattr(bad, 'strerror', None) or bad}", remedy=remedy)


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders, innermost first, up to the first that is not empty."""
    with contextlib.suppress(OSError, ValueError):
        for folder in folders:
            folder.rmdir()

"""Reading and writing files so that nothing is ever half-written and every failure is one line.

A file is written to a temporary name beside its target and renamed; whoever is interrupted leaves the old file or the
new one, never a part of it.
"""

import contextlib
import os
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
    except OSError as bad:
        raise error(str(path), limit=f"cannot be read: {bad.strerror}", remedy="check its permissions") from None


@contextlib.contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Folder that results may go to, made with its parents if need be; `OutputError` where no file can be written.

    Leaving with an exception removes the folder again if it was made here and is still empty.
    """
    existed = path.exists()
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as bad:
        raise OutputError(
            str(path), limit=f"cannot be written: {bad.strerror or bad}", remedy="name another output folder"
        ) from None
    try:
        yield path
    except BaseException:
        if not existed:
            with contextlib.suppress(OSError):
                path.rmdir()
        raise


def write_text(path: Path, text: str) -> Path:
    """Write UTF-8 text under a temporary name and rename it to ``path``; `OutputError` where that fails."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> Path:
    """Write bytes under a temporary name and rename it to ``path``; `OutputError` where that fails."""
    temporary: Path | None = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = Path(file.name)
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.chmod(0o644)  # a temporary file is private; what replaces the target is an ordinary file
        temporary.replace(path)
    except OSError as bad:
        raise OutputError(
            str(path), limit=f"cannot be written: {bad.strerror or bad}", remedy="name another place"
        ) from None
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
    return path

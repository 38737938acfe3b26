"""A lock file held by one process at a time, released whenever that process ends.

SQLite locks files on every system, and no system calls are needed: an exclusive transaction on an empty database is the
lock. A killed process leaves an empty hidden file, which the next one reuses.

Public name: `locked`.
"""

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from solen.errors import BenchError


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock the resource named by a file; no lock file remains.

    Raises
    ------
    BenchError
        If another process has the lock. A file system without locks grants it to every process.
    """
    file = path.with_name(f".{path.name}.lock")
    with contextlib.ExitStack() as leftover, contextlib.ExitStack() as connection:  # closed first: Windows asks for it
        try:
            table = connection.enter_context(
                contextlib.closing(sqlite3.connect(file, timeout=0.0, isolation_level=None))
            )
            table.execute("begin exclusive")
            leftover.callback(_remove, file)
        except sqlite3.Error as bad:
            if getattr(bad, "sqlite_errorname", "").startswith("SQLITE_BUSY"):
                limit, remedy = "is in use by another run", "wait until it has ended"
                raise BenchError(str(path), limit=limit, remedy=remedy) from None
        yield


def _remove(file: Path) -> None:
    with contextlib.suppress(OSError):
        file.unlink(missing_ok=True)

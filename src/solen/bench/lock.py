"""A lock that one process at a time can hold, and that is released however the process ends.

SQLite can lock files on every system: an exclusive transaction on an empty database is the lock. A killed process
leaves an empty hidden file behind, which the next process reuses.

Public name: `locked`.
"""

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from solen.errors import BenchError


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a file by a hidden file beside it, which is removed afterwards.

    Raises
    ------
    BenchError
        If another process holds the lock; a file system that does not support locks grants it to every process.
    """
    file = path.with_name(f".{path.name}.lock")
    # the connection is closed before the file is removed, as Windows requires
    with contextlib.ExitStack() as removal, contextlib.ExitStack() as connection:
        try:
            table = connection.enter_context(
                contextlib.closing(sqlite3.connect(file, timeout=0.0, isolation_level=None))
            )
            table.execute("begin exclusive")
            removal.callback(_remove, file)
        except sqlite3.Error as bad:
            if getattr(bad, "sqlite_errorname", "").startswith("SQLITE_BUSY"):
                limit, remedy = "is in use by another run", "wait until it has ended"
                raise BenchError(str(path), limit=limit, remedy=remedy) from None
        yield


def _remove(file: Path) -> None:
    with contextlib.suppress(OSError):
        file.unlink(missing_ok=True)

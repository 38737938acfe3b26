"""A lock beside a file that one process holds and no other: it goes when the process does, however that ends.

The idea: no system's own calls are needed where SQLite is, which locks files on all of them: an exclusive transaction
on an empty database is the lock. What a kill leaves of it is an empty hidden file that the next one takes over.

The interface: `Lock` of a path, taken when it is made.
"""

import contextlib
import sqlite3
from pathlib import Path
from types import TracebackType
from typing import Self

from solen.errors import BenchError


class Lock:
    """A lock on what a file of that name stands for; use it in a ``with`` statement, or `release` it.

    Raises
    ------
    BenchError
        Where another process holds it. A file system that knows no locks gives it to everybody.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(f".{path.name}.lock")
        self._table: sqlite3.Connection | None = None
        try:
            self._table = sqlite3.connect(self._path, timeout=0.0, isolation_level=None)
            self._table.execute("begin exclusive")
        except sqlite3.Error as bad:
            self._close()
            if getattr(bad, "sqlite_errorname", "").startswith("SQLITE_BUSY"):
                limit, remedy = "is in use by a run that goes on", "let it end first"
                raise BenchError(str(path), limit=limit, remedy=remedy) from None

    def release(self) -> None:
        """Let go of it, and leave no file; once more is the same."""
        if self._table is not None:
            self._close()
            with contextlib.suppress(OSError):
                self._path.unlink(missing_ok=True)

    def _close(self) -> None:
        if self._table is not None:
            self._table.close()
            self._table = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.release()

"""A lock on an open file that its process holds and no other: it goes when the process does, however that ends.

The interface: `hold`; a second `hold` of the same file elsewhere is told.
"""

import sys
from io import FileIO

_FAR = 1 << 62
"""Windows locks bytes, and none can read them: one far behind the end is taken."""


def hold(file: FileIO) -> bool:
    """Whether the file is ours now, until it is closed; a file system without locks gives it to everybody."""
    try:
        _hold(file)
    except BlockingIOError:
        return False
    except OSError as bad:
        return not (sys.platform == "win32" and isinstance(bad, PermissionError))
    return True


if sys.platform == "win32":
    import msvcrt

    def _hold(file: FileIO) -> None:
        at = file.tell()
        file.seek(_FAR)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        finally:
            file.seek(at)

else:
    import fcntl

    def _hold(file: FileIO) -> None:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)

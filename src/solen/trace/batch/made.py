"""How this folder is compiled: as the kernel is, but what changes here leaves the kernel's own cache alone."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from solen.trace.kernel.compiled import STAMP, called, compiled

P = ParamSpec("P")
R = TypeVar("R")

HERE = Path(__file__).parent
OWN = tuple(
    (file.stat().st_mtime, file.stat().st_size)
    for file in (HERE / name for name in ("y.py", "launch.py", "lot.py", "space.py"))
)


def made(function: Callable[P, R]) -> Callable[P, R]:
    """As `solen.trace.kernel.compiled.called`, compiled anew where a file of this folder changes too."""
    return _stamped(called(function))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `solen.trace.kernel.compiled.compiled`, compiled anew where a file of this folder changes too."""
    return _stamped(compiled(function))


def _stamped(function: Callable[P, R]) -> Callable[P, R]:
    dispatcher: Any = function
    index = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if index is not None:
        index._source_stamp = (STAMP, OWN)
    return function

"""How the kernel is compiled: by numba, without the interpreter's lock, cached on disk.

numba renews a cached function only when the file it stands in changes. The functions here call each other across files,
so each carries a stamp of the contents of its file and of all that this takes over: a copy of a tree compiles nothing.
"""

import hashlib
import re
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
IMPORTED = re.compile(r"^from solen\.([\w.]+) import", re.MULTILINE)


def _files(module: str) -> list[Path]:
    """Files of a module of solen's by its name; of a package all of them."""
    path = ROOT.joinpath(*module.split("."))
    return list(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


def _taken(file: Path) -> set[Path]:
    """Files that a file of the kernel takes functions or constants from."""
    return {path for module in IMPORTED.findall(file.read_text("utf-8")) for path in _files(module)}


def sources(file: Path) -> set[Path]:
    """Files of the kernel that a file of it stands on, itself among them, and those whose constants they take over."""
    known, new = set[Path](), {file}
    while new:
        known |= new
        new = {path for one in new if one.parent == HERE for path in _taken(one)} - known
    return known


@cache
def stamp(file: Path) -> str:
    """Hash of the contents of all that a file of the kernel stands on."""
    contents = hashlib.sha256()
    for path in sorted(sources(file)):
        contents.update(_digest(path))
    return contents.hexdigest()


@cache
def _digest(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "arcp", "nsz"},
    "_nrt": False,
}
"""No reference is counted, so that passing tables to a function costs nothing; so nothing can be allocated either: room
to work in is handed in. Division follows IEEE 754 (no branch for a zero divisor), and rounding may differ by fused
operations and by multiplying with a reciprocal; infinities and NaN keep their meaning, parallel rays depend on it."""


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that becomes part of its callers: what a loop calls, so that it can do several at once."""
    return _compiled(function, forceinline=True)


def rounded(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with every operation rounded: the same arguments give the same number wherever it is asked for."""
    return _compiled(function, forceinline=True, fastmath=False)


def summed(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for sums: in any order, so that several of their numbers can be added at once."""
    return _compiled(function, forceinline=True, fastmath={"contract", "arcp", "nsz", "reassoc"})


def called(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that stands on its own: a large one, which would be compiled anew in each of its callers."""
    return _compiled(function)


def _compiled(function: Callable[P, R], **more: Any) -> Callable[P, R]:
    """`numba.njit` with a cache on disk, keeping the types that a checker sees."""
    return cast("Callable[P, R]", cached(partial(numba.njit, **(OPTIONS | more)), function))


def cached(decorator: Callable[..., Any], function: Callable[..., Any]) -> Any:
    """What a decorator of numba's makes of a function, with a cache on disk."""
    try:
        dispatcher = decorator(function, cache=True)
    except RuntimeError:  # nowhere to keep a cache: a read-only installation and no home folder
        return decorator(function)
    cache = getattr(dispatcher, "_cache", None)  # there is none where numba is set to compile nothing
    index = getattr(cache, "_cache_file", None)  # numba offers no public way to name more files
    if index is not None:
        index._source_stamp = stamp(Path(function.__code__.co_filename).resolve())
        index._version = f"{numba.__version__} {index._source_stamp}"  # another's may name classes that are no more
    return dispatcher


def cache_folder() -> Path | None:
    """Folder in which numba keeps the kernel; None where it can keep none."""
    cache = getattr(cached(numba.njit, cache_folder), "_cache", None)  # any function of this folder; it is not compiled
    return None if cache is None else Path(cache.cache_path)

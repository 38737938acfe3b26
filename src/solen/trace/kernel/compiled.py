"""How the kernel is compiled: by numba, without the interpreter's lock, cached on disk.

numba renews a cached function only when the file it stands in changes. The functions here call each other across files,
so each carries a stamp of the contents of its file and of all that this takes over: a copy of a tree compiles nothing.

numba also compiles a function again with each of its callers, and theirs. Here a function either becomes part of its
callers, or is linked with them as numba does, or stands on its own: then their code has no more than a call by its
symbol, and what is kept of a caller says which functions must be there before it.
"""

import hashlib
import importlib
import re
from collections.abc import Callable
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

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
    "no_cfunc_wrapper": True,
}
"""No reference is counted, so that passing tables to a function costs nothing; so nothing can be allocated either: room
to work in is handed in. Division follows IEEE 754 (no branch for a zero divisor), and rounding may differ by fused
operations and by multiplying with a reciprocal; infinities and NaN keep their meaning, parallel rays depend on it."""


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that becomes part of its callers: what a loop calls, so that it can do several at once."""
    return _inlined(function)


def rounded(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, with every operation rounded: the same arguments give the same number wherever it is asked for."""
    return _inlined(function, fastmath=False)


def summed(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for sums: in any order, so that several of their numbers can be added at once."""
    return _inlined(function, fastmath={"contract", "arcp", "nsz", "reassoc"})


def called(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that stands on its own: a large one, or one that Python calls."""
    return cast("Callable[P, R]", _kept(function, _StandingCache))


def linked(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that is linked with its callers: one that is called for every ray, or for a few."""
    return _within(function)


def _inlined(function: Callable[P, R], **more: Any) -> Callable[P, R]:
    return _within(function, forceinline=True, **more)


def _within(function: Callable[P, R], **more: Any) -> Callable[P, R]:
    dispatcher = _kept(function, _Cache, no_cpython_wrapper=True, **more)
    if isinstance(dispatcher, Dispatcher):
        dispatcher.__class__ = _Within
    return cast("Callable[P, R]", dispatcher)


def _kept(function: Callable[..., Any], kind: type[FunctionCache], **more: Any) -> Any:
    """`numba.njit` with a cache of a kind on disk."""
    return cached(partial(numba.njit, **(OPTIONS | more)), function, kind)


class _Within(CPUDispatcher):
    """A function without the code by which Python calls it: where it does, in tests, the function is compiled anew."""

    @cached_property
    def _from_python(self) -> Any:
        options = {key: value for key, value in self.targetoptions.items() if key != "no_cpython_wrapper"}
        return cached(partial(numba.jit, **options), self.py_func, _FromPythonCache)

    def __call__(self, *arguments: Any) -> Any:
        return self._from_python(*arguments)


Address = tuple[str, str, tuple[Any, ...]]
"""Module, name and types of arguments of a function."""
STANDING: dict[str, Address] = {}
"""Functions that stand on their own by their symbols."""


class _Form(CompileResultCacheImpl):
    """What is kept of a function: its symbols, the functions standing on their own that it calls, and its code."""

    def reduce(self, result: Any) -> Any:
        base: Any = super()
        module = result.library._final_module
        calls = {f.name: STANDING[f.name] for f in module.functions if f.is_declaration and f.name in STANDING}
        named = (*module.functions, *module.global_variables)
        return {one.name for one in named if not one.is_declaration}, calls, base.reduce(result)

    def rebuild(self, target_context: Any, kept: Any) -> Any:
        symbols, calls, rest = kept
        for symbol, (module, name, arguments) in calls.items():
            dispatcher = getattr(importlib.import_module(module), name)
            dispatcher.compile(arguments)  # or taken from the cache
            its = dispatcher.overloads[arguments]
            binding.add_symbol(symbol, its.library.get_pointer_to_function(its.fndesc.llvm_func_name))
        target_context.codegen()._engine._defined_symbols |= symbols
        base: Any = super()
        return base.rebuild(target_context, rest)


class _StandingForm(_Form):
    """As `_Form`, of a function that stands on its own: an empty module is what callers take over of it."""

    def reduce(self, result: Any) -> Any:
        self._note(result)
        result.library._shared_module = binding.parse_assembly("")
        return super().reduce(result)

    def rebuild(self, target_context: Any, kept: Any) -> Any:
        result = super().rebuild(target_context, kept)
        self._note(result)
        return result

    def _note(self, result: Any) -> None:
        its = result.fndesc
        STANDING[its.llvm_func_name] = its.modname, its.qualname, tuple(result.signature.args)


class _FromPythonForm(_Form):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        base: Any = super()
        return f"python-{base.get_filename_base(fullname, abiflags)}"


class _Cache(FunctionCache):
    _impl_class = _Form


class _StandingCache(_Cache):
    _impl_class = _StandingForm


class _FromPythonCache(_Cache):
    _impl_class = _FromPythonForm


def cached(decorator: Callable[..., Any], function: Callable[..., Any], kind: type[FunctionCache] | None = None) -> Any:
    """What a decorator of numba's makes of a function, with a cache on disk: numba's own, or one of a ``kind``."""
    try:
        dispatcher: Any = decorator(function, cache=True)
    except RuntimeError:  # nowhere to keep a cache: a read-only installation and no home folder
        return decorator(function)
    if kind is not None and hasattr(dispatcher, "_cache"):
        dispatcher._cache = kind(function)
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

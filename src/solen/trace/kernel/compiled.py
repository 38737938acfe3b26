"""Compilation of the kernel by numba, without the interpreter lock, cached on disk.

numba recompiles a cached function only when its own file changes. Because the functions here call each other across
files, each is stamped with the contents of its file and of all files from which that file imports. In a copied source
tree nothing needs recompiling.

numba also includes the code of a function in each of its callers, and in their callers. Here a function is inlined in
its callers, linked with them as numba does, or *standalone*: callers then refer to it only by its symbol, and the
cached result of a caller lists the functions that must be loaded before it.
"""

import hashlib
import importlib
import pickle
import re
from collections.abc import Callable
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher

P = ParamSpec("P")
R = TypeVar("R")

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
IMPORTS = re.compile(r"^from solen\.([\w.]+) import", re.MULTILINE)


def _files(module: str) -> list[Path]:
    """Return the file of a solen module by its name; for a package, all of its files."""
    path = ROOT.joinpath(*module.split("."))
    return list(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


def _imported_files(file: Path) -> set[Path]:
    """Return the files from which a kernel file imports functions or constants."""
    return {path for module in IMPORTS.findall(file.read_text("utf-8")) for path in _files(module)}


def sources(file: Path) -> set[Path]:
    """Return the kernel files on which a file depends, including itself, and other files that supply constants."""
    known, new = set[Path](), {file}
    while new:
        known |= new
        new = {path for source in new if source.parent == HERE for path in _imported_files(source)} - known
    return known


@cache
def stamp(file: Path) -> str:
    """Return the hash of the contents of all files on which a kernel file depends."""
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
"""Without reference counting, passing tables to a function costs nothing, but nothing can be allocated: callers supply
working memory. Division follows IEEE 754, without a branch for a zero divisor. Rounding may differ because of fused
operations and multiplication by a reciprocal; infinities and NaN keep their meaning, which parallel rays require.
"""


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that is inlined in its callers, so that their loops can be vectorised."""
    return _inlined(function)


def rounded(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, but with IEEE rounding of each operation: equal arguments give equal results in all callers."""
    return _inlined(function, fastmath=False)


def summed(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for sums in any order, which can be vectorised."""
    return _inlined(function, fastmath={"contract", "arcp", "nsz", "reassoc"})


def called(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a standalone function: one that is large, or that Python calls."""
    return cast("Callable[P, R]", _with_cache(function, _StandaloneCache))


def linked(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that is linked with its callers: one that is called at most once per ray."""
    return _linked(function)


def _inlined(function: Callable[P, R], **more: Any) -> Callable[P, R]:
    return _linked(function, forceinline=True, **more)


def _linked(function: Callable[P, R], **more: Any) -> Callable[P, R]:
    dispatcher = _with_cache(function, _Cache, no_cpython_wrapper=True, **more)
    if isinstance(dispatcher, Dispatcher):
        dispatcher.__class__ = _LinkedDispatcher
    return cast("Callable[P, R]", dispatcher)


def _with_cache(function: Callable[..., Any], kind: type[FunctionCache], **more: Any) -> Any:
    """Apply `numba.njit` with a particular kind of disk cache."""
    return cached(partial(numba.njit, **(OPTIONS | more)), function, kind)


class _LinkedDispatcher(CPUDispatcher):
    """A function without code for calls from Python, which is compiled when tests call it."""

    @cached_property
    def _from_python(self) -> Any:
        options = {key: value for key, value in self.targetoptions.items() if key != "no_cpython_wrapper"}
        return cached(partial(numba.jit, **options), self.py_func, _FromPythonCache)

    def __call__(self, *arguments: Any) -> Any:
        return self._from_python(*arguments)


Address = tuple[str, str, tuple[Any, ...]]
"""Module, name and argument types of a function."""
STANDALONE: dict[str, Address] = {}
"""Standalone functions by their symbols."""


class _CachedResult(CompileResultCacheImpl):
    """The cached result of compiling a function: its symbols, the standalone functions that it calls, and its code."""

    def reduce(self, result: Any) -> Any:
        base: Any = super()
        module = result.library._final_module
        calls = {f.name: STANDALONE[f.name] for f in module.functions if f.is_declaration and f.name in STANDALONE}
        symbols = (*module.functions, *module.global_variables)
        return {symbol.name for symbol in symbols if not symbol.is_declaration}, calls, base.reduce(result)

    def rebuild(self, target_context: Any, kept: Any) -> Any:
        symbols, calls, rest = kept
        for symbol, (module, name, arguments) in calls.items():
            STANDALONE[symbol] = module, name, arguments  # callers of this function refer to the symbol too
            dispatcher = getattr(importlib.import_module(module), name)
            dispatcher.compile(arguments)  # or loaded from the cache
            callee = dispatcher.overloads[arguments]
            binding.add_symbol(symbol, callee.library.get_pointer_to_function(callee.fndesc.llvm_func_name))
        target_context.codegen()._engine._defined_symbols |= symbols
        base: Any = super()
        return base.rebuild(target_context, rest)


class _StandaloneResult(_CachedResult):
    """As `_CachedResult`, for a standalone function; callers link an empty module in its place."""

    def reduce(self, result: Any) -> Any:
        self._register(result)
        result.library._shared_module = binding.parse_assembly("")
        return super().reduce(result)

    def rebuild(self, target_context: Any, kept: Any) -> Any:
        result = super().rebuild(target_context, kept)
        self._register(result)
        return result

    def _register(self, result: Any) -> None:
        callee = result.fndesc
        STANDALONE[callee.llvm_func_name] = callee.modname, callee.qualname, tuple(result.signature.args)


class _FromPythonResult(_CachedResult):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        base: Any = super()
        return f"python-{base.get_filename_base(fullname, abiflags)}"


class _Cache(FunctionCache):
    _impl_class = _CachedResult


class _StandaloneCache(_Cache):
    _impl_class = _StandaloneResult


class _FromPythonCache(_Cache):
    _impl_class = _FromPythonResult


class _Files(IndexDataCacheFile):
    """One cache file for each set of argument types, replaced atomically.

    numba numbers its files and writes their index first. A process that compiles at the same time could therefore load
    machine code for other argument types or from earlier sources.
    """

    def save(self, key: Any, data: Any) -> None:
        base: Any = self
        with base._open_for_write(self._path(key)) as file:
            file.write(pickle.dumps(base._version) + base._dump((key, data)))

    def load(self, key: Any) -> Any:
        try:
            with Path(self._path(key)).open("rb") as file:
                if pickle.load(file) != self._version:  # noqa: S301  our own cache
                    return None  # pickles of another version may name classes that no longer exist
                stored, data = pickle.load(file)  # noqa: S301
        except (OSError, EOFError, pickle.UnpicklingError):
            return None
        return data if stored == key else None

    def flush(self) -> None:
        """Do nothing: a file of earlier sources is replaced when its function is compiled again."""

    def _path(self, key: Any) -> str:
        types = hashlib.sha256(repr(key[0]).encode()).hexdigest()[:16]
        return str(Path(self._cache_path) / f"{Path(self._index_name).stem}.{types}.nbc")


def cached(decorator: Callable[..., Any], function: Callable[..., Any], kind: type[FunctionCache] | None = None) -> Any:
    """Apply a numba decorator to a function with a disk cache: numba's own, or one of class ``kind``."""
    try:
        dispatcher: Any = decorator(function, cache=True)
    except RuntimeError:  # no writable cache folder: a read-only installation and no home folder
        return decorator(function)
    if kind is not None and hasattr(dispatcher, "_cache"):
        dispatcher._cache = kind(function)
    cache = getattr(dispatcher, "_cache", None)  # None if numba is set to compile nothing
    index = getattr(cache, "_cache_file", None)  # numba has no public interface for the version of a cache
    if index is not None:
        index.__class__ = _Files
        index._version = f"{numba.__version__} {stamp(Path(function.__code__.co_filename).resolve())}"
    return dispatcher


def cache_folder() -> Path | None:
    """Return the folder in which numba caches the kernel, or None if no folder is writable."""
    dispatcher = cached(numba.njit, cache_folder)  # any function of this folder; it is not compiled
    cache = getattr(dispatcher, "_cache", None)
    return None if cache is None else Path(cache.cache_path)

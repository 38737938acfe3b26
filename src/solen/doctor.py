"""The installation: version of solen, system, optional packages, and cache of the compiled tracer.

`examine` returns an `Installation`, whose text can be pasted into a bug report.
"""

import os
import platform
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from solen import __version__
from solen.extras import PACKAGES, installed
from solen.registry import GROUPS, plugin_entries
from solen.results import Result

CORE = ("numpy", "scipy", "numba", "matplotlib", "pydantic", "cyclopts")
"""Distributions whose versions can change numbers, figures or messages."""


@dataclass(frozen=True)
class OptionalPackage:
    """An optional package.

    Attributes
    ----------
    name
        Name of the distribution.
    version
        The installed version; None if it is missing.
    extra
        The extra of solen that installs it.
    install
        The command that installs it.
    """

    name: str
    version: str | None
    extra: str
    install: str


@dataclass(frozen=True)
class KernelCache:
    """Cache of the compiled tracer on disk; with it, later runs need no compilation.

    Attributes
    ----------
    folder
        Folder of the cache; None if no folder is writable.
    files
        Number of compiled functions in it; 0 until the first trace.
    size_bytes
        Total size of these files.
    """

    folder: Path | None
    files: int
    size_bytes: int


class Installation(Result):
    """Description of an installation for a bug report.

    Attributes
    ----------
    version, python, platform
        Version of solen; version and implementation of Python; the system and its processor.
    executable
        Path of the Python interpreter.
    threads
        Number of threads that a trace uses by default.
    packages
        Versions of the packages that solen always requires, keyed by name.
    optional
        Packages that only some commands require.
    cache
        Cache of the compiled tracer.
    plugins
        Additions of other installed packages, keyed by entry-point group.
    warnings
        Problems of the installation.
    """

    version: str
    python: str
    platform: str
    executable: str
    threads: int
    packages: dict[str, str]
    optional: tuple[OptionalPackage, ...]
    cache: KernelCache
    plugins: dict[str, tuple[str, ...]]
    warnings: tuple[str, ...]


def examine() -> Installation:
    """Describe this installation."""
    cache = kernel_cache()
    warnings = () if cache.folder else ("the compiled tracer cannot be cached, so every run compiles it again",)
    return Installation(
        version=__version__,
        python=f"{platform.python_version()} {platform.python_implementation()}",
        platform=f"{platform.platform()} {platform.machine()}",
        executable=sys.executable,
        threads=os.cpu_count() or 1,
        packages={name: _version(name) or "missing" for name in CORE},
        optional=tuple(
            OptionalPackage(
                package.distribution,
                _version(package.distribution) if installed(module) else None,
                package.extra,
                package.command,
            )
            for module, package in sorted(PACKAGES.items(), key=lambda item: item[1].extra)
        ),
        cache=cache,
        plugins={group: tuple(plugin_entries(group)) for group in GROUPS},
        warnings=warnings,
    )


def kernel_cache() -> KernelCache:
    """Return the folder and size of the cache of the compiled tracer."""
    from solen.trace.kernel.compiled import cache_folder

    folder = cache_folder()
    compiled = [file.stat().st_size for file in folder.glob("*.nbc")] if folder and folder.is_dir() else []
    return KernelCache(folder, len(compiled), sum(compiled))


def _version(distribution: str) -> str | None:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None

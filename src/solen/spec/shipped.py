"""Libraries of TOML files (resins, parts, printers): shipped files are read by name, a user's files by path."""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar

from solen.errors import DataError
from solen.files import read_text
from solen.registry import Registry
from solen.spec.strict import Migrations, error_context, migrated, nearest, parse_toml

T = TypeVar("T")

MAX_NAMES = 16
"""Maximum number of names listed in an error message."""


@dataclass(frozen=True)
class Library(Generic[T]):
    """A folder of TOML files of one kind, ``what``; ``make`` builds an object from the keys of a file.

    ``migrations`` convert the tables of each version to the next, up to ``schema``. Other packages add files through
    entry points in ``group``; each entry point names a package that contains ``NAME.toml``.
    """

    folder: Traversable
    what: str
    make: Callable[..., T]
    schema: int
    migrations: Migrations
    group: str = ""
    _cache: dict[str, tuple[str, T]] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Objects built so far, keyed by name, each with the text from which it was built."""

    @property
    def _plugins(self) -> Registry[ModuleType]:
        return Registry(self.group, {}, ModuleType)

    def names(self) -> tuple[str, ...]:
        """Return the names of the files, sorted and without their extension."""
        shipped = (file.name[:-5] for file in self.folder.iterdir() if file.name.endswith(".toml"))
        return tuple(sorted({*shipped, *(self._plugins if self.group else ())}))

    def text(self, name: str) -> str:
        """Return the text of a file; raise `DataError` with the nearest name if no file has that name."""
        names = self.names()
        if name not in names:
            near = nearest(name, names)
            known = ", ".join(names) if len(names) <= MAX_NAMES else f"of {len(names)}"
            raise DataError(
                self.what,
                value=name,
                limit=f"is not in the library ({known})",
                remedy=f"did you mean {near}?" if near else "use a name from the library, or the path of a .toml file",
            )
        file = self.folder / f"{name}.toml"
        if not file.is_file():
            file = files(self._plugins[name]) / f"{name}.toml"
        return file.read_text(encoding="utf-8")

    def shipped(self, name: str) -> T:
        """Return the shipped object with a given name; raise `DataError` with the nearest name if there is none."""
        text, cached = self.text(name), self._cache.get(name)
        if cached is None or cached[0] != text:
            cached = self._cache[name] = (text, self._build(text, f"{self.what} {name}"))
        return cached[1]

    def load(self, path: Path | str) -> T:
        """Return the object defined by a file; raise `DataError` if the file cannot be read, or is not valid."""
        return self._build(read_text(Path(path), DataError), str(path))

    def _build(self, text: str, what: str) -> T:
        data = parse_toml(text, what, DataError)
        data = migrated(data, what, current=self.schema, migrations=self.migrations, error=DataError)
        with error_context(what):
            return self.make(**data)

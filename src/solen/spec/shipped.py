"""Libraries of TOML files, such as resins, parts and printers: shipped files by name, and a user's files by path."""

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
"""Largest number of names that an error message lists."""


@dataclass(frozen=True)
class Library(Generic[T]):
    """A folder of TOML files; ``what`` names their kind, and ``make`` builds an object from the keys of a file.

    ``migrations`` convert the tables of each version to the next, up to ``schema``. Other packages add files through
    entry points in the ``group``; each entry point names a package that contains ``NAME.toml``.
    """

    folder: Traversable
    what: str
    make: Callable[..., T]
    schema: int
    migrations: Migrations
    group: str = ""
    _kept: dict[str, tuple[str, T]] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Objects already built, by name, each with the text from which it was built."""

    @property
    def _added(self) -> Registry[ModuleType]:
        return Registry(self.group, {}, ModuleType)

    def names(self) -> tuple[str, ...]:
        """Return the names of the files without their extension, sorted."""
        own = (file.name[:-5] for file in self.folder.iterdir() if file.name.endswith(".toml"))
        return tuple(sorted({*own, *(self._added if self.group else ())}))

    def text(self, name: str) -> str:
        """Return the text of a file; if no file has that name, raise `DataError` with the nearest name."""
        names = self.names()
        if name not in names:
            near = nearest(name, names)
            known = ", ".join(names) if len(names) <= MAX_NAMES else f"of {len(names)}"
            raise DataError(
                self.what,
                value=name,
                limit=f"not in the library ({known})",
                remedy=f"did you mean {near}?" if near else "the name of a file must end in .toml",
            )
        file = self.folder / f"{name}.toml"
        if not file.is_file():
            file = files(self._added[name]) / f"{name}.toml"
        return file.read_text(encoding="utf-8")

    def shipped(self, name: str) -> T:
        """Return the shipped object with a given name; if there is none, raise `DataError` with the nearest name."""
        text, kept = self.text(name), self._kept.get(name)
        if kept is None or kept[0] != text:
            kept = self._kept[name] = (text, self._made(text, f"{self.what} {name}"))
        return kept[1]

    def load(self, path: Path | str) -> T:
        """Return the object defined by a file; raise `DataError` if the file is unreadable, not TOML, or not valid."""
        return self._made(read_text(Path(path), DataError), str(path))

    def _made(self, text: str, what: str) -> T:
        data = parse_toml(text, what, DataError)
        data = migrated(data, what, current=self.schema, migrations=self.migrations, error=DataError)
        with error_context(what):
            return self.make(**data)

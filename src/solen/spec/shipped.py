"""Files that solen ships by name: resins, parts, and whatever comes in a folder of TOML files beside its reader."""

from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from types import ModuleType

from solen.errors import DataError
from solen.registry import Registry
from solen.spec.strict import nearest


@dataclass(frozen=True)
class ShippedFiles:
    """A folder of TOML files; ``what`` they are, in a word.

    Other packages add to it by entry points of the ``group``: each names a package that holds ``NAME.toml``.
    """

    folder: Traversable
    what: str
    group: str = ""

    @property
    def _added(self) -> Registry[ModuleType]:
        return Registry(self.group, {}, ModuleType)

    def names(self) -> tuple[str, ...]:
        """Names of the files without their ending, sorted."""
        own = (file.name[:-5] for file in self.folder.iterdir() if file.name.endswith(".toml"))
        return tuple(sorted({*own, *(self._added if self.group else ())}))

    def text(self, name: str) -> str:
        """Text of a file; `DataError` with the nearest name where there is none of that name."""
        names = self.names()
        if name not in names:
            near = nearest(name, names)
            raise DataError(
                self.what,
                value=name,
                limit=f"not in the library ({', '.join(names)})",
                remedy=f"did you mean {near}?" if near else "a file's name ends in .toml",
            )
        file = self.folder / f"{name}.toml"
        if not file.is_file():
            file = files(self._added[name]) / f"{name}.toml"
        return file.read_text(encoding="utf-8")

"""Files that solen ships by name: resins, parts, and whatever comes in a folder of TOML files beside its reader."""

from dataclasses import dataclass
from importlib.resources.abc import Traversable

from solen.errors import DataError
from solen.spec.strict import nearest


@dataclass(frozen=True)
class Shelf:
    """A folder of TOML files; ``what`` they are, in a word."""

    folder: Traversable
    what: str

    def names(self) -> tuple[str, ...]:
        """Names of the files without their ending, sorted."""
        return tuple(sorted(file.name[:-5] for file in self.folder.iterdir() if file.name.endswith(".toml")))

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
        return (self.folder / f"{name}.toml").read_text(encoding="utf-8")

"""Registries: dictionaries that other installed packages can extend.

The entries of solen are a plain dictionary in the module of the interface that they implement. Another package adds an
entry with a module, and an entry point of the registry's group in its ``pyproject.toml``::

    [project.entry-points."solen.instruments"]
    my-board = "mylab.board:MyBoard"

The other package is imported only when its entry is looked up.

Public names: `Registry`, `INSTRUMENTS`, `FORMATS`, `BODY_KINDS`, `PRINTERS` and `FINISHES`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeVar

from solen.errors import SolenError

INSTRUMENTS, FORMATS = "solen.instruments", "solen.formats"
BODY_KINDS, PRINTERS, FINISHES = "solen.body_kinds", "solen.printers", "solen.finishes"
GROUPS = (INSTRUMENTS, FORMATS, BODY_KINDS, PRINTERS, FINISHES)

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Registry(Mapping[str, T], Generic[T]):
    """Entries keyed by name: those of solen, and those that other packages add as entry points of a group.

    Parameters
    ----------
    group
        Group of the entry points.
    own
        The entries of solen.
    kind
        Type that an entry of another package must have, or from which it must be derived.

    Raises
    ------
    SolenError
        On access, if an entry of another package cannot be imported or has another type.
    """

    group: str
    own: dict[str, T]
    kind: type = object
    _loaded: dict[str, T] = field(default_factory=dict, init=False, repr=False)

    def __getitem__(self, name: str) -> T:
        if name in self.own:
            return self.own[name]
        if name not in self._loaded:
            self._loaded[name] = self._load(plugin_entries(self.group)[name])
        return self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self.own, *plugin_entries(self.group)]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in plugin_entries(self.group)

    def added(self) -> dict[str, T]:
        """Load and return the additions of other packages."""
        return {name: self[name] for name in plugin_entries(self.group) if name not in self.own}

    def _load(self, entry: EntryPoint) -> T:
        what = f"entry point {entry.name} of {self.group}"
        package = entry.dist.name if entry.dist is not None else entry.module
        try:
            loaded = entry.load()
        except Exception as bad:
            limit = f"cannot be imported: {type(bad).__name__}: {bad}"
            raise SolenError(what, value=entry.value, limit=limit, remedy=f"update or remove {package}") from bad
        fits = issubclass(loaded, self.kind) if isinstance(loaded, type) else isinstance(loaded, self.kind)
        if not fits:
            limit = f"must be a {self.kind.__name__}"
            raise SolenError(what, value=entry.value, limit=limit, remedy=f"update or remove {package}")
        return loaded  # type: ignore[no-any-return]  # its type has been checked


@cache
def plugin_entries(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group, keyed by name, without loading them."""
    return {entry.name: entry for entry in sorted(entry_points(group=group), key=lambda entry: entry.name)}

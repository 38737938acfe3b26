"""Edits of the text of a design file that change values but keep its comments, order and layout.

The edited text is returned only if reading it back gives exactly the changed design.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from solen.errors import SpecError
from solen.extras import need
from solen.spec.toml import loads, path_of, replaced_by, with_values


def edited(text: str, values: Mapping[str, Any], *, what: str = "design", folder: Path | None = None) -> str:
    """Return the text of a design file with some values changed, as `solen.spec.with_values` changes a design.

    Parameters
    ----------
    text
        Text of the design file.
    values
        New values by dotted key; None resets an optional key to its default.
    what, folder
        Name of the file in error messages, and base folder of its relative paths.

    Raises
    ------
    SpecError
        If the design would be invalid, or if the text cannot be edited to give this design.
    OutputError
        If tomlkit is not installed.
    """
    need("tomlkit", what=what, doing="keeping a file's comments")
    import tomlkit

    after = with_values(loads(text, what=what, folder=folder), values)
    document = tomlkit.parse(text)
    for key, value in values.items():
        if value is not None and (other := replaced_by(key)) and other not in values:
            _put(document, path_of(other), None)
        _put(document, path_of(key), value)
    written = tomlkit.dumps(document)
    if loads(written, what=what, folder=folder) != after:
        limit = f"{', '.join(values)} cannot be changed without affecting other values"
        raise SpecError(what, limit=limit, remedy="edit the file by hand")
    return written


def _put(container: Any, path: list[str], value: Any) -> None:
    """Set or remove the value of a key; create the tables on the path to it that are missing."""
    *parents, last = path
    for name in parents:
        entry = _entry(container, name)
        if entry is None:
            if value is None:
                return
            container[name] = {}
            entry = name
        container = container[entry]
    entry = _entry(container, last)
    if value is not None:
        container[last if entry is None else entry] = value
    elif entry is not None:
        del container[entry]


def _entry(container: Any, name: str) -> Any:
    """Return the key of a table entry or the index of a list entry, or None if there is no such entry."""
    if name.startswith("["):
        index = int(name[1:-1])
        return index if index < len(container) else None
    return name if name in container else None

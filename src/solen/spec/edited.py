"""Edit the text of a design file: change some values but keep its comments, order and layout.

The edited text is returned only if reading it back gives exactly the changed design.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from solen.errors import SpecError
from solen.extras import need
from solen.spec.toml import loads, path_of, replaced_by, with_values


def edited(text: str, values: Mapping[str, Any], *, what: str = "design", folder: Path | None = None) -> str:
    """Return the text of a design file with values changed by dotted keys, as `solen.spec.with_values` does.

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
        If the design would be invalid, or if the text cannot be edited to state it.
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
        limit = "cannot be changed there without changing more"
        raise SpecError(what, limit=limit, remedy="change the value in the file")
    return written


def _put(holder: Any, path: list[str], value: Any) -> None:
    """Set or remove the value of a key; missing tables on the path to it are created."""
    *ways, last = path
    for name in ways:
        inside = _inside(holder, name)
        if inside is None:
            if value is None:
                return
            holder[name] = {}
            inside = name
        holder = holder[inside]
    inside = _inside(holder, last)
    if value is not None:
        holder[last if inside is None else inside] = value
    elif inside is not None:
        del holder[inside]


def _inside(holder: Any, name: str) -> Any:
    """Return the key of an existing table or the index of an existing list entry, or None if it does not exist."""
    if name.startswith("["):
        place = int(name[1:-1])
        return place if place < len(holder) else None
    return name if name in holder else None

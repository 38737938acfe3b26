"""Text of a design file with some values changed; comments, order and layout are kept.

What is returned reads back as the changed design, or nothing is returned: that is checked.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from solen.errors import SpecError
from solen.extras import need
from solen.spec.toml import loads, path_of, replaced_by, with_values


def edited(text: str, values: Mapping[str, Any], *, what: str = "design", folder: Path | None = None) -> str:
    """Text of a design file with values set by dotted keys, as `solen.spec.with_values` sets them.

    Parameters
    ----------
    text
        The file's text.
    values
        Values by dotted key; None returns an optional key to its default.
    what, folder
        Name of the file in errors, and base of its relative paths.

    Raises
    ------
    SpecError
        If the design would be invalid, or the text cannot say it.
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
        raise SpecError(what, limit="cannot be changed there without changing more", remedy="change it in the file")
    return written


def _put(holder: Any, path: list[str], value: Any) -> None:
    """Set or remove a value; tables on the way are made."""
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
    """Key of a table or place of a list that is there; None where it is not."""
    if name.startswith("["):
        place = int(name[1:-1])
        return place if place < len(holder) else None
    return name if name in holder else None

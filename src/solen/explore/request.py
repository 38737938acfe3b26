"""The design and options of an exploration command, stored with its results so that no other command overwrites them.

Public name: `Request`.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from solen.errors import DataError, OutputError
from solen.explore.store import Variant, file_bytes
from solen.files import read_text
from solen.results import plain
from solen.spec import Design
from solen.spec.strict import Options

OUTPUT_ONLY = {"print_number"}
"""Options that only select additional output."""


class Request(NamedTuple):
    """Design and options of a command, and the file that stores them.

    Parameters
    ----------
    path
        The file, in the folder of the results.
    design, options
        The design and the options; files named in them are compared by their content.
    """

    path: Path
    design: Design
    options: Options

    def check(self) -> None:
        """Check that the folder contains no results of another request.

        Raises
        ------
        OutputError
            If the folder contains the results of another request; the message describes the difference.
        DataError
            If the file is damaged.
        """
        if not self.path.exists():
            return
        changes = list(_changes("", self._stored(), self._current()))
        if changes:
            more = f" and {len(changes) - 1} more" if changes[1:] else ""
            limit = f"contains the results of another request: {changes[0]}{more}"
            remedy = f"specify another --out, or remove {self.path.name} to replace them"
            raise OutputError(str(self.path.parent), limit=limit, remedy=remedy)

    @property
    def content(self) -> dict[Path, bytes]:
        """The file and its content."""
        return {self.path: (json.dumps(self._current(), indent=1) + "\n").encode()}

    def _current(self) -> dict[str, Any]:
        options = self.options.model_dump(mode="json", exclude_defaults=True, exclude=OUTPUT_ONLY)
        paths = {key: path for key in options if isinstance(path := getattr(self.options, key), Path)}
        digests = {key: hashlib.sha256(file_bytes(path)).hexdigest() for key, path in paths.items()}
        return {"design": plain(self.design), "options": options, "files": Variant(self.design).files | digests}

    def _stored(self) -> dict[str, Any]:
        try:
            stored = json.loads(read_text(self.path, DataError))
        except ValueError:
            stored = None
        if not isinstance(stored, dict):
            raise DataError(str(self.path), limit="is not a request of solen explore", remedy="remove it")
        return stored


def _changes(key: str, stored: Any, current: Any) -> Iterator[str]:
    """Yield descriptions of the differences between two values of a key."""
    if isinstance(stored, dict) and isinstance(current, dict):
        for name in {**stored, **current}:
            inner = name if key in {"", "design"} else f"{key}.{name}"
            yield from _changes(inner, stored.get(name), current.get(name))
    elif stored != current:
        yield f"{_option(key)} is {_value_text(stored)} in that request and {_value_text(current)} in this one"


def _option(key: str) -> str:
    return f"--{key.removeprefix('options.').replace('_', '-')}" if key.startswith("options.") else key


def _value_text(value: Any) -> str:
    """Format a value as the user specifies it."""
    if value is None:
        return "default"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return str(value)

"""The design and options of an exploration command, stored beside its results so that no other command overwrites them.

Public name: `Request`.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from solen.errors import DataError, OutputError
from solen.explore.store import Variant, bytes_of
from solen.files import read_text
from solen.results import plain
from solen.spec import Design
from solen.spec.strict import Options

NOT_OF_THE_TABLE = {"print_number"}
"""Options that only select additional output."""


class Request(NamedTuple):
    """Design and options of a command, and the file that stores them.

    Parameters
    ----------
    path
        The file, beside the results.
    design, options
        The design and the options; files named by them count by their content.
    """

    path: Path
    design: Design
    options: Options

    def check(self) -> None:
        """Check that the folder contains no results of another request.

        Raises
        ------
        OutputError
            If it does, with the difference.
        DataError
            If the file is damaged.
        """
        if not self.path.exists():
            return
        before = self._kept()
        changes = list(_changes("", before, self._stated()))
        if changes:
            more = f" and {len(changes) - 1} more" if changes[1:] else ""
            limit = f"contains the results of another request: {changes[0]}{more}"
            remedy = f"choose another --out, or remove {self.path.name} to replace them"
            raise OutputError(str(self.path.parent), limit=limit, remedy=remedy)

    @property
    def content(self) -> dict[Path, bytes]:
        """The file and its content."""
        return {self.path: (json.dumps(self._stated(), indent=1) + "\n").encode()}

    def _stated(self) -> dict[str, Any]:
        options = self.options.model_dump(mode="json", exclude_defaults=True, exclude=NOT_OF_THE_TABLE)
        named = {key: path for key in options if isinstance(path := getattr(self.options, key), Path)}
        digests = {key: hashlib.sha256(bytes_of(path)).hexdigest() for key, path in named.items()}
        return {"design": plain(self.design), "options": options, "files": Variant(self.design).files | digests}

    def _kept(self) -> dict[str, Any]:
        try:
            kept = json.loads(read_text(self.path, DataError))
        except ValueError:
            kept = None
        if not isinstance(kept, dict):
            raise DataError(str(self.path), limit="is not a request of solen explore", remedy="remove it")
        return kept


def _changes(key: str, before: Any, now: Any) -> Iterator[str]:
    """Describe the difference between two values of a key in words."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in {**before, **now}:
            inner = name if key in {"", "design"} else f"{key}.{name}"
            yield from _changes(inner, before.get(name), now.get(name))
    elif before != now:
        yield f"{_option(key)} is {_short(before)} there and {_short(now)} here"


def _option(key: str) -> str:
    return f"--{key.removeprefix('options.').replace('_', '-')}" if key.startswith("options.") else key


def _short(value: Any) -> str:
    """Format a value as it was specified, or as its default."""
    if value is None:
        return "default"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return str(value)

"""Tables of protocol and rig files."""

from pathlib import Path
from typing import ClassVar, TypeVar

from solen.errors import BenchError
from solen.files import read_text
from solen.spec.strict import Strict, error_context, migrated, parse_toml

SCHEMA = 1


class BenchTable(Strict):
    """A table of a protocol or rig file."""

    error: ClassVar[type[BenchError]] = BenchError


T = TypeVar("T", bound=BenchTable)


def load_table(path: Path, kind: type[T]) -> T:
    """Return the tables of a file; raise `BenchError` if it cannot be read or is invalid."""
    data = parse_toml(read_text(path, BenchError), str(path), BenchError)
    data = migrated(data, str(path), current=SCHEMA, migrations={}, error=BenchError)
    with error_context(str(path)):
        return kind(**data)

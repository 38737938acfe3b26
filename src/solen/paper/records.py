"""Finished figures: the panels of each figure, and the record that shows that a figure need not be made again.

A figure depends only on solen, which ships with all inputs. The record therefore contains one checksum of all files of
solen and one of each written file; if all of them still match, the figure is finished.

Public names: `select_figures`, `Record`, `read_record`, `record_text` and `code_sha256`.
"""

import hashlib
import json
import re
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar

import solen
from solen.errors import DataError, SolenError, SpecError
from solen.paper.statements import Comparison
from solen.results import plain
from solen.spec.strict import Strict

_NAME = re.compile(r"(S?\d+)(?:([A-Z])(?:-([A-Z]))?)?")
_PACKAGES = ("numpy", "scipy", "numba", "matplotlib", "shapely")
_ENDINGS = (".py", ".toml", ".html", ".csv")


class Drawing(Strict):
    """A drawing of a figure: its file, its alternative text, and its note on simulated data."""

    error: ClassVar[type[SolenError]] = DataError

    file: str
    alt: str
    mark: str


class Record(Strict):
    """Files and comparisons of a finished figure."""

    error: ClassVar[type[SolenError]] = DataError

    code: str
    drawings: tuple[Drawing, ...]
    sha256: dict[str, str]
    comparisons: tuple[dict[str, Any], ...]

    @property
    def compared(self) -> tuple[Comparison, ...]:
        """Comparisons of the figure with the paper."""
        return tuple(Comparison(**row) for row in self.comparisons)


def letters_of(name: str) -> set[str]:
    """Return the names of the panels of a figure: 3B, 3C and 3D for 3B-D."""
    number, first, last = _parts(name)
    return {f"{number}{chr(code)}" for code in range(ord(first), ord(last or first) + 1)} if first else {name}


def select_figures(names: Sequence[str], requests: Sequence[str]) -> tuple[str, ...]:
    """Return the figures that contain the requested ones: a letter (3C), a range (3B-D), or a whole figure (3).

    Raises
    ------
    SpecError
        If the paper has no such figure, or it cannot be computed.
    """
    selected: set[str] = set()
    for requested in requests:
        text = requested.strip().replace("–", "-").replace("s", "S")
        matching = {name for name in names if _matches(name, text)}
        if not matching:
            raise SpecError(
                "--figure",
                value=requested,
                limit="is not a figure that can be made",
                remedy=f"specify one of {', '.join(names)}",
            )
        selected |= matching
    return tuple(name for name in names if not requests or name in selected)


def _matches(name: str, text: str) -> bool:
    match = _NAME.fullmatch(text.upper())
    if match is None:
        return False
    number, first, _ = _parts(text.upper())
    same_number = number == _parts(name)[0]
    return same_number and (not first or not _parts(name)[1] or bool(letters_of(text.upper()) & letters_of(name)))


def _parts(name: str) -> tuple[str, str | None, str | None]:
    match = _NAME.fullmatch(name)
    if match is None:
        raise SpecError("figure", value=name, limit="is not written as 3, 3B or 3B-D")
    return match[1], match[2], match[3]


@cache
def code_sha256() -> str:
    """Return a checksum of solen, its data files, and the libraries that determine numbers and images."""
    folder = Path(solen.__file__).parent
    total = hashlib.sha256(repr([(name, version(name)) for name in _PACKAGES]).encode())
    for path in sorted(folder.rglob("*")):
        if path.suffix in _ENDINGS:
            total.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return total.hexdigest()


def read_record(path: Path) -> Record | None:
    """Return the record of a finished figure; None without a record, or if solen or a file of it has changed."""
    try:
        record = Record(**json.loads(path.read_text(encoding="utf-8")))
        unchanged = all(_sha256(path.parent / file) == sha256 for file, sha256 in record.sha256.items())
    except (OSError, ValueError, TypeError, SolenError):
        return None
    return record if unchanged and record.code == code_sha256() else None


def record_text(drawings: Sequence[Drawing], comparisons: Sequence[Comparison], contents: dict[str, bytes]) -> bytes:
    """Return the content of the record of a figure with these files, keyed by name."""
    data = {
        "code": code_sha256(),
        "drawings": [drawing.model_dump() for drawing in drawings],
        "sha256": {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()},
        "comparisons": plain(tuple(comparisons)),
    }
    return (json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()

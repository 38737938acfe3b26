"""Description of a file in an archive: its kind, checksum and quantities, determined with the readers of solen."""

import hashlib
import json
import mimetypes
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from solen.bench.protocol import load_protocol
from solen.bench.rig import load_rig
from solen.errors import DataError, SolenError
from solen.files import check_seal
from solen.material.resin import load_resin
from solen.parts import load_part
from solen.parts.printer import load_printer
from solen.ranks import Caution, prefixed, warning
from solen.recording import Recording, read
from solen.recording.column_roles import unit_of
from solen.results import Result, reported
from solen.spec import load as load_design

DESIGN, OTHER = "design", "other file"
IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".svg", ".pdf", ".webp", ".gif"}
VIDEOS = {".avi", ".mp4", ".mov", ".mkv"}
SOLIDS = {".stl", ".3mf", ".step", ".stp", ".obj", ".dxf"}
DOCUMENTS = {".md", ".txt", ".html", ".docx", ".odt", ".rst", ".ipynb", ".m", ".py"}
TABLES: tuple[tuple[str, Callable[[Path], Any]], ...] = (
    (DESIGN, load_design),
    ("resin", load_resin),
    ("rig", load_rig),
    ("protocol", load_protocol),
    ("printer", load_printer),
    ("part", load_part),
)
"""Kinds of TOML files, with the functions that read them."""


class Item(Result):
    """One file of an archive.

    Attributes
    ----------
    path
        Path within the archive, with forward slashes.
    kind
        ``design``, ``resin``, ``recording``, ``image``, another kind of solen file, or ``other file``.
    size_bytes, sha256
        Size and checksum of the file.
    media_type
        Media type, such as ``text/csv``.
    quantities
        Units of the columns of a recording, keyed by column; empty if the file contains none.
    simulated
        Whether the file states that its numbers were computed rather than measured.
    remark
        Why the file could not be read as the kind that its name suggests; otherwise empty.
    """

    path: str
    kind: str
    size_bytes: int
    sha256: str
    media_type: str
    quantities: Mapping[str, str]
    simulated: bool
    remark: str = ""


class Contents(Result):
    """Contents of an archive: name, description, licence (SPDX name or address), authors and files."""

    name: str
    description: str
    licence: str
    authors: tuple[str, ...]
    items: tuple[Item, ...]

    @reported
    def size_bytes(self) -> int:
        """Total size of all files after unpacking."""
        return sum(item.size_bytes for item in self.items)

    @reported
    def simulated(self) -> bool:
        """Whether any file states that its numbers were computed."""
        return any(item.simulated for item in self.items)

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Warnings for files that could not be read as the kind that their name suggests."""
        return tuple(prefixed(item.path, warning(item.remark)) for item in self.items if item.remark)


def described(file: Path, path: PurePosixPath) -> Item:
    """Return the description of a file that has a given path in an archive.

    Raises
    ------
    DataError
        If the file cannot be read, or its own checksum shows that it is damaged.
    """
    check_seal(file, DataError)
    kind, quantities, simulated, remark = _classified(file)
    size, sha256 = measured(file)
    media = mimetypes.guess_type(path.name, strict=False)[0] or "application/octet-stream"
    return Item(str(path), kind, size, sha256, media, quantities, simulated, remark)


def measured(file: Path) -> tuple[int, str]:
    """Return the size and SHA-256 checksum of a file; raise `DataError` if it cannot be read."""
    try:
        with file.open("rb") as opened:
            checksum = hashlib.file_digest(opened, "sha256").hexdigest()
        return file.stat().st_size, checksum
    except OSError as bad:
        limit = f"cannot be read: {bad.strerror or bad}"
        raise DataError(str(file), limit=limit, remedy="check the path and its permissions") from None


def _classified(file: Path) -> tuple[str, dict[str, str], bool, str]:
    """Return the kind, the units keyed by quantity, whether the file is simulated, and a remark."""
    suffix = file.suffix.lower()
    for kind, suffixes in (("image", IMAGES), ("video", VIDEOS), ("solid", SOLIDS), ("document", DOCUMENTS)):
        if suffix in suffixes:
            return kind, {}, "simulated" in file.name.lower(), ""
    if suffix == ".toml":
        return _of_toml(file)
    if suffix == ".json":
        return _of_json(file)
    try:
        return ("recording", *_of_recording(read(file)), "")
    except SolenError as bad:
        return OTHER, {}, False, str(bad)


def _of_recording(recording: Recording) -> tuple[dict[str, str], bool]:
    return {channel.name: unit_of(channel) for channel in recording.channels}, recording.provenance.simulated


def _of_toml(file: Path) -> tuple[str, dict[str, str], bool, str]:
    first_error = ""
    for kind, load in TABLES:
        try:
            loaded = load(file)
        except SolenError as bad:
            first_error = first_error or str(bad)
        else:
            return kind, {}, bool(getattr(loaded, "simulated", False)), ""
    return OTHER, {}, False, f"is not a design, resin, rig, protocol, printer or part; read as a design: {first_error}"


def _of_json(file: Path) -> tuple[str, dict[str, str], bool, str]:
    """Return the description of a JSON file; results of solen contain their kind."""
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as bad:
        return OTHER, {}, False, f"{file}; is not valid JSON: {bad}"
    if not isinstance(data, dict):
        return OTHER, {}, False, ""
    kind = data.get("kind", data.get("solen", "scene" if "solen_scene" in data else OTHER))
    return str(kind), {}, data.get("simulated") is True, ""

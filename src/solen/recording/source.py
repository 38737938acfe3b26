"""The bytes, checksum and text of a file.

Only valid text is accepted. Bytes that no instrument program writes, text that is only partly UTF-8, and control
characters show that the file is damaged or of another kind; the error names the line.

Public names: `load` and `Source`.
"""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from solen.errors import DataError
from solen.files import read_bytes

MAX_MB = 100
"""Largest file size in MB: no supported instrument exports larger files, and reading them could exhaust the memory."""

_ZIP, _OLE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
_OTHER_FORMATS = {
    b"SOLENJ": (
        "the journal of a run",
        "close it with solen bench recover, and use the recording that this command writes",
    ),
    b"%PDF": ("a PDF", "export a table from the program that wrote it"),
    b"\x1f\x8b": ("a gzip archive", "unpack it"),
    b"\x89PNG": ("an image", "use the table from which the figure was drawn"),
    b"\xff\xd8\xff": ("an image", "use the table from which the figure was drawn"),
}
_BINARY_FORMATS = {
    ".nc": "a netCDF",
    ".h5": "an HDF5",
    ".hdf5": "an HDF5",
    ".mat": "a MATLAB",
    ".tdms": "a TDMS",
    ".xls": "an Excel",
    ".xlsx": "an Excel",
}
_BREAK = re.compile("\r*\n|\r")  # a Windows line break may have been doubled in a transfer
_CONTROL = re.compile("[\x00-\x08\x0b\x0e-\x1f\x7f\x80-\x9f\u2028\u2029\ufffe\uffff\ufffd]")


@dataclass(frozen=True)
class Source:
    """A file's bytes and name.

    Attributes
    ----------
    path
        Path as specified by the user.
    data
        Bytes of the file.
    """

    path: Path
    data: bytes

    @property
    def name(self) -> str:
        """Name of the file without its folder."""
        return self.path.name

    @property
    def sha256(self) -> str:
        """Checksum of the bytes, in hexadecimal."""
        return hashlib.sha256(self.data).hexdigest()

    @property
    def is_archive(self) -> bool:
        """Whether the file is a zip archive, as an Excel workbook is."""
        return self.data.startswith(_ZIP)

    @property
    def is_old_workbook(self) -> bool:
        """Whether the file is an OLE compound file, as an .xls workbook is."""
        return self.data.startswith(_OLE)

    @property
    def padding(self) -> int:
        """Number of NUL bytes after the last line of text, left by a logger that reserves space."""
        content = self.data.rstrip(b"\0")
        reserved = content.endswith((b"\n", b"\r")) and b"\0" not in content
        return len(self.data) - len(content) if reserved else 0

    def error(self, location: str, limit: str, remedy: str, value: object = None) -> DataError:
        """Return an error that names the file and a location in it."""
        return DataError(f"{self.path}{', ' if location else ''}{location}", value=value, limit=limit, remedy=remedy)

    def lines(self) -> list[str]:
        """Return the lines of the text without line breaks; the last one is empty if the text ends with a break."""
        text = self.text()
        lines = _BREAK.split(text)
        bad = _CONTROL.search(text)
        if bad is not None:
            line = len(_BREAK.findall(text, 0, bad.start())) + 1
            limit = f"contains the character U+{ord(bad[0]):04X}, which is not allowed in a text file"
            raise self._not_text(line, limit, "export the file again")
        return lines

    def _not_text(self, line: int, limit: str, remedy: str) -> DataError:
        """Return the error for bytes that are neither text nor in the format suggested by the file name."""
        kind = _BINARY_FORMATS.get(self.path.suffix.lower())
        if kind is not None:
            return self.error("", f"is neither {kind} file nor text", "export or copy it again")
        return self.error(f"line {line}", limit, remedy)

    def text(self) -> str:
        """Return the text of the file, decoded as its bytes indicate: UTF-8, UTF-16 or Windows-1252."""
        data = self.data
        for start, (what, remedy) in _OTHER_FORMATS.items():
            if data.startswith(start):
                raise self.error("", f"is {what}", remedy)
        try:
            return self._decoded()
        except UnicodeDecodeError as bad:
            line = data.count(b"\n", 0, bad.start) + 1
            limit = "contains a byte that is not valid in UTF-8, UTF-16 or Windows-1252 text"
            raise self._not_text(line, limit, "save the file as UTF-8 text, or export it again") from None

    def _decoded(self) -> str:
        data = self.data[: len(self.data) - self.padding]
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            return data.decode("utf-16")
        sample = data[:4096]
        if sample[1::2].count(0) > len(sample) // 4:
            return data.decode("utf-16-le")
        if sample[::2].count(0) > len(sample) // 4:
            return data.decode("utf-16-be")
        try:
            return data.decode("utf-8-sig")
        except UnicodeDecodeError:
            if _has_utf8(data):  # damaged UTF-8 would give another text in any other encoding
                raise
        return data.decode("cp1252")


def load(path: Path) -> Source:
    """Read the bytes of a file; raise `DataError` if it is unreadable, empty or larger than `MAX_MB`."""
    data = read_bytes(path, DataError, max_mb=MAX_MB, remedy="export fewer channels or a shorter period")
    return Source(path, data)


def _has_utf8(data: bytes) -> bool:
    """Return whether the bytes contain a character that is encoded as several bytes in UTF-8."""
    return re.search(rb"[\xc2-\xdf][\x80-\xbf]|[\xe0-\xef][\x80-\xbf]{2}|[\xf0-\xf4][\x80-\xbf]{3}", data) is not None

"""A reader of the generic zip of UVtools, written from specifications by an author who had not seen the writer.

The specifications are the source of UVtools (`GenericZIPFile.cs`: `1.png` to `N.png`, numbered without a gap, and
`manifest.uvtools`, an XML file of ten elements) and that of PNG. A file that violates a rule is refused.
"""

import math
import re
import struct
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from tests.fabricate.goo_reader import need

MANIFEST = "manifest.uvtools"
STRINGS = ("CreatedBy", "UpdatedBy", "CreatedDate", "LastModifiedDate")
INTEGERS = ("ResolutionX", "ResolutionY")
LENGTHS = ("LayerHeight", "DisplayWidth", "DisplayHeight", "MachineZ")
SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Png:
    """An 8-bit grey image."""

    image: NDArray[np.uint8]
    """Grey levels (rows, columns)."""
    per_m: tuple[int, int] | None
    """Pixels per metre along x and y, if specified in the file."""


@dataclass(frozen=True)
class ZipStack:
    """An archive that satisfies all rules."""

    manifest: dict[str, Any]
    path: Path
    count: int

    @property
    def pixel_mm(self) -> tuple[float, float]:
        """Width and height of a pixel on the plate."""
        manifest = self.manifest
        width_mm, height_mm = manifest["DisplayWidth"], manifest["DisplayHeight"]
        return width_mm / manifest["ResolutionX"], height_mm / manifest["ResolutionY"]

    def layer(self, index: int) -> Png:
        """Return the image of a layer, counted from 0."""
        with ZipFile(self.path) as archive:
            png = read_png(archive.read(f"{index + 1}.png"))
        shape = self.manifest["ResolutionY"], self.manifest["ResolutionX"]
        need(png.image.shape == shape, f"layer {index} has {png.image.shape} pixels, not {shape}")
        if png.per_m:
            for dots, size in zip(png.per_m, self.pixel_mm, strict=True):
                need(abs(dots - 1e3 / size) <= 1, f"layer {index} has {dots} pixels per metre, not {1e3 / size}")
        return png

    @cached_property
    def areas_mm2(self) -> NDArray[np.float64]:
        """Covered area of each layer."""
        width, height = self.pixel_mm
        pixels = [self.layer(index).image.sum(dtype=np.int64) / 255 for index in range(self.count)]
        return np.array(pixels) * width * height


def read_zip(path: str | Path) -> ZipStack:
    """Read and check an archive; its images are read and checked on demand."""
    with ZipFile(path) as archive:
        names = archive.namelist()
        need(len(set(names)) == len(names), "a name occurs twice in the archive")
        need(archive.testzip() is None, "a checksum of the archive is incorrect")
        need(MANIFEST in names, f"{MANIFEST} is missing")
        for name in names[: names.index(MANIFEST)]:
            need(not name.endswith((".gcode", ".xml")), f"{name} before the manifest indicates another format")
        manifest = manifest_of(archive.read(MANIFEST))
        paths = [PurePosixPath(name) for name in names if re.fullmatch(r"\d+", PurePosixPath(name).stem)]
        numbers = sorted(int(path.stem) for path in paths if path.suffix == ".png")
        need(bool(numbers), "there is no layer")
        need(numbers == list(range(1, len(numbers) + 1)), "layers are not numbered from 1 without a gap")
        for number in numbers:
            need(f"{number}.png" in names, f"{number}.png is not at the top of the archive")
    need(len(numbers) * manifest["LayerHeight"] <= manifest["MachineZ"] * (1 + 1e-6), "higher than the printer")
    return ZipStack(manifest, Path(path), len(numbers))


def manifest_of(content: bytes) -> dict[str, Any]:
    root = ET.fromstring(content)  # noqa: S314 - written by the test
    need(root.tag == "Manifest", f"the root of the manifest is {root.tag}")
    texts = {child.tag: child.text or "" for child in root}
    need(len(texts) == len(root), "an element of the manifest occurs twice")
    need(set(texts) <= {*STRINGS, *INTEGERS, *LENGTHS}, f"the elements are {set(texts)}")
    for name in (*INTEGERS, *LENGTHS):
        need(name in texts, f"{name} is missing in the manifest")
    for name in INTEGERS:
        need(bool(re.fullmatch(r"\d+", texts[name])) and 0 < int(texts[name]) < 65536, f"{name} is {texts[name]!r}")
    for name in LENGTHS:
        need(bool(re.fullmatch(r"\d+(\.\d+)?([eE][-+]?\d+)?", texts[name])), f"{name} is {texts[name]!r}")
        need(0 < float(texts[name]) < math.inf, f"{name} is {texts[name]}")
    return {**texts, **{name: int(texts[name]) for name in INTEGERS}, **{name: float(texts[name]) for name in LENGTHS}}


def read_png(content: bytes) -> Png:
    """Read a PNG of one 8-bit grey channel, not interlaced and without colour management."""
    need(content.startswith(SIGNATURE), "not a PNG file")
    chunks = list(chunks_of(content))
    kinds = [kind for kind, _ in chunks]
    need(kinds[0] == b"IHDR" and kinds[-1] == b"IEND" and kinds.count(b"IHDR") == 1, f"chunks {kinds}")
    columns, rows, depth, colour, compression, filtering, interlace = struct.unpack(">IIBBBBB", chunks[0][1])
    need((depth, colour) == (8, 0), f"the PNG has depth {depth} and colour type {colour}")
    need((compression, filtering, interlace) == (0, 0, 0), "compression, filtering or interlacing is not 0")
    raw = zlib.decompress(b"".join(body for kind, body in chunks if kind == b"IDAT"))
    need(len(raw) == rows * (columns + 1), f"{len(raw)} bytes for {rows} rows of {columns} pixels")
    lines = np.frombuffer(raw, np.uint8).reshape(rows, columns + 1)
    need(
        not {b"tRNS", b"gAMA", b"sRGB", b"iCCP"} & set(kinds), f"some chunks change the meaning of grey levels: {kinds}"
    )
    return Png(unfiltered(lines), per_metre(dict(chunks).get(b"pHYs")))


def chunks_of(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    offset = len(SIGNATURE)
    while offset < len(content):
        need(offset + 12 <= len(content), "the PNG ends within a chunk")
        length, kind = struct.unpack_from(">I4s", content, offset)
        body = content[offset + 8 : offset + 8 + length]
        check = content[offset + 8 + length : offset + 12 + length]
        need(check == zlib.crc32(kind + body).to_bytes(4, "big"), f"the checksum of {kind!r} is incorrect")
        yield kind, body
        offset += 12 + length


def per_metre(body: bytes | None) -> tuple[int, int] | None:
    if body is None:
        return None
    x, y, unit = struct.unpack(">IIB", body)
    need(unit == 1, "pHYs has no unit")
    return x, y


def unfiltered(lines: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo the filter of each row according to the PNG specification, for one byte per pixel."""
    if not lines[:, 0].any():
        return lines[:, 1:]
    image = np.zeros((lines.shape[0] + 1, lines.shape[1] - 1), np.uint8)
    for row, line in enumerate(lines):
        above, filtered = image[row], line[1:]
        need(line[0] <= 4, f"row {row} has filter {line[0]}")
        image[row + 1] = FILTERS[line[0]](filtered, above)
    return image[1:]


def average(filtered: NDArray[np.uint8], above: NDArray[np.uint8]) -> list[int]:
    row = [0]
    for value, up in zip(filtered.tolist(), above.tolist(), strict=True):
        row.append(value + (row[-1] + up) // 2 & 255)
    return row[1:]


def paeth(filtered: NDArray[np.uint8], above: NDArray[np.uint8]) -> list[int]:
    row, corner = [0], 0
    for value, up in zip(filtered.tolist(), above.tolist(), strict=True):
        left = row[-1]
        prediction = left + up - corner
        nearest = min((left, up, corner), key=lambda candidate: abs(prediction - candidate))
        row.append(value + nearest & 255)
        corner = up
    return row[1:]


FILTERS = (
    lambda filtered, _: filtered,
    lambda filtered, _: np.cumsum(filtered, dtype=np.uint8),
    lambda filtered, above: filtered + above,
    average,
    paeth,
)

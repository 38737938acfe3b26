"""A reader of UVtools' generic zip, written from the formats' descriptions by somebody who had not seen the writer.

The descriptions: what UVtools' `GenericZIPFile.cs` reads (`1.png` … `N.png`, numbered without a gap, beside
`manifest.uvtools`, an XML of ten elements), and the PNG specification. Whatever breaks a rule is refused.
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
WORDS = ("CreatedBy", "UpdatedBy", "CreatedDate", "LastModifiedDate")
WHOLE = ("ResolutionX", "ResolutionY")
LENGTHS = ("LayerHeight", "DisplayWidth", "DisplayHeight", "MachineZ")
SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Png:
    """A grey image of eight bits."""

    image: NDArray[np.uint8]
    """Greys, shape (rows, columns)."""
    per_m: tuple[int, int] | None
    """Pixels in a metre, across and down, where the file states them."""


@dataclass(frozen=True)
class ZipStack:
    """A whole archive that keeps every rule."""

    manifest: dict[str, Any]
    path: Path
    count: int

    @property
    def pixel_mm(self) -> tuple[float, float]:
        """Width and height of a pixel on the plate."""
        of = self.manifest
        return of["DisplayWidth"] / of["ResolutionX"], of["DisplayHeight"] / of["ResolutionY"]

    def layer(self, index: int) -> Png:
        """The image of a layer, the first being 0."""
        with ZipFile(self.path) as archive:
            png = read_png(archive.read(f"{index + 1}.png"))
        shape = self.manifest["ResolutionY"], self.manifest["ResolutionX"]
        need(png.image.shape == shape, f"layer {index} has {png.image.shape} pixels, not {shape}")
        if png.per_m:
            for dots, size in zip(png.per_m, self.pixel_mm, strict=True):
                need(
                    abs(dots - 1e3 / size) <= 1,
                    f"layer {index}: {dots} pixels in a metre, not {1e3 / size}",
                )
        return png

    @cached_property
    def areas_mm2(self) -> NDArray[np.float64]:
        """Covered area of each layer."""
        width, height = self.pixel_mm
        pixels = [self.layer(index).image.sum(dtype=np.int64) / 255 for index in range(self.count)]
        return np.array(pixels) * width * height


def read_zip(path: str | Path) -> ZipStack:
    """Read and check an archive; its images are read and checked as they are asked for."""
    with ZipFile(path) as archive:
        names = archive.namelist()
        need(len(set(names)) == len(names), "a name stands twice in the archive")
        need(archive.testzip() is None, "a checksum of the archive is wrong")
        need(MANIFEST in names, f"no {MANIFEST}")
        for name in names[: names.index(MANIFEST)]:
            need(not name.endswith((".gcode", ".xml")), f"{name} before the manifest makes it another format")
        manifest = manifest_of(archive.read(MANIFEST))
        bare = [PurePosixPath(name) for name in names if re.fullmatch(r"\d+", PurePosixPath(name).stem)]
        numbers = sorted(int(name.stem) for name in bare if name.suffix == ".png")
        need(bool(numbers), "no layer")
        need(numbers == list(range(1, len(numbers) + 1)), "layers are not numbered from 1 without a gap")
        for number in numbers:
            need(f"{number}.png" in names, f"{number}.png is not at the archive's top")
    need(len(numbers) * manifest["LayerHeight"] <= manifest["MachineZ"] * (1 + 1e-6), "higher than the printer")
    return ZipStack(manifest, Path(path), len(numbers))


def manifest_of(content: bytes) -> dict[str, Any]:
    root = ET.fromstring(content)  # noqa: S314 - written by the test itself
    need(root.tag == "Manifest", f"the manifest's root is {root.tag}")
    texts = {child.tag: child.text or "" for child in root}
    need(len(texts) == len(root), "an element of the manifest stands twice")
    need(
        set(texts) <= {*WORDS, *WHOLE, *LENGTHS},
        f"elements {set(texts)}",
    )
    for name in (*WHOLE, *LENGTHS):
        need(name in texts, f"the manifest has no {name}")
    for name in WHOLE:
        need(bool(re.fullmatch(r"\d+", texts[name])) and 0 < int(texts[name]) < 65536, f"{name} is {texts[name]!r}")
    for name in LENGTHS:
        need(bool(re.fullmatch(r"\d+(\.\d+)?([eE][-+]?\d+)?", texts[name])), f"{name} is {texts[name]!r}")
        need(0 < float(texts[name]) < math.inf, f"{name} is {texts[name]}")
    return {**texts, **{name: int(texts[name]) for name in WHOLE}, **{name: float(texts[name]) for name in LENGTHS}}


def read_png(content: bytes) -> Png:
    """A PNG of one grey channel of eight bits, not interlaced: read as grey, it stays as it is."""
    need(content.startswith(SIGNATURE), "no PNG")
    chunks = list(chunks_of(content))
    kinds = [kind for kind, _ in chunks]
    need(kinds[0] == b"IHDR" and kinds[-1] == b"IEND" and kinds.count(b"IHDR") == 1, f"chunks {kinds}")
    columns, rows, depth, colour, packing, filtering, interlace = struct.unpack(">IIBBBBB", chunks[0][1])
    need((depth, colour) == (8, 0), f"a PNG of depth {depth} and colour type {colour}")
    need((packing, filtering, interlace) == (0, 0, 0), "packing, filtering or interlacing that is not 0")
    raw = zlib.decompress(b"".join(body for kind, body in chunks if kind == b"IDAT"))
    need(len(raw) == rows * (columns + 1), f"{len(raw)} bytes for {rows} rows of {columns} pixels")
    lines = np.frombuffer(raw, np.uint8).reshape(rows, columns + 1)
    need(not {b"tRNS", b"gAMA", b"sRGB", b"iCCP"} & set(kinds), f"chunks that change what a grey says: {kinds}")
    return Png(unfiltered(lines), per_metre(dict(chunks).get(b"pHYs")))


def chunks_of(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = len(SIGNATURE)
    while place < len(content):
        need(place + 12 <= len(content), "the PNG ends within a chunk")
        length, kind = struct.unpack_from(">I4s", content, place)
        body = content[place + 8 : place + 8 + length]
        check = content[place + 8 + length : place + 12 + length]
        need(check == zlib.crc32(kind + body).to_bytes(4, "big"), f"the checksum of {kind!r} is wrong")
        yield kind, body
        place += 12 + length


def per_metre(body: bytes | None) -> tuple[int, int] | None:
    if body is None:
        return None
    across, down, unit = struct.unpack(">IIB", body)
    need(unit == 1, "pHYs without a unit")
    return across, down


def unfiltered(lines: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Undo the filter of each row, as the PNG specification states them for one byte in a pixel."""
    if not lines[:, 0].any():
        return lines[:, 1:]
    image = np.zeros((lines.shape[0] + 1, lines.shape[1] - 1), np.uint8)
    for row, line in enumerate(lines):
        above, bare = image[row], line[1:]
        need(line[0] <= 4, f"row {row} has filter {line[0]}")
        image[row + 1] = FILTERS[line[0]](bare, above)
    return image[1:]


def averaged(bare: NDArray[np.uint8], above: NDArray[np.uint8]) -> list[int]:
    found = [0]
    for value, up in zip(bare.tolist(), above.tolist(), strict=True):
        found.append(value + (found[-1] + up) // 2 & 255)
    return found[1:]


def paeth(bare: NDArray[np.uint8], above: NDArray[np.uint8]) -> list[int]:
    found, corner = [0], 0
    for value, up in zip(bare.tolist(), above.tolist(), strict=True):
        left = found[-1]
        guess = left + up - corner
        nearest = min((left, up, corner), key=lambda candidate: abs(guess - candidate))
        found.append(value + nearest & 255)
        corner = up
    return found[1:]


FILTERS = (
    lambda bare, _: bare,
    lambda bare, _: np.cumsum(bare, dtype=np.uint8),
    lambda bare, above: bare + above,
    averaged,
    paeth,
)

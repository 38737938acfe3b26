"""Image files that are damaged or have wrong headers, assembled byte by byte."""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from tests.metrology.render.camera import jpeg, ome_tiff, png, tiff


def small_levels(seed: int = 0) -> np.ndarray:
    """Return a bright square on a dark background, with noise, 48 by 64 px."""
    levels = np.full((48, 64), 60.0)
    levels[12:36, 16:48] = 190.0
    return np.asarray(np.clip(levels + np.random.default_rng(seed).normal(0, 4, levels.shape), 0, 255).astype(np.uint8))


def _chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png_claiming(columns: int, rows: int, bits: int = 8, colour: int = 0) -> bytes:
    """Return a PNG whose header claims a size that its data do not have; all checksums are correct."""
    header = struct.pack(">IIBBBBB", columns, rows, bits, colour, 0, 0, 0)
    scale = _chunk(b"pHYs", struct.pack(">IIB", 500_000, 500_000, 1))
    content = zlib.compress(b"\0" * 1000)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + scale + _chunk(b"IDAT", content) + _chunk(b"IEND", b"")


def tiff_claiming(columns: int, rows: int, samples: int = 1, bits: int = 8, big: bool = False) -> bytes:
    """Return a TIFF of one strip whose tags claim a size; ``big`` selects big-endian byte order."""
    order = ">" if big else "<"
    tags = [(256, 4, columns), (257, 4, rows), (258, 3, bits), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, samples)]
    tags += [(278, 4, rows), (279, 4, 8)]
    header = (b"MM\0*" if big else b"II*\0") + struct.pack(order + "I", 16) + b"\0" * 8
    entries = b""
    for tag, kind, value in tags:
        packed = struct.pack(order + ("HH" if kind == 3 else "I"), *((value, 0) if kind == 3 else (value,)))
        entries += struct.pack(order + "HHI", tag, kind, 1) + packed
    return header + struct.pack(order + "H", len(tags)) + entries + struct.pack(order + "I", 0)


def jpeg_claiming(columns: int, rows: int) -> bytes:
    """Return a small JPEG whose frame header claims another size."""
    data = bytearray(jpeg(small_levels()))
    frame = data.index(b"\xff\xc0")
    data[frame + 5 : frame + 9] = struct.pack(">HH", rows, columns)
    return bytes(data)


def looped_tiff() -> bytes:
    """Return a TIFF whose list of pages is circular."""
    data = bytearray(tiff(small_levels(), 4.0))
    (first,) = struct.unpack("<I", data[4:8])
    (count,) = struct.unpack("<H", data[first : first + 2])
    pointer = first + 2 + 12 * count
    data[pointer : pointer + 4] = struct.pack("<I", first)
    return bytes(data)


def originals() -> dict[str, bytes]:
    """Return a small intact file of each format."""
    levels = small_levels()
    return {
        "whole.png": png(levels, 4.0),
        "whole.tif": tiff(levels, 4.0),
        "deflated.tif": tiff(levels, 4.0, compression="zlib"),
        "whole.ome.tif": ome_tiff(levels, 4.0),
        "whole.jpg": jpeg(levels),
    }


def mutations(data: bytes, count: int, rng: np.random.Generator) -> Iterator[bytes]:
    """Yield the file with a few bytes changed in its first or last 400, sometimes truncated or with a part repeated."""
    for _ in range(count):
        damaged = bytearray(data)
        for _ in range(rng.integers(1, 5)):
            distance = int(rng.integers(min(400, len(data))))
            position = distance if rng.random() < 0.5 else len(data) - 1 - distance
            damaged[position] = (0, 1, 127, 255, int(rng.integers(256)))[int(rng.integers(5))]
        kind = rng.integers(10)
        if kind == 0:
            damaged = damaged[: rng.integers(1, len(damaged))]
        elif kind == 1:
            cut = int(rng.integers(len(damaged)))
            damaged = damaged[:cut] + damaged[cut // 2 :]
        yield bytes(damaged)

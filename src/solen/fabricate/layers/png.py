"""A picture in grey as the bytes of a PNG file (W3C recommendation, third edition), with the size of its pixels.

Written by hand since nothing else is needed: one chunk of data, no filter, no date. The same picture gives the same
bytes wherever zlib is the same.
"""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

SIGNATURE = b"\x89PNG\r\n\x1a\n"
GREY_8_BITS = (8, 0, 0, 0, 0)
METRE = 1
BAND = 128
LEVEL = 6
"""How hard zlib tries."""


def as_png(image: NDArray[np.uint8], pitch_mm: float) -> bytes:
    """PNG of grey values (rows, columns), the first row at the top, of pixels with a side of ``pitch_mm``."""
    rows, columns = image.shape
    per_metre = round(1000.0 / pitch_mm)
    head = struct.pack(">IIBBBBB", columns, rows, *GREY_8_BITS)
    size = struct.pack(">IIB", per_metre, per_metre, METRE)
    chunks = (b"IHDR", head), (b"pHYs", size), (b"IDAT", _packed(image)), (b"IEND", b"")
    return SIGNATURE + b"".join(_chunk(kind, data) for kind, data in chunks)


def _packed(image: NDArray[np.uint8]) -> bytes:
    """Rows, each after a 0 for no filter, compressed some at a time."""
    packer = zlib.compressobj(LEVEL)
    packed = []
    for first in range(0, len(image), BAND):
        rows = image[first : first + BAND]
        packed.append(packer.compress(np.pad(rows, ((0, 0), (1, 0))).tobytes()))
    return b"".join([*packed, packer.flush()])


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

"""Frames that the studio sends: a header as JSON, and arrays as float32.

Byte 0 is the `VERSION`; bytes 4 to 7 are the length of the header in bytes, little-endian and a multiple of 4. The
header, padded with blanks, and the arrays follow. ``arrays`` in the header lists the name, rows and columns of each
array.
"""

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.results import plain

VERSION = 1
_HEAD = struct.Struct("<BxxxI")


def encoded(header: Mapping[str, Any], arrays: Mapping[str, NDArray[np.floating[Any]]] | None = None) -> bytes:
    """Encode a header and arrays (N,) or (N, columns) as a frame."""
    columns = {name: np.atleast_2d(np.asarray(array, dtype="<f4").T).T for name, array in (arrays or {}).items()}
    shapes = [[name, *array.shape] for name, array in columns.items()]
    text = json.dumps(plain({**header, "arrays": shapes}), allow_nan=False).encode("utf-8")
    text += b" " * (-len(text) % 4)
    return b"".join([_HEAD.pack(VERSION, len(text)), text, *(array.tobytes() for array in columns.values())])


def decoded(frame: bytes) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
    """Decode the header and the arrays (N, columns) of a frame; raise ValueError for another version."""
    version, size = _HEAD.unpack_from(frame)
    if version != VERSION:
        raise ValueError(f"the frame has version {version}; only version {VERSION} is supported")
    header = json.loads(frame[_HEAD.size : _HEAD.size + size])
    offset, arrays = _HEAD.size + size, {}
    for name, rows, columns in header.pop("arrays"):
        arrays[name] = np.frombuffer(frame, "<f4", rows * columns, offset).reshape(rows, columns)
        offset += 4 * rows * columns
    return header, arrays

"""Reader of binary and text STL files: triangles in mm, with identical corners merged.

An STL contains no unit, and its first word does not show whether it is text: a file whose size matches the number of
triangles in its header is binary, whatever its first word. Normals in the file are ignored; the order of the vertices
defines the outside.
"""

import re
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solen import files
from solen.errors import DataError
from solen.fabricate.mesh import Mesh
from solen.fabricate.meshfiles import STL_HEADER, TRIANGLE

Corners = NDArray[np.float32] | NDArray[np.float64]

MAX_MB = 500
"""Maximum file size."""
HEADER_SIZE = STL_HEADER + 4
VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
REMEDY = "export it again as STL"


def read_stl(path: Path) -> Mesh:
    """Read the mesh of an STL file in mm, without checking whether it is closed.

    Raises
    ------
    DataError
        If the file cannot be read, is not an STL, is truncated, has no triangles, or contains a number that is not
        finite.
    """
    data = files.read_bytes(path, DataError, max_mb=MAX_MB, remedy="reduce the number of triangles")
    corners = _binary(data, path) if _is_binary(data) else _text(data, path)
    if not len(corners):
        raise DataError(str(path), limit="contains no triangles", remedy=REMEDY)
    if not np.isfinite(corners).all():
        raise DataError(str(path), limit="is damaged: a vertex is not finite", remedy=REMEDY)
    vertices, triangles = _welded(corners.reshape(-1, 3))
    a, b, c = triangles.T
    distinct = (a != b) & (b != c) & (c != a)
    return Mesh(vertices.astype(np.float64), triangles if distinct.all() else triangles[distinct], 0.0)


def _welded(corners: Corners) -> tuple[Corners, NDArray[np.int64]]:
    """Return distinct points (N, 3), and the indices of the points of each triangle (M, 3)."""
    order = np.lexsort(corners.T).astype(np.int32)
    new = np.ones(len(order), bool)
    new[1:] = False
    for axis in range(3):
        coordinate = corners[order, axis]
        new[1:] |= coordinate[1:] != coordinate[:-1]
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(new) - 1
    return corners[order[new]], numbers.reshape(-1, 3)


def _is_binary(data: bytes) -> bool:
    is_complete = len(data) >= HEADER_SIZE and len(data) == _binary_size(data)
    return is_complete or not data.lstrip()[:5].lower().startswith(b"solid")


def _binary_size(data: bytes) -> int:
    """Return the size in bytes of a binary file according to the number of triangles in its header."""
    (count,) = struct.unpack_from("<I", data, STL_HEADER)
    return HEADER_SIZE + int(count) * TRIANGLE.itemsize


def _binary(data: bytes, path: Path) -> Corners:
    """Return corners (N, 3, 3) of a binary file."""
    if len(data) < HEADER_SIZE:
        raise DataError(str(path), limit=f"is not an STL: it has {len(data)} bytes", remedy=REMEDY)
    if len(data) != _binary_size(data):
        sizes = f"it has {len(data)} bytes, but its header requires {_binary_size(data)}"
        raise DataError(str(path), limit=f"is truncated, or not an STL: {sizes}", remedy=REMEDY)
    return np.frombuffer(data, TRIANGLE, offset=HEADER_SIZE)["corners"].astype(np.float32)


def _text(data: bytes, path: Path) -> Corners:
    """Return corners (N, 3, 3) of a text file."""
    corners = VERTEX.findall(data)
    if b"endsolid" not in data.lower() or len(corners) % 3:
        limit = f"is truncated, or not an STL: it has {len(corners)} corners"
        raise DataError(str(path), limit=limit, remedy=REMEDY)
    try:
        return np.array(corners, dtype=np.bytes_).astype(np.float64).reshape(-1, 3, 3)
    except ValueError:
        raise DataError(str(path), limit="is damaged: a coordinate is not a number", remedy=REMEDY) from None

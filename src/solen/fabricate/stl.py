"""STL reader for binary or text files: triangles in mm, with identical corners merged.

An STL contains no unit, and its first word does not show whether it is text: a file whose length matches its announced
number of triangles is binary, regardless of its first word. Normals in the file are ignored; the vertex order defines
the outside.
"""

import re
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solen.errors import DataError
from solen.fabricate.mesh import Mesh
from solen.fabricate.meshfiles import STL_HEADER, TRIANGLE

Corners = NDArray[np.float32] | NDArray[np.float64]

MAX_MB = 500
"""Maximum file size."""
COUNT = STL_HEADER + 4
VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
REMEDY = "export it again as STL"


def read_stl(path: Path) -> Mesh:
    """Read the mesh of an STL file, interpreting its numbers as mm, without checking whether it is closed.

    Raises
    ------
    DataError
        If the file cannot be read, is not an STL, is truncated, or contains no triangle or a number that is not finite.
    """
    data = _bytes(path)
    corners = _binary(data, path) if _is_binary(data) else _text(data, path)
    if not len(corners):
        raise DataError(str(path), value="no triangle", limit="is empty", remedy=REMEDY)
    if not np.isfinite(corners).all():
        raise DataError(str(path), value="a vertex that is not finite", limit="is damaged", remedy=REMEDY)
    vertices, triangles = _welded(corners.reshape(-1, 3))
    a, b, c = triangles.T
    whole = (a != b) & (b != c) & (c != a)
    return Mesh(vertices.astype(np.float64), triangles if whole.all() else triangles[whole], 0.0)


def _welded(corners: Corners) -> tuple[Corners, NDArray[np.int64]]:
    """Return distinct points (N, 3), and their indices for each triangle (M, 3)."""
    order = np.lexsort(corners.T).astype(np.int32)
    new = np.ones(len(order), bool)
    new[1:] = False
    for axis in range(3):
        one = corners[order, axis]
        new[1:] |= one[1:] != one[:-1]
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(new) - 1
    return corners[order[new]], numbers.reshape(-1, 3)


def _bytes(path: Path) -> bytes:
    try:
        size_mb = path.stat().st_size / 1e6
        if size_mb > MAX_MB:
            raise DataError(
                str(path),
                value=f"{size_mb:.0f} MB",
                limit=f"must be at most {MAX_MB} MB",
                remedy="reduce its triangles",
            )
        return path.read_bytes()
    except FileNotFoundError:
        raise DataError(str(path), limit="no such file", remedy="check the path") from None
    except (OSError, ValueError) as bad:
        reason = getattr(bad, "strerror", None) or bad
        raise DataError(str(path), limit=f"cannot be read: {reason}", remedy="check its name and permissions") from None


def _is_binary(data: bytes) -> bool:
    if len(data) >= COUNT:
        (count,) = struct.unpack_from("<I", data, STL_HEADER)
        if len(data) == COUNT + count * TRIANGLE.itemsize:
            return True
    return not data.lstrip()[:5].lower().startswith(b"solid")


def _binary(data: bytes, path: Path) -> Corners:
    """Return corners (N, 3, 3) of a binary file, unchanged."""
    if len(data) < COUNT:
        raise DataError(str(path), value=f"{len(data)} bytes", limit="is not an STL", remedy=REMEDY)
    (count,) = struct.unpack_from("<I", data, STL_HEADER)
    announced = COUNT + count * TRIANGLE.itemsize
    if len(data) != announced:
        limit = f"announces {count} triangles, which require {announced} bytes: it is truncated, or not an STL"
        raise DataError(str(path), value=f"{len(data)} bytes", limit=limit, remedy=REMEDY)
    return np.frombuffer(data, TRIANGLE, offset=COUNT)["corners"].astype(np.float32)


def _text(data: bytes, path: Path) -> Corners:
    """Return corners (N, 3, 3) of a text file."""
    corners = VERTEX.findall(data)
    if b"endsolid" not in data.lower() or len(corners) % 3:
        raise DataError(str(path), value=f"{len(corners)} corners", limit="is truncated, or not an STL", remedy=REMEDY)
    try:
        return np.array(corners, dtype=np.bytes_).astype(np.float64).reshape(-1, 3, 3)
    except ValueError:
        raise DataError(
            str(path), value="a vertex coordinate that is not a number", limit="is damaged", remedy=REMEDY
        ) from None

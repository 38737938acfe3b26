"""Exact pixel coverage by an area, from the corners of its outlines.

The method is that of font rasterisers. An edge is cut wherever it crosses pixel borders, so each segment is in one
pixel. A segment changes the covered area of its pixel by the area between the segment and the pixel's right side, and
that of all pixels farther right in the row by its full height. Summed from left to right, these changes are the covered
areas. Nothing is sampled; the cost of an edge is proportional to the number of pixels that it crosses.

`coverage` returns fractions from 0 to 1, `coverage_bytes` returns them as 0 to 255 using little memory, and `rings_of`
returns the rings of a shapely area. Rows count upwards with y and columns with x: [i, j] is the square whose lower left
corner is ``origin + (j, i) pitch``; pixels may be rectangles.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.fabricate.grey import FULL

if TYPE_CHECKING:
    import shapely.geometry.base


Pitch = float | tuple[float, float]
"""Side of a square pixel in mm, or its sides along x and y."""

BAND = 64
"""Number of rows summed at a time: few enough to stay in a processor cache."""


@dataclass(frozen=True)
class Grid:
    """Pixel grid: side or sides of a pixel, lower left corner of the first pixel, and numbers of rows and columns."""

    pitch_mm: Pitch
    origin_mm: tuple[float, float]
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.pitch_mm).all() and np.min(self.pitch_mm) > 0.0):
            raise DataError("pixel pitch", value=self.pitch_mm, limit="must be above 0 mm")
        if not np.isfinite(self.origin_mm).all():
            raise DataError("origin of the pixels", value=self.origin_mm, limit="must be finite, in mm")
        if min(self.shape) < 1:
            raise DataError("pixels", value=self.shape, limit="must be at least one row and one column")

    def placed(self, ring: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm as coordinates in columns and rows."""
        return (np.asarray(ring, float) - self.origin_mm) / self.pitch_mm


@dataclass(frozen=True)
class Pieces:
    """Edges cut at pixel borders, by ascending row: their descent, and its fraction that counts for their pixel."""

    row: IntArray
    column: IntArray
    climb: FloatArray
    own: FloatArray

    def summed(self, first: int, last: int, columns: int) -> FloatArray:
        """Return covered fractions (last - first, columns) of the given rows."""
        chosen = slice(*np.searchsorted(self.row, [first, last]))
        at = (self.row[chosen] - first) * (columns + 1) + self.column[chosen]
        climb, own = self.climb[chosen], self.climb[chosen] * self.own[chosen]
        places, changes = np.concatenate([at, at + 1]), np.concatenate([own, climb - own])
        change = np.bincount(places, changes, (last - first) * (columns + 1) + 1)[:-1]
        cells = change.reshape(last - first, columns + 1)
        np.cumsum(cells, axis=1, out=cells)
        return np.clip(cells[:, :columns], 0.0, 1.0)


def coverage(
    rings: Sequence[FloatArray], pitch_mm: Pitch, origin_mm: tuple[float, float], shape: tuple[int, int]
) -> FloatArray:
    """Return the fraction of each pixel covered by closed polygons.

    Parameters
    ----------
    rings
        Polygons (N, 2) in mm, counter-clockwise with the area on their left, holes clockwise; the last point may repeat
        the first. They must not overlap. Areas beyond the grid are ignored.
    pitch_mm, origin_mm, shape
        Side of a pixel or its sides along x and y, lower left corner of the first pixel, and rows and columns.

    Returns
    -------
    shares
        Shape ``shape``, 0 to 1; exact up to a rounding error of about 1e-15 times the number of columns.

    Raises
    ------
    DataError
        If the grid is empty or invalid, or a point is not finite.
    """
    grid = Grid(pitch_mm, origin_mm, shape)
    pieces, shares = _pieces(rings, grid), np.empty(shape)
    for first, last in _bands(0, shape[0]):
        shares[first:last] = pieces.summed(first, last, shape[1])
    return shares


def coverage_bytes(
    rings: Sequence[FloatArray], pitch_mm: Pitch, origin_mm: tuple[float, float], shape: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return `coverage` as grey levels 0 to 255, rounded to the nearest, using memory for only a few rows."""
    grid, shares = Grid(pitch_mm, origin_mm, shape), np.zeros(shape, np.uint8)
    rings = [ring for ring in rings if len(ring)]
    if not rings:
        return shares
    low, high = _extent(rings, grid)
    rows, columns = high - low
    if rows <= 0 or columns <= 0:
        return shares
    x, y = (np.asarray(origin_mm) + low[::-1] * np.asarray(pitch_mm)).tolist()
    window = shares[low[0] : high[0], low[1] : high[1]]
    pieces = _pieces(rings, Grid(pitch_mm, (x, y), (rows, columns)))
    for first, last in _bands(0, rows):
        window[first:last] = np.rint(FULL * pieces.summed(first, last, columns))
    return shares


def rings_of(area: "shapely.geometry.base.BaseGeometry") -> list[FloatArray]:
    """Return the rings of a shapely area as required by `coverage`; lines and points are ignored."""
    import shapely

    polygons = [get_part for get_part in shapely.get_parts(area).tolist() if isinstance(get_part, shapely.Polygon)]
    turned = (shapely.geometry.polygon.orient(polygon) for polygon in polygons if not polygon.is_empty)
    return [np.asarray(ring.coords)[:, :2] for one in turned for ring in (one.exterior, *one.interiors)]


def _bands(first: int, last: int) -> Iterator[tuple[int, int]]:
    return ((row, min(row + BAND, last)) for row in range(first, last, BAND))


def _extent(rings: Sequence[FloatArray], grid: Grid) -> tuple[IntArray, IntArray]:
    """Return the first and last + 1 (row, column) of the part of the grid that polygons touch."""
    placed = [grid.placed(ring) for ring in rings]
    low, high = (
        np.min([points.min(axis=0) for points in placed], axis=0),
        np.max([points.max(axis=0) for points in placed], axis=0),
    )
    if not np.isfinite([low, high]).all():
        raise DataError("outline", value="a point that is not finite", limit="must be in mm")
    limits = np.array(grid.shape)
    return (
        np.clip(np.floor(low[::-1]), 0, limits).astype(np.int64),
        np.clip(np.ceil(high[::-1]), 0, limits).astype(np.int64),
    )


def _pieces(rings: Sequence[FloatArray], grid: Grid) -> Pieces:
    """Return polygon edges, cut at the sides of pixels."""
    rows, columns = grid.shape
    starts, ends = _edges([grid.placed(ring) for ring in rings])
    begin, end = _cut(starts, ends, rows, columns)
    middle = 0.5 * (begin + end)
    inside = (middle[:, 1] > 0.0) & (middle[:, 1] < rows) & (middle[:, 0] < columns)
    begin, end, middle = begin[inside], end[inside], middle[inside]
    row, column = np.floor(middle[:, 1]).astype(np.int64), np.floor(middle[:, 0]).astype(np.int64)
    own = np.where(column < 0, 1.0, column + 1.0 - middle[:, 0])
    order = np.argsort(row, kind="stable")
    climb = begin[:, 1] - end[:, 1]  # a descending side has the area on its left, which is to its right in the row
    return Pieces(row[order], np.maximum(column, 0)[order], climb[order], own[order])


def _edges(placed: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends (N, 2) of the sides of closed polygons, without horizontal sides, which do not matter."""
    starts = np.vstack([np.empty((0, 2)), *placed])
    ends = np.vstack([np.empty((0, 2)), *(np.roll(ring, -1, axis=0) for ring in placed)])
    if not np.isfinite(starts).all():
        raise DataError("outline", value="a point that is not finite", limit="must be in mm")
    climbs = starts[:, 1] != ends[:, 1]
    return starts[climbs], ends[climbs]


def _cut(starts: FloatArray, ends: FloatArray, rows: int, columns: int) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends (M, 2) of edge segments between grid lines."""
    count = len(starts)
    across, up = (_crossings(starts, ends, axis, most) for axis, most in ((0, columns), (1, rows)))
    edge = np.concatenate([np.arange(count), across[0], up[0], np.arange(count)])
    share = np.concatenate([np.zeros(count), across[1], up[1], np.ones(count)])
    points = np.concatenate([starts, across[2], up[2], ends])
    order = np.lexsort((share, edge))
    edge, points = edge[order], points[order]
    same = edge[:-1] == edge[1:]
    return points[:-1][same], points[1:][same]


def _crossings(starts: FloatArray, ends: FloatArray, axis: int, most: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Crossings of edges with the lines 0 to ``most`` of an axis: edge number, fraction of the edge length, point."""
    low = np.clip(np.ceil(np.minimum(starts[:, axis], ends[:, axis])), 0, most + 1).astype(np.int64)
    high = np.clip(np.floor(np.maximum(starts[:, axis], ends[:, axis])), -1, most).astype(np.int64)
    number = np.maximum(high - low + 1, 0)
    number[starts[:, axis] == ends[:, axis]] = 0
    edge = np.repeat(np.arange(len(starts)), number)
    line = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number) + low[edge]
    begin, way = starts[edge], ends[edge] - starts[edge]
    share = np.clip((line - begin[:, axis]) / way[:, axis], 0.0, 1.0)
    points = begin + share[:, None] * way
    points[:, axis] = line
    return edge, share, points

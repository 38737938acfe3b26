"""Exact pixel coverage by an area, from the corners of its outlines.

The method is that of font rasterisers. An edge is divided where it crosses pixel borders, so that each segment is in
one pixel. A segment changes the covered area of its pixel by the area between the segment and the right side of the
pixel, and that of all pixels farther right in the row by its full height. Summed from left to right, these changes are
the covered areas. Nothing is sampled; the cost of an edge is proportional to the number of pixels that it crosses.

`coverage` returns fractions from 0 to 1, `coverage_bytes` returns levels from 0 to 255 and uses little memory, and
`rings_of` returns the rings of a shapely area. Rows increase with y and columns with x: the lower left corner of pixel
[i, j] is ``origin + (j, i) pitch``. Pixels may be rectangles.
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
"""Number of rows that are summed at a time: few enough to fit into a processor cache."""


@dataclass(frozen=True)
class Grid:
    """Grid of pixels: the size of a pixel, lower left corner of the first pixel, and numbers of rows and columns."""

    pitch_mm: Pitch
    origin_mm: tuple[float, float]
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.pitch_mm).all() and np.min(self.pitch_mm) > 0.0):
            raise DataError("pixel pitch", value=self.pitch_mm, limit="must be above 0 mm")
        if not np.isfinite(self.origin_mm).all():
            raise DataError("origin of the pixels", value=self.origin_mm, limit="must be finite, in mm")
        if min(self.shape) < 1:
            raise DataError("pixels", value=self.shape, limit="must have at least one row and one column")

    def in_pixels(self, ring: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm as coordinates in columns and rows."""
        return (np.asarray(ring, float) - self.origin_mm) / self.pitch_mm


@dataclass(frozen=True)
class EdgeSegments:
    """Segments of edges between pixel borders, in ascending order of rows.

    ``descent`` is the height by which a segment descends, in pixels, and ``fraction`` the part of it that covers the
    segment's own pixel; the remainder covers the next pixel.
    """

    row: IntArray
    column: IntArray
    descent: FloatArray
    fraction: FloatArray

    def summed(self, first: int, last: int, columns: int) -> FloatArray:
        """Return covered fractions (last - first, columns) of the rows from ``first`` to ``last`` - 1."""
        chosen = slice(*np.searchsorted(self.row, [first, last]))
        index = (self.row[chosen] - first) * (columns + 1) + self.column[chosen]
        descent, own = self.descent[chosen], self.descent[chosen] * self.fraction[chosen]
        indices, changes = np.concatenate([index, index + 1]), np.concatenate([own, descent - own])
        change = np.bincount(indices, changes, (last - first) * (columns + 1) + 1)[:-1]
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
        Polygons (N, 2) in mm, counter-clockwise, and holes, clockwise; the last point may repeat the first. They must
        not overlap. Areas outside the grid are ignored.
    pitch_mm, origin_mm, shape
        Size of a pixel, lower left corner of the first pixel, and numbers of rows and columns.

    Returns
    -------
    fractions
        Shape ``shape``, 0 to 1; exact up to a rounding error of about 1e-15 times the number of columns.

    Raises
    ------
    DataError
        If the grid is empty or invalid, or a point is not finite.
    """
    grid = Grid(pitch_mm, origin_mm, shape)
    segments, fractions = _segments(rings, grid), np.empty(shape)
    for first, last in _bands(shape[0]):
        fractions[first:last] = segments.summed(first, last, shape[1])
    return fractions


def coverage_bytes(
    rings: Sequence[FloatArray], pitch_mm: Pitch, origin_mm: tuple[float, float], shape: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return `coverage` rounded to grey levels from 0 to 255; only a few rows are in memory as floats."""
    grid, levels = Grid(pitch_mm, origin_mm, shape), np.zeros(shape, np.uint8)
    rings = [ring for ring in rings if len(ring)]
    if not rings:
        return levels
    low, high = _extent(rings, grid)
    rows, columns = high - low
    if rows <= 0 or columns <= 0:
        return levels
    x, y = (np.asarray(origin_mm) + low[::-1] * np.asarray(pitch_mm)).tolist()
    window = levels[low[0] : high[0], low[1] : high[1]]
    segments = _segments(rings, Grid(pitch_mm, (x, y), (rows, columns)))
    for first, last in _bands(rows):
        window[first:last] = np.rint(FULL * segments.summed(first, last, columns))
    return levels


def rings_of(area: "shapely.geometry.base.BaseGeometry") -> list[FloatArray]:
    """Return the rings of a shapely area, oriented for `coverage`; lines and points are ignored."""
    import shapely

    parts = [part for part in shapely.get_parts(area).tolist() if isinstance(part, shapely.Polygon)]
    polygons = (shapely.geometry.polygon.orient(part) for part in parts if not part.is_empty)
    return [np.asarray(ring.coords)[:, :2] for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]


def _bands(rows: int) -> Iterator[tuple[int, int]]:
    return ((first, min(first + BAND, rows)) for first in range(0, rows, BAND))


def _extent(rings: Sequence[FloatArray], grid: Grid) -> tuple[IntArray, IntArray]:
    """Return the first (row, column) and the last + 1 of the part of the grid that polygons touch."""
    points = grid.in_pixels(np.vstack(rings))
    low, high = points.min(axis=0), points.max(axis=0)
    if not np.isfinite([low, high]).all():
        raise DataError("outline", limit="contains a point that is not finite")
    limits = np.array(grid.shape)
    return (
        np.clip(np.floor(low[::-1]), 0, limits).astype(np.int64),
        np.clip(np.ceil(high[::-1]), 0, limits).astype(np.int64),
    )


def _segments(rings: Sequence[FloatArray], grid: Grid) -> EdgeSegments:
    """Return the edges of polygons, divided at pixel borders."""
    rows, columns = grid.shape
    starts, ends = _edges([grid.in_pixels(ring) for ring in rings])
    begin, end = _cut(starts, ends, rows, columns)
    middle = 0.5 * (begin + end)
    inside = (middle[:, 1] > 0.0) & (middle[:, 1] < rows) & (middle[:, 0] < columns)
    begin, end, middle = begin[inside], end[inside], middle[inside]
    row, column = np.floor(middle[:, 1]).astype(np.int64), np.floor(middle[:, 0]).astype(np.int64)
    fraction = np.where(column < 0, 1.0, column + 1.0 - middle[:, 0])
    order = np.argsort(row, kind="stable")
    descent = begin[:, 1] - end[:, 1]  # the area is on the left of an edge
    return EdgeSegments(row[order], np.maximum(column, 0)[order], descent[order], fraction[order])


def _edges(rings: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends (N, 2) of the edges of closed polygons, without horizontal edges, which do not matter."""
    starts = np.vstack([np.empty((0, 2)), *rings])
    ends = np.vstack([np.empty((0, 2)), *(np.roll(ring, -1, axis=0) for ring in rings)])
    if not np.isfinite(starts).all():
        raise DataError("outline", limit="contains a point that is not finite")
    relevant = starts[:, 1] != ends[:, 1]
    return starts[relevant], ends[relevant]


def _cut(starts: FloatArray, ends: FloatArray, rows: int, columns: int) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends (M, 2) of the segments of edges between grid lines."""
    count = len(starts)
    x, y = (_crossings(starts, ends, axis, last) for axis, last in ((0, columns), (1, rows)))
    edge = np.concatenate([np.arange(count), x[0], y[0], np.arange(count)])
    fraction = np.concatenate([np.zeros(count), x[1], y[1], np.ones(count)])
    points = np.concatenate([starts, x[2], y[2], ends])
    order = np.lexsort((fraction, edge))
    edge, points = edge[order], points[order]
    same = edge[:-1] == edge[1:]
    return points[:-1][same], points[1:][same]


def _crossings(starts: FloatArray, ends: FloatArray, axis: int, last: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return edge number, fraction of the edge, and point of each crossing with the grid lines 0 to ``last``."""
    low = np.clip(np.ceil(np.minimum(starts[:, axis], ends[:, axis])), 0, last + 1).astype(np.int64)
    high = np.clip(np.floor(np.maximum(starts[:, axis], ends[:, axis])), -1, last).astype(np.int64)
    number = np.maximum(high - low + 1, 0)
    number[starts[:, axis] == ends[:, axis]] = 0
    edge = np.repeat(np.arange(len(starts)), number)
    line = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number) + low[edge]
    begin, vector = starts[edge], ends[edge] - starts[edge]
    fraction = np.clip((line - begin[:, axis]) / vector[:, axis], 0.0, 1.0)
    points = begin + fraction[:, None] * vector
    points[:, axis] = line
    return edge, fraction, points

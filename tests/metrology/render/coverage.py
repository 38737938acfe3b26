"""How much of each pixel a polygon covers, exactly.

The image is made from areas, never from a distance to an edge or an error function, so that what measures it inverts
nothing. Pixel (row i, column j) is the square j <= u < j + 1, i <= v < i + 1; u runs to the right and v down.

Each side of the polygon is cut where it crosses the lines of the grid. A piece lies then in one pixel, and the area to
its right is a trapezium in that pixel and its whole height in every pixel further right: a running sum over the columns
adds them up.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray


def coverage(rings: Sequence[FloatArray], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Share (rows, columns) of each pixel within closed polygons (N, 2) of (u, v) px, holes running the other way."""
    rows, columns = shape
    right_of = np.zeros((rows, columns + 1))
    first, last = rows, 0
    for ring in rings:
        start, end = _pieces(ring)
        middle, height = 0.5 * (start + end), end[:, 1] - start[:, 1]
        row, column = np.floor(middle[:, 1]).astype(int), np.floor(middle[:, 0]).astype(int)
        within = np.where(column < 0, 1.0, 1.0 - (middle[:, 0] - column))  # all that lies left of the image counts
        seen = (row >= 0) & (row < rows) & (column < columns)
        row, column, within, height = row[seen], np.maximum(column[seen], 0), within[seen], height[seen]
        first, last = min(first, int(row.min(initial=rows))), max(last, int(row.max(initial=-1)) + 1)
        np.add.at(right_of, (row, column), height * within)
        np.add.at(right_of, (row, column + 1), height * (1.0 - within))
    covered = np.zeros(shape)
    covered[first:last] = np.abs(np.cumsum(right_of[first:last], axis=1)[:, :columns])
    return covered


def _pieces(ring: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Starts and ends (M, 2) of the sides, cut at every line of the grid that they cross."""
    closed = ring if np.array_equal(ring[0], ring[-1]) else np.vstack([ring, ring[:1]])
    start, step = closed[:-1], np.diff(closed, axis=0)
    sides, shares = [np.arange(len(start)), np.arange(len(start))], [np.zeros(len(start)), np.ones(len(start))]
    for axis in (0, 1):
        side, share = _crossings(start[:, axis], step[:, axis])
        sides.append(side)
        shares.append(share)
    order = np.lexsort((share := np.concatenate(shares), side := np.concatenate(sides)))
    points = start[side[order]] + share[order, None] * step[side[order]]
    same = side[order][1:] == side[order][:-1]
    return points[:-1][same], points[1:][same]


def _crossings(start: NDArray[np.float64], step: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Which sides cross whole numbers, and at what share of their length."""
    low, high = np.minimum(start, start + step), np.maximum(start, start + step)
    first = np.floor(low).astype(int) + 1
    count = np.maximum(np.ceil(high).astype(int) - first, 0)
    side = np.repeat(np.arange(len(start)), count)
    whole = first[side] + np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
    return side, (whole - start[side]) / step[side]

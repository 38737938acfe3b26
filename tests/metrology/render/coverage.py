"""The exact fraction of each pixel that a polygon covers.

Images are rendered from areas, never from the distance to an edge or an error function, so that the measurement does
not invert its own model. Pixel (row i, column j) is the square j <= u < j + 1, i <= v < i + 1; u runs to the right and
v down.

Each side of the polygon is cut where it crosses the grid lines, so that each piece is in one pixel. The area on its
right is a trapezium in that pixel, and the full height of the piece in every pixel further right: these are added by a
running sum over the columns.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray


def coverage(rings: Sequence[FloatArray], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return the fraction of each pixel in closed polygons (N, 2) of (u, v) px; holes have the opposite direction."""
    rows, columns = shape
    right_of = np.zeros((rows, columns + 1))
    first, last = rows, 0
    for ring in rings:
        start, end = _pieces(ring)
        middle, height = 0.5 * (start + end), end[:, 1] - start[:, 1]
        row, column = np.floor(middle[:, 1]).astype(int), np.floor(middle[:, 0]).astype(int)
        left_of_edge = np.where(
            column < 0, 1.0, 1.0 - (middle[:, 0] - column)
        )  # pieces left of the image cover entire rows
        inside = (row >= 0) & (row < rows) & (column < columns)
        row, column, left_of_edge, height = (
            row[inside],
            np.maximum(column[inside], 0),
            left_of_edge[inside],
            height[inside],
        )
        first, last = min(first, int(row.min(initial=rows))), max(last, int(row.max(initial=-1)) + 1)
        np.add.at(right_of, (row, column), height * left_of_edge)
        np.add.at(right_of, (row, column + 1), height * (1.0 - left_of_edge))
    covered = np.zeros(shape)
    covered[first:last] = np.abs(np.cumsum(right_of[first:last], axis=1)[:, :columns])
    return covered


def _pieces(ring: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the starts and ends (M, 2) of the sides, cut at every grid line that they cross."""
    closed = ring if np.array_equal(ring[0], ring[-1]) else np.vstack([ring, ring[:1]])
    start, step = closed[:-1], np.diff(closed, axis=0)
    sides, fractions = [np.arange(len(start)), np.arange(len(start))], [np.zeros(len(start)), np.ones(len(start))]
    for axis in (0, 1):
        side, fraction = _crossings(start[:, axis], step[:, axis])
        sides.append(side)
        fractions.append(fraction)
    order = np.lexsort((fraction := np.concatenate(fractions), side := np.concatenate(sides)))
    points = start[side[order]] + fraction[order, None] * step[side[order]]
    same = side[order][1:] == side[order][:-1]
    return points[:-1][same], points[1:][same]


def _crossings(start: NDArray[np.float64], step: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the sides that cross integers, and the fractions of their lengths at the crossings."""
    low, high = np.minimum(start, start + step), np.maximum(start, start + step)
    first = np.floor(low).astype(int) + 1
    count = np.maximum(np.ceil(high).astype(int) - first, 0)
    side = np.repeat(np.arange(len(start)), count)
    line = first[side] + np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
    return side, (line - start[side]) / step[side]

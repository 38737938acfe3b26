"""A grid over a scene with many curves, so that a ray is tested only against the curves in the cells it crosses.

The area occupied by the curves is divided into about twice as many cells as there are curve pieces. Each piece is
listed in all cells that its polyline crosses, with a margin for the sag: a superfluous cell costs a little time, but a
missing one would lose light.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.curve import Curve

MIN_PIECES = 40
"""Number of curve pieces below which it is faster to test all of them for a block of rays."""
CELLS_PER_PIECE = 2.0
MAX_CELLS_ALONG = 4096
SAG = 0.1


class Grid(NamedTuple):
    """Grid arrays of `solen.trace.tables.Tables`: lowest corner, cell size, number of cells, pieces in each cell."""

    low: FloatArray
    cell: FloatArray
    shape: IntArray
    first: IntArray
    item: IntArray


NO_GRID = Grid(np.zeros(2), np.ones(2), np.ones(2, dtype=np.int64), np.zeros(2, dtype=np.int64), np.zeros(0, np.int64))


def grid_of(pieces: Sequence[Curve]) -> Grid:
    """Return the grid over the curve pieces, or `NO_GRID` if there are few pieces."""
    if len(pieces) < MIN_PIECES:
        return NO_GRID
    ends = np.array([point for curve in pieces for point in (curve.start, curve.middle_point, curve.end)])
    size = np.ptp(ends, axis=0)
    size_mm = float(size.max())
    cell = math.sqrt(float(np.prod(np.maximum(size, 1e-3 * size_mm))) / (CELLS_PER_PIECE * len(pieces)))
    lines = [curve.flattened(SAG * cell) for curve in pieces]
    points = np.vstack(lines)
    margin = SAG * cell + 1e-6 * size_mm
    low, high = points.min(axis=0) - 2.0 * margin, points.max(axis=0) + 2.0 * margin
    count = np.clip(np.ceil((high - low) / cell), 1, MAX_CELLS_ALONG).astype(np.int64)
    cells = (high - low) / count
    piece, start, stop = _sides(lines, float(cells.min()))
    first = np.clip(np.floor((np.minimum(start, stop) - margin - low) / cells), 0, count - 1).astype(np.int64)
    last = np.clip(np.floor((np.maximum(start, stop) + margin - low) / cells), 0, count - 1).astype(np.int64)
    spans = last - first + 1
    counts = spans[:, 0] * spans[:, 1]
    row = np.repeat(np.arange(len(counts)), counts)
    offset = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    i, j = first[row, 0] + offset // spans[row, 1], first[row, 1] + offset % spans[row, 1]
    entries = np.unique(np.column_stack([i * count[1] + j, piece[row]]), axis=0)
    begins = np.searchsorted(entries[:, 0], np.arange(int(count[0] * count[1]) + 1))
    return Grid(low, cells, count, begins.astype(np.int64), np.ascontiguousarray(entries[:, 1]))


def _sides(lines: Sequence[FloatArray], max_length: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the sides of all polylines, divided to at most ``max_length``: polyline index and both ends of each."""
    starts, stops = np.vstack([line[:-1] for line in lines]), np.vstack([line[1:] for line in lines])
    owner = np.repeat(np.arange(len(lines)), [len(line) - 1 for line in lines])
    parts = np.maximum(np.ceil(np.hypot(*(stops - starts).T) / max_length), 1).astype(np.int64)
    row = np.repeat(np.arange(len(parts)), parts)
    offset = (np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts))[:, None]
    step = (stops - starts)[row] / parts[row, None]
    return owner[row], starts[row] + offset * step, starts[row] + (offset + 1) * step

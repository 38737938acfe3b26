"""Delaunay triangulation of an outlined area, with inner points from graded lattices and Laplacian smoothing.

Triangular lattices, each with half the spacing of the previous one, fill the regions whose requested element size is
nearest to their spacing. Smoothing moves every inner point to the mean of its neighbours. Triangles outside the area
are removed.

Public names: `Sizes` and `triangulate`.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray

GROWTH = 0.35
"""Increase of the element size per unit distance from a source of small elements."""
MIN_SPACING = 0.65
"""Smallest distance of an inner point from the outline and from other points, in element sizes."""
SMOOTHING_ROUNDS = 6


@dataclass
class Sizes:
    """Element size as a function of position: the smallest size over the sources, each growing with distance."""

    largest_mm: float
    points: list[tuple[float, float]] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)

    def add(self, point: Iterable[float], size_mm: float) -> None:
        """Add a source of a given size at a position (x, z)."""
        x, z = point
        self.points.append((float(x), float(z)))
        self.sizes.append(min(size_mm, self.largest_mm))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the sizes (N,) at points (N, 2)."""
        sizes_mm = np.full(len(points), self.largest_mm)
        for source, size in zip(self.points, self.sizes, strict=True):
            np.minimum(sizes_mm, size + GROWTH * np.hypot(*(points - source).T), out=sizes_mm)
        return sizes_mm


def triangulate(boundary: FloatArray, area: Any, sizes: Sizes) -> tuple[FloatArray, IndexArray]:
    """Return points (N, 2), the boundary's first, and counter-clockwise triangles (M, 3) that fill a shapely area."""
    import shapely

    shapely.prepare(area)
    points = np.vstack([boundary, _lattice(boundary, area, sizes)])
    for _ in range(SMOOTHING_ROUNDS):
        points = np.vstack([boundary, _smooth(points, _triangles_in(points, area), len(boundary))])
    return points, _triangles_in(points, area)


def _triangles_in(points: FloatArray, area: Any) -> IndexArray:
    """Return the Delaunay triangles (M, 3) with centres in the area, without degenerate ones."""
    import shapely
    from scipy.spatial import Delaunay

    triangles = np.asarray(Delaunay(points).simplices, dtype=np.intp)
    a, b, c = points[triangles].transpose(1, 0, 2)
    (abx, abz), (acx, acz) = (b - a).T, (c - a).T
    twice_area = abx * acz - abz * acx
    longest_squared = np.maximum.reduce([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))])
    centre = (a + b + c) / 3.0
    kept = (np.abs(twice_area) > 1e-9 * longest_squared) & shapely.contains_xy(area, centre)
    clockwise = twice_area < 0.0
    triangles[clockwise] = triangles[clockwise][:, [0, 2, 1]]
    return np.asarray(triangles[kept])


def _smooth(points: FloatArray, triangles: IndexArray, fixed: int) -> FloatArray:
    """Return the inner points, each moved to the mean of its neighbours."""
    pairs = np.vstack([triangles[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    n = len(points)
    count = np.bincount(pairs[:, 0], minlength=n)
    sums = [np.bincount(pairs[:, 0], weights=points[pairs[:, 1], k], minlength=n) for k in (0, 1)]
    means = np.column_stack(sums) / np.maximum(count, 1)[:, None]
    return np.asarray(np.where(count[:, None] > 0, means, points)[fixed:])


def _lattice(boundary: FloatArray, area: Any, sizes: Sizes) -> FloatArray:
    """Return inner points (N, 2) of the graded lattices, at least `MIN_SPACING` from the boundary and each other."""
    import shapely
    from scipy.spatial import KDTree

    x_low, z_low, x_high, z_high = area.bounds
    smallest = min([sizes.largest_mm, *sizes.sizes])
    levels = []
    for level in range(1 + math.ceil(math.log2(sizes.largest_mm / smallest))):
        spacing = sizes.largest_mm * 0.5**level
        for x0, z0, x1, z1 in _boxes(sizes, level, spacing, (x_low, z_low, x_high, z_high)):
            points = _hexagonal(x0, z0, x1, z1, spacing)
            levels.append(points[np.round(np.log2(sizes.largest_mm / sizes.at(points))) == level])
    points = np.unique(np.vstack(levels).round(9), axis=0)
    points = points[shapely.contains_xy(area, points)]
    points = points[KDTree(boundary).query(points)[0] > MIN_SPACING * sizes.at(points)]
    return points[_spaced(points, sizes.at(points))]


def _boxes(
    sizes: Sizes, level: int, spacing: float, bounds: tuple[float, float, float, float]
) -> list[tuple[float, float, float, float]]:
    """Return boxes that contain all points of a level: the bounds at level 0, otherwise one box per source."""
    if level == 0:
        return [bounds]
    boxes = []
    for (x, z), size in zip(sizes.points, sizes.sizes, strict=True):
        reach = (spacing * math.sqrt(2.0) - size) / GROWTH
        if reach > 0.0:
            low = (max(bounds[0], x - reach), max(bounds[1], z - reach))
            boxes.append((*low, min(bounds[2], x + reach), min(bounds[3], z + reach)))
    return boxes


def _hexagonal(x_low: float, z_low: float, x_high: float, z_high: float, spacing: float) -> FloatArray:
    """Return the points (N, 2) of a triangular lattice, symmetric about x = 0, in a box and its margin."""
    rise = spacing * math.sqrt(0.75)
    rows = np.arange(math.floor(z_low / rise), math.ceil(z_high / rise) + 1)
    columns = np.arange(math.floor(x_low / spacing) - 1, math.ceil(x_high / spacing) + 1)
    x = spacing * (columns[None, :] + 0.5 * (rows[:, None] % 2))
    z = np.broadcast_to(rise * rows[:, None], x.shape)
    return np.column_stack([x.ravel(), z.ravel()])


def _spaced(points: FloatArray, size: FloatArray) -> BoolArray:
    """Return a mask of the points (N,) that are at least `MIN_SPACING` from every earlier point that is kept."""
    from scipy.spatial import KDTree

    kept = np.ones(len(points), dtype=bool)
    if len(points) < 2:
        return kept
    pairs = KDTree(points).query_pairs(MIN_SPACING * float(size.max()), output_type="ndarray")
    distance = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    for a, b in pairs[distance < MIN_SPACING * np.minimum(size[pairs[:, 0]], size[pairs[:, 1]])]:
        if kept[a]:
            kept[b] = False
    return kept

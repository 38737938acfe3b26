"""Triangulation of an outlined area: a graded lattice of inner points, and a Delaunay triangulation of all points.

Triangular lattices, each with half the spacing of the one before, fill the regions whose requested size is nearest to
their spacing. Points are moved to the centre of their neighbours a few times. Triangles outside the area are removed.

Public names: `Sizes` and `triangulated`.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray

GROWTH = 0.35
"""Growth of the element size per unit distance from small elements."""
CLEAR = 0.65
"""Smallest distance of an inner point from the outline and from other points, in element sizes."""
SMOOTHINGS = 6


@dataclass
class Sizes:
    """Element size as a function of position: the smallest size over the sources, each growing with distance."""

    largest_mm: float
    points: list[tuple[float, float]] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)

    def add(self, point: Iterable[float], size_mm: float) -> None:
        """Add a position (x, z) with a given size."""
        x, z = point
        self.points.append((float(x), float(z)))
        self.sizes.append(min(size_mm, self.largest_mm))

    def at(self, points: FloatArray) -> FloatArray:
        """Return the sizes (N,) at points (N, 2)."""
        found = np.full(len(points), self.largest_mm)
        for source, size in zip(self.points, self.sizes, strict=True):
            np.minimum(found, size + GROWTH * np.hypot(*(points - source).T), out=found)
        return found


def triangulated(own: FloatArray, area: Any, sizes: Sizes) -> tuple[FloatArray, IndexArray]:
    """Return points (N, 2), the given ones first, and counter-clockwise triangles (M, 3) that fill a shapely area."""
    import shapely

    shapely.prepare(area)
    inner = _lattice(own, area, sizes)
    for _ in range(SMOOTHINGS):
        points = np.vstack([own, inner])
        inner = _smoothed(points, _within(points, area), len(own))
    points = np.vstack([own, inner])
    return points, _within(points, area)


def _within(points: FloatArray, area: Any) -> IndexArray:
    """Return the Delaunay triangles (M, 3) with centres in the area; slivers of zero area are omitted."""
    import shapely
    from scipy.spatial import Delaunay

    triangles = np.asarray(Delaunay(points).simplices, dtype=np.intp)
    a, b, c = points[triangles].transpose(1, 0, 2)
    (abx, abz), (acx, acz) = (b - a).T, (c - a).T
    doubled = abx * acz - abz * acx
    longest = np.maximum.reduce([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))])
    middle = (a + b + c) / 3.0
    kept = (np.abs(doubled) > 1e-9 * longest) & shapely.contains_xy(area, middle)
    flipped = doubled < 0.0
    triangles[flipped] = triangles[flipped][:, [0, 2, 1]]
    return np.asarray(triangles[kept])


def _smoothed(points: FloatArray, triangles: IndexArray, fixed: int) -> FloatArray:
    """Return the inner points, moved to the centre of their neighbours."""
    pairs = np.vstack([triangles[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    n = len(points)
    count = np.bincount(pairs[:, 0], minlength=n)
    sums = [np.bincount(pairs[:, 0], weights=points[pairs[:, 1], k], minlength=n) for k in (0, 1)]
    middles = np.column_stack(sums) / np.maximum(count, 1)[:, None]
    return np.asarray(np.where(count[:, None] > 0, middles, points)[fixed:])


def _lattice(own: FloatArray, area: Any, sizes: Sizes) -> FloatArray:
    """Return inner points: triangular lattices of halved spacings, each in the region with sizes nearest to its own."""
    import shapely
    from scipy.spatial import KDTree

    x_low, z_low, x_high, z_high = area.bounds
    smallest = min([sizes.largest_mm, *sizes.sizes])
    found = []
    for level in range(1 + math.ceil(math.log2(sizes.largest_mm / smallest))):
        spacing = sizes.largest_mm * 0.5**level
        for x0, z0, x1, z1 in _windows(sizes, level, spacing, (x_low, z_low, x_high, z_high)):
            points = _hexagonal(x0, z0, x1, z1, spacing)
            near = np.round(np.log2(sizes.largest_mm / sizes.at(points))) == level
            found.append(points[near])
    points = np.unique(np.vstack(found).round(9), axis=0)
    points = points[shapely.contains_xy(area, points)]
    size = sizes.at(points)
    points, size = (a[KDTree(own).query(points)[0] > CLEAR * size] for a in (points, size))
    return points[_apart(points, size)]


def _windows(
    sizes: Sizes, level: int, spacing: float, bounds: tuple[float, float, float, float]
) -> list[tuple[float, float, float, float]]:
    """Yield boxes that contain all positions of a level: the whole area, or for finer ones one per source."""
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
    """Return the points (N, 2) in a box of a lattice with a given spacing, placed about the axis x = 0."""
    rise = spacing * math.sqrt(0.75)
    rows = np.arange(math.floor(z_low / rise), math.ceil(z_high / rise) + 1)
    columns = np.arange(math.floor(x_low / spacing) - 1, math.ceil(x_high / spacing) + 1)
    x = spacing * (columns[None, :] + 0.5 * (rows[:, None] % 2))
    z = np.broadcast_to(rise * rows[:, None], x.shape)
    return np.column_stack([x.ravel(), z.ravel()])


def _apart(points: FloatArray, size: FloatArray) -> BoolArray:
    """Return a mask of points (N,) that are far enough from all earlier ones."""
    from scipy.spatial import KDTree

    kept = np.ones(len(points), dtype=bool)
    if len(points) < 2:
        return kept
    pairs = KDTree(points).query_pairs(CLEAR * float(size.max()), output_type="ndarray")
    distance = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    for a, b in pairs[distance < CLEAR * np.minimum(size[pairs[:, 0]], size[pairs[:, 1]])]:
        if kept[a]:
            kept[b] = False
    return kept

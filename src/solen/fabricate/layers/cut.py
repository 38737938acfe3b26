"""Horizontal sections of a closed mesh and its shells, computed with little more memory than the mesh requires.

A vertex on a plane is treated as above it. The plane then crosses either no edge of a triangle or exactly two, and each
crossing is shared by two triangles. Following the crossings therefore gives closed rings, even if the plane contains
vertices or horizontal faces. Seen from above, the section of a triangle runs from its descending to its ascending edge,
with the solid on the left, so that holes are clockwise.

`Cutter.rings` returns the section at a height; `Shells.of` finds the shells of a mesh.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.fabricate.mesh import Mesh

MAX_SHELLS = 300
"""Maximum number of shells that are compared in pairs; if there are more, they are assumed to overlap."""


@dataclass(frozen=True, eq=False)
class Cutter:
    """A closed mesh to be cut at given heights, with the heights of its triangles."""

    mesh: Mesh

    @cached_property
    def _heights_mm(self) -> tuple[FloatArray, FloatArray]:
        """Heights of the lowest and the highest vertex of each triangle."""
        z = self.mesh.vertices[:, 2]
        corners = [z[corner] for corner in self.mesh.triangles.T]
        return np.minimum.reduce(corners), np.maximum.reduce(corners)

    def rings(self, z_mm: float) -> list[FloatArray]:
        """Return closed polylines (N, 2) in mm at a height, counter-clockwise about the solid."""
        low, high = self._heights_mm
        triangles = self.mesh.triangles[(low < z_mm) & (high >= z_mm)]
        if not len(triangles):
            return []
        vertices, count = self.mesh.vertices, len(self.mesh.vertices)
        above = vertices[triangles, 2] >= z_mm
        following, next_above = np.roll(triangles, -1, axis=1), np.roll(above, -1, axis=1)
        down, up = above & ~next_above, ~above & next_above
        starts = following[down] * count + triangles[down]  # an edge, encoded with its lower vertex first
        ends = triangles[up] * count + following[up]
        order = np.argsort(starts)
        successors = order[np.searchsorted(starts[order], ends)]
        lower, upper = vertices[starts // count], vertices[starts % count]
        fraction = (z_mm - lower[:, 2]) / (upper[:, 2] - lower[:, 2])
        points = lower[:, :2] + fraction[:, None] * (upper[:, :2] - lower[:, :2])
        return [points[ring] for ring in _cycles(successors) if len(ring) > 2]


def _cycles(permutation: NDArray[np.intp]) -> Iterator[list[int]]:
    """Yield the cycles of a permutation."""
    successors, visited = permutation.tolist(), np.zeros(len(permutation), bool)
    for first in range(len(successors)):
        if visited[first]:
            continue
        cycle, index = [first], successors[first]
        while index != first:
            cycle.append(index)
            index = successors[index]
        visited[cycle] = True
        yield cycle


@dataclass(frozen=True, eq=False)
class Shells:
    """Connected surfaces of a mesh: volumes (N,), and minimum and maximum coordinates (N, 3)."""

    volumes_mm3: FloatArray
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> "Shells":
        """Return the shells of a mesh."""
        count, shell = _connected(mesh)
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        if count == 1:
            used = mesh.vertices[np.unique(mesh.triangles)]
            return cls(np.array([mesh.volume_mm3]), used.min(axis=0)[None], used.max(axis=0)[None])
        np.minimum.at(low, shell, mesh.vertices)
        np.maximum.at(high, shell, mesh.vertices)
        volumes = np.zeros(count)
        for batch, six_mm3 in mesh.six_volumes():
            volumes += np.bincount(shell[mesh.triangles[batch, 0]], six_mm3, count) / 6.0
        with_triangles = np.bincount(shell[mesh.triangles[:, 0]], minlength=count) > 0
        return cls(volumes[with_triangles], low[with_triangles], high[with_triangles])

    @property
    def may_overlap(self) -> bool:
        """Whether the bounding boxes of any two shells overlap; False if a shell bounds a cavity."""
        if len(self.volumes_mm3) < 2 or self.volumes_mm3.min() <= 0.0:
            return False
        if len(self.volumes_mm3) > MAX_SHELLS:
            return True
        below = np.all(self.low[:, None] < self.high[None], axis=2)
        overlap = np.asarray(below & below.T)
        np.fill_diagonal(overlap, val=False)
        return bool(overlap.any())


def _connected(mesh: Mesh) -> tuple[int, IntArray]:
    """Return the number of connected sets of vertices, and the index of the set of each vertex."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = [mesh.triangles[:, pair].astype(np.int32) for pair in pairwise(range(3))]
    first, second = np.concatenate(edges).T
    size = len(mesh.vertices)
    links = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(size, size))
    count, labels = connected_components(links, directed=False)
    return int(count), np.asarray(labels, np.int64)

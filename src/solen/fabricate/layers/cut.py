"""Horizontal sections of a closed mesh and its shells, computed with little more memory than the mesh requires.

A vertex is either above a plane or not; a vertex on the plane counts as above. The plane then crosses either no edge of
a triangle or exactly two, and each crossing is shared by two triangles. Following the crossings therefore gives closed
rings, even if the plane contains vertices or horizontal faces. Seen from above, the crossing of a triangle leads from
its descending to its ascending edge with the solid on the left, so holes are clockwise.

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
    """A closed mesh, ready to be cut."""

    mesh: Mesh

    @cached_property
    def _ends(self) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest vertices of each triangle."""
        z = self.mesh.vertices[:, 2]
        corners = [z[corner] for corner in self.mesh.triangles.T]
        return np.minimum.reduce(corners), np.maximum.reduce(corners)

    def rings(self, z_mm: float) -> list[FloatArray]:
        """Return closed polylines (N, 2) in mm at a height, counter-clockwise about the solid."""
        low, high = self._ends
        triangles = self.mesh.triangles[(low < z_mm) & (high >= z_mm)]
        if not len(triangles):
            return []
        vertices, count = self.mesh.vertices, len(self.mesh.vertices)
        above = vertices[triangles, 2] >= z_mm
        following, next_above = np.roll(triangles, -1, axis=1), np.roll(above, -1, axis=1)
        down, up = above & ~next_above, ~above & next_above
        starts = following[down] * count + triangles[down]  # the lower corner of an edge comes first
        ends = triangles[up] * count + following[up]
        order = np.argsort(starts)
        onwards = order[np.searchsorted(starts[order], ends)]
        below, over = vertices[starts // count], vertices[starts % count]
        share = (z_mm - below[:, 2]) / (over[:, 2] - below[:, 2])
        points = below[:, :2] + share[:, None] * (over[:, :2] - below[:, :2])
        return [points[ring] for ring in _cycles(onwards) if len(ring) > 2]


def _cycles(onwards: NDArray[np.intp]) -> Iterator[list[int]]:
    """Return the cycles of a permutation."""
    follows, seen = onwards.tolist(), np.zeros(len(onwards), bool)
    for first in range(len(follows)):
        if seen[first]:
            continue
        ring, at = [first], follows[first]
        while at != first:
            ring.append(at)
            at = follows[at]
        seen[ring] = True
        yield ring


@dataclass(frozen=True, eq=False)
class Shells:
    """Connected surfaces of a mesh: numbers, volumes in mm³, and lowest and highest corners (n, 3)."""

    volumes_mm3: FloatArray
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> "Shells":
        """Find the shells of a mesh."""
        count, of_vertex = _connected(mesh)
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        if count == 1:
            used = mesh.vertices[np.unique(mesh.triangles)]
            return cls(np.array([mesh.volume_mm3]), used.min(axis=0)[None], used.max(axis=0)[None])
        np.minimum.at(low, of_vertex, mesh.vertices)
        np.maximum.at(high, of_vertex, mesh.vertices)
        volumes = np.zeros(count)
        for part, six_mm3 in mesh.six_volumes():
            volumes += np.bincount(of_vertex[mesh.triangles[part, 0]], six_mm3, count) / 6.0
        with_triangles = np.bincount(of_vertex[mesh.triangles[:, 0]], minlength=count) > 0
        return cls(volumes[with_triangles], low[with_triangles], high[with_triangles])

    @property
    def may_overlap(self) -> bool:
        """Whether the bounding boxes of two shells overlap; False if any shell bounds a cavity."""
        if len(self.volumes_mm3) < 2 or self.volumes_mm3.min() <= 0.0:
            return False
        if len(self.volumes_mm3) > MAX_SHELLS:
            return True
        reach = np.all(self.low[:, None] < self.high[None], axis=2)
        meet = np.asarray(reach & reach.T)
        np.fill_diagonal(meet, val=False)
        return bool(meet.any())


def _connected(mesh: Mesh) -> tuple[int, IntArray]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = [mesh.triangles[:, pair].astype(np.int32) for pair in pairwise(range(3))]
    first, second = np.concatenate(edges).T
    size = len(mesh.vertices)
    links = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(size, size))
    count, labels = connected_components(links, directed=False)
    return int(count), np.asarray(labels, np.int64)

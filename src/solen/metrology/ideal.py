"""The outline that a print was meant to have, as dense points, and how far others are from it.

Lens coordinates as everywhere: the vertex is the origin, x to the right, z into the material, mm. The front is walked
from left to right, so the material lies on its left and what stands out lies on its right: deviations are counted
positive outwards.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solen.arrays import BoolArray, FloatArray
from solen.curve import Curve
from solen.errors import DataError

TOLERANCE_MM = 1e-6
"""How far the dense points' chords may leave the exact curve: a nanometre."""
SPACING_MM = 2e-3
WALL = 0.35
"""Length of wall beside the front that helps to find the lens, as a fraction of its width."""
SYMMETRIC_MM = 1e-4


@dataclass(frozen=True)
class Feet:
    """Where points are beside a front, each by its nearest place on it.

    Attributes
    ----------
    arc_mm
        Shape (N,): length of the front up to that place.
    off_mm
        Shape (N,): distance, positive outwards.
    normals
        Shape (N, 2): outward unit normals there.
    beyond
        Shape (N,): whether the nearest place is an end of the front.
    """

    arc_mm: FloatArray
    off_mm: FloatArray
    normals: FloatArray
    beyond: BoolArray


@dataclass(frozen=True)
class Ideal:
    """A lens's front, and the walls that begin at its ends.

    Attributes
    ----------
    name
        Of the design.
    front_mm
        Shape (N, 2): points of the front from left to right, within `TOLERANCE_MM` of the curve.
    left_mm, right_mm
        Shape (M, 2): walls from the front's ends on; of no points where the design has none.
    """

    name: str
    front_mm: FloatArray
    left_mm: FloatArray
    right_mm: FloatArray

    @classmethod
    def of(cls, name: str, front: Curve, left: Curve | None = None, right: Curve | None = None) -> "Ideal":
        """Outline of curves: the front from left to right, and walls that start at its ends.

        `DataError` for a front that is straight: a picture of it cannot be laid on the design.
        """
        points = _dense(front)
        chord = points[-1] - points[0]
        offset = points - points[0]
        sag = np.abs(chord[0] * offset[:, 1] - chord[1] * offset[:, 0]).max() / np.hypot(*chord)
        if sag < 0.01 * np.hypot(*chord):
            limit = "has a front that is nearly flat, so no picture of it tells where it is"
            raise DataError(name, limit=limit, remedy="inspect a design with a lens")
        reach = WALL * float(np.hypot(*chord))
        return cls(name, points, _cut(left, reach), _cut(right, reach))

    @property
    def width_mm(self) -> float:
        """From one end of the front to the other."""
        return float(np.hypot(*(self.front_mm[-1] - self.front_mm[0])))

    @cached_property
    def normals(self) -> FloatArray:
        """Outward unit normals (N, 2) at the points of the front."""
        return outward(self.front_mm)

    @cached_property
    def arc_mm(self) -> FloatArray:
        """Length of the front up to each of its points."""
        steps = np.hypot(*np.diff(self.front_mm, axis=0).T)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether the front is its own mirror image, so that no picture of it shows from which side it was taken."""
        mirrored = self.front_mm[::-1] * np.array([-1.0, 1.0])
        return bool(np.abs(self.feet(mirrored).off_mm).max() < SYMMETRIC_MM)

    def at(self, arc_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (N, 2) and outward unit normals (N, 2) at lengths along the front."""
        points = np.stack([np.interp(arc_mm, self.arc_mm, self.front_mm[:, i]) for i in (0, 1)], axis=1)
        normals = np.stack([np.interp(arc_mm, self.arc_mm, self.normals[:, i]) for i in (0, 1)], axis=1)
        return points, normals / np.hypot(*normals.T)[:, None]

    def feet(self, points_mm: FloatArray) -> Feet:
        """Nearest places of the front to points (N, 2) in lens coordinates."""
        _, nearest = self._tree.query(points_mm)
        last = len(self.front_mm) - 2
        before, after = np.clip(nearest - 1, 0, last), np.clip(nearest, 0, last)
        (one, first), (other, second) = (self._foot(points_mm, segment) for segment in (before, after))
        later = second < first
        segment, part = np.where(later, after, before), np.where(later, other, one)
        start, way = self.front_mm[segment], self.front_mm[segment + 1] - self.front_mm[segment]
        foot = start + np.clip(part, 0.0, 1.0)[:, None] * way
        length = np.hypot(*way.T)
        arc = self.arc_mm[segment] + np.clip(part, 0.0, 1.0) * length
        rest = points_mm - foot
        right = np.stack([way[:, 1], -way[:, 0]], axis=1) / length[:, None]
        beyond = ((segment == 0) & (part < 0.0)) | ((segment == last) & (part > 1.0))
        off = np.where(np.sum(rest * right, axis=1) < 0.0, -1.0, 1.0) * np.hypot(*rest.T)
        return Feet(arc, off, self.at(arc)[1], beyond)

    @cached_property
    def _tree(self) -> "cKDTree[None]":
        return cKDTree(self.front_mm)

    def _foot(self, points: FloatArray, segment: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """How far along segments the feet of points are, as a fraction, and the squared distances."""
        start, way = self.front_mm[segment], self.front_mm[segment + 1] - self.front_mm[segment]
        share = np.sum((points - start) * way, axis=1) / np.sum(way * way, axis=1)
        rest = points - start - np.clip(share, 0.0, 1.0)[:, None] * way
        return share, np.sum(rest * rest, axis=1)


def outward(points: FloatArray) -> FloatArray:
    """Unit normals (N, 2) to the right of the way along points."""
    way = np.gradient(points, axis=0)
    return np.asarray(np.stack([way[:, 1], -way[:, 0]], axis=1) / np.hypot(*way.T)[:, None])


def _dense(curve: Curve) -> FloatArray:
    """Points of a curve: near enough for the tolerance, and for normals between them."""
    points = curve.flattened(TOLERANCE_MM)
    length = float(np.sum(np.hypot(*np.diff(points, axis=0).T)))
    count = max(int(np.ceil(length / SPACING_MM)), 64)
    if len(points) < count:
        points = curve.points(np.linspace(0.0, 1.0, count))
    return np.asarray(points, dtype=np.float64)


def _cut(curve: Curve | None, reach: float) -> FloatArray:
    """Points of a wall up to a length from its start."""
    if curve is None:
        return np.zeros((0, 2))
    points = curve.points(np.linspace(0.0, 1.0, 400))
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return np.asarray(points[arc <= reach])

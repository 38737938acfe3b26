"""Points and directions in the plane, and the rigid motions that move them.

A point or a direction is a pair (x, z), x to the right and z upwards; angles are in degrees, counter-clockwise.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
"""A point (x, z) in mm, or a direction."""


def dot(a: Point, b: Point) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1]


def cross(a: Point, b: Point) -> float:
    """Return the out-of-plane component of the vector product, which is positive if ``b`` is to the left of ``a``."""
    return a[0] * b[1] - a[1] * b[0]


def minus(a: Point, b: Point) -> Point:
    """Return the vector from ``b`` to ``a``."""
    return (a[0] - b[0], a[1] - b[1])


def along(origin: Point, direction: Point, distance: float) -> Point:
    """Return the point at a distance from ``origin`` along a unit direction."""
    return (origin[0] + distance * direction[0], origin[1] + distance * direction[1])


def unit(a: Point) -> Point:
    """Return the vector of length 1 along ``a``."""
    length = math.hypot(*a)
    return (a[0] / length, a[1] / length)


def left_of(a: Point) -> Point:
    """Return ``a`` rotated by +90 degrees."""
    return (-a[1], a[0])


def right_of(a: Point) -> Point:
    """Return ``a`` rotated by −90 degrees."""
    return (a[1], -a[0])


def heading(angle_deg: float) -> Point:
    """Return the unit direction ``angle_deg`` counter-clockwise from +z: 0 is along the axis, −3 leans to the right."""
    angle = math.radians(angle_deg)
    return (-math.sin(angle), math.cos(angle))


@dataclass(frozen=True)
class Rigid:
    """A rotation followed by a translation: p -> R p + shift."""

    cos: float = 1.0
    sin: float = 0.0
    shift: Point = (0.0, 0.0)

    @classmethod
    def about(cls, pivot: Point, angle_deg: float) -> "Rigid":
        """Return the counter-clockwise rotation by ``angle_deg`` about ``pivot``; for 0 it is exactly the identity."""
        if angle_deg == 0.0:
            return cls()
        c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
        x, z = pivot
        return cls(c, s, (x - (c * x - s * z), z - (s * x + c * z)))

    @classmethod
    def nearest(
        cls, before: NDArray[np.float64], after: NDArray[np.float64], weight: NDArray[np.float64] | None = None
    ) -> "Rigid":
        """Return the least-squares motion that maps points (N, 2) to others; the exact identity if no point moves."""
        if np.array_equal(before, after):
            return cls()
        weights = np.full(len(before), 1.0 / len(before)) if weight is None else weight / weight.sum()
        centre, new_centre = weights @ before, weights @ after
        (x, z), (to_x, to_z) = (before - centre).T, (after - new_centre).T
        c, s = float(weights @ (x * to_x + z * to_z)), float(weights @ (x * to_z - z * to_x))
        size = math.hypot(c, s)
        turn = cls(c / size, s / size) if size > 0.0 else cls()
        shift = new_centre - turn.points(centre[None])[0]
        return cls(turn.cos, turn.sin, (float(shift[0]), float(shift[1])))

    @property
    def angle_deg(self) -> float:
        """Angle of the rotation, counter-clockwise, from −180 to 180."""
        return math.degrees(math.atan2(self.sin, self.cos))

    def points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Move points (N, 2)."""
        return np.asarray(points @ np.array([[self.cos, self.sin], [-self.sin, self.cos]]) + np.asarray(self.shift))

    def point(self, p: Point) -> Point:
        """Move a point."""
        x, z = self.vector(p)
        return (x + self.shift[0], z + self.shift[1])

    def vector(self, v: Point) -> Point:
        """Rotate a direction."""
        return (self.cos * v[0] - self.sin * v[1], self.sin * v[0] + self.cos * v[1])


def deviation_from_line(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Return the largest deviation along y of points (N,), in ascending order of x, from their minimax straight line.

    It is half the height, along y, of the narrowest strip that contains them; one side of the strip lies on an edge of
    the convex hull.
    """
    points = x.tolist(), y.tolist()
    edges = [edge for side in (1.0, -1.0) for edge in pairwise(_hull(*points, side))]
    a, b = np.array(edges).T
    slopes = (y[b] - y[a]) / (x[b] - x[a])
    return 0.5 * float(np.ptp(y - slopes[:, None] * x, axis=1).min())


def _hull(x: list[float], y: list[float], side: float) -> list[int]:
    """Return the indices of the points on the upper (1) or lower (−1) side of the convex hull, from left to right."""
    corners: list[int] = []
    for i in range(len(x)):
        while len(corners) > 1:
            a, b = corners[-2], corners[-1]
            turn = (x[b] - x[a]) * (y[i] - y[a]) - (y[b] - y[a]) * (x[i] - x[a])
            if side * turn < 0.0:
                break
            corners.pop()
        corners.append(i)
    return corners

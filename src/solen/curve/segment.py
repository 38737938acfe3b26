"""The straight line."""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import END_TOLERANCE_MM, Curve, check_points
from solen.errors import DesignError
from solen.plane import Point, Rigid, cross, left_of, minus, unit


@dataclass(frozen=True)
class Segment(Curve):
    """Straight line between two points; `DesignError` if they coincide."""

    a: Point
    b: Point

    def __post_init__(self) -> None:
        check_points("segment", self.a, self.b)
        if self.a == self.b:
            raise DesignError("segment a and b", value=self.a, limit="must differ")

    @property
    def start(self) -> Point:
        """First point, mm."""
        return self.a

    @property
    def end(self) -> Point:
        """Last point, mm."""
        return self.b

    @property
    def middle_point(self) -> Point:
        """Midpoint, mm."""
        return (0.5 * (self.a[0] + self.b[0]), 0.5 * (self.a[1] + self.b[1]))

    @property
    def length_mm(self) -> float:
        """Length of the segment."""
        return math.dist(self.a, self.b)

    def points(self, u: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm at parameters ``u`` (N,) in [0, 1]."""
        a, b = np.asarray(self.a), np.asarray(self.b)
        return np.asarray((1.0 - u)[:, None] * a + u[:, None] * b)

    def velocities(self, u: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2) of `points` with respect to their parameter, mm."""
        return np.tile(np.subtract(self.b, self.a), (len(u), 1))

    def part(self, u_from: float, u_to: float) -> "Segment":
        """Return the part of the curve from one parameter to a larger one."""
        return Segment(self.point_at(u_from), self.point_at(u_to))

    def flattened(self, tolerance_mm: float = 1e-3) -> FloatArray:  # noqa: ARG002  it is straight
        """Return a polyline (N, 2) that deviates from the curve by at most ``tolerance_mm``."""
        return np.array([self.a, self.b])

    def normal_at(self, point: Point) -> Point:  # noqa: ARG002  the normal is the same everywhere
        """Return the left unit normal at a point of the curve."""
        return left_of(unit(minus(self.b, self.a)))

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Return the distances > 0 in mm at which a ray meets the curve, in any order."""
        tangent = unit(minus(self.b, self.a))
        slant = cross(direction, tangent)
        if leaving or slant == 0.0:
            return ()
        to_start = minus(self.a, origin)
        distance = cross(to_start, tangent) / slant
        position = cross(to_start, direction) / slant
        inside = -END_TOLERANCE_MM <= position <= self.length_mm + END_TOLERANCE_MM
        return (distance,) if distance > 0.0 and inside else ()

    def moved(self, motion: Rigid) -> "Segment":
        """Return the curve after a rigid motion."""
        return Segment(motion.point(self.a), motion.point(self.b))

    def reversed(self) -> "Segment":
        """Return the same curve traversed from end to start."""
        return Segment(self.b, self.a)

"""The Cartesian oval: the lens that images one point onto another."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import END_TOLERANCE_MM, ROUNDING, Curve, check_axis, check_numbers, check_points
from solen.errors import DesignError
from solen.plane import Point, Rigid, along, cross, dot, left_of, minus, unit


@dataclass(frozen=True)
class CartesianOval(Curve):
    """Front of a Cartesian oval: n1 |P − F1| + n2 |P − F2| = n1 s + n2 s', between two angles seen from F1.

    ``vertex`` is on the oval and ``axis`` (a unit vector) points from it into the material; F1 is ``object_mm`` (s)
    before the vertex, F2 ``image_mm`` (s') behind it, and n2 > n1. The curve runs from ``from_deg`` to ``to_deg``,
    angles at F1 counter-clockwise from the axis. For a fixed angle the equation is quadratic in the distance from F1,
    and its smaller root is the front; the other root, the back of the oval near the far focus, is never used.

    The left-hand side of the equation, a sum of distances, is a convex function along any straight line, and the inside
    of the oval is a convex region. A ray therefore meets it at most twice, and Newton's method started outside
    converges to the nearer root without overshoot.
    """

    vertex: Point
    axis: Point
    n1: float
    n2: float
    object_mm: float
    image_mm: float
    from_deg: float
    to_deg: float

    def __post_init__(self) -> None:
        check_points("oval", self.vertex)
        check_axis("oval axis", self.axis)
        check_numbers("oval", self.n1, self.n2, self.object_mm, self.image_mm, self.from_deg, self.to_deg)
        if not (self.n2 > self.n1 > 0.0 and self.object_mm > 0.0 and self.image_mm > 0.0):
            values = (self.n1, self.n2, self.object_mm, self.image_mm)
            limit = "must satisfy 0 < n1 < n2, and both distances must be above 0"
            raise DesignError("oval (n1, n2, object_mm, image_mm)", value=values, limit=limit)
        if self.from_deg == self.to_deg or np.isnan(self.points(np.array([0.0, 1.0]))).any():
            raise DesignError(
                "oval (from_deg, to_deg)",
                value=(self.from_deg, self.to_deg),
                limit="must differ and be between the oval's tangents from the object focus",
            )

    @property
    def constant_mm(self) -> float:
        """Optical path from focus to focus, n1 s + n2 s'."""
        return self.n1 * self.object_mm + self.n2 * self.image_mm

    @property
    def object_focus(self) -> Point:
        """The focus F1."""
        return along(self.vertex, self.axis, -self.object_mm)

    @property
    def image_focus(self) -> Point:
        """The focus F2."""
        return along(self.vertex, self.axis, self.image_mm)

    @property
    def depth_mm(self) -> float:
        """Extent of this part of the oval along the axis from the vertex."""
        ends = self.points(np.array([0.0, 1.0])) - np.asarray(self.vertex)
        return float(np.max(ends @ np.asarray(self.axis)))

    def radius_from_object(self, angle_deg: FloatArray) -> FloatArray:
        """Return the distance in mm from F1 to the front at angles from the axis; NaN if the line misses the oval.

        It is the smaller root of (n2²−n1²) r² − 2 (n2² D cos φ − n1 C) r + n2² D² − C² = 0; D = s + s', C the constant.
        """
        n1, n2, c = self.n1, self.n2, self.constant_mm
        d = self.object_mm + self.image_mm
        a = n2**2 - n1**2
        half_b = n2**2 * d * np.cos(np.radians(angle_deg)) - n1 * c
        rest = (n2 - n1) * self.object_mm * (n2 * d + c)  # n2² D² − C² without cancellation
        discriminant = half_b**2 - a * rest
        with np.errstate(invalid="ignore"):
            return np.asarray(np.where(half_b > 0, rest / (half_b + np.sqrt(discriminant)), np.nan))

    def points(self, u: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm at parameters ``u`` (N,) in [0, 1]."""
        angle_deg = self.from_deg + u * (self.to_deg - self.from_deg)
        radius, angle = self.radius_from_object(angle_deg), np.radians(angle_deg)
        forward, lateral = radius * np.cos(angle), radius * np.sin(angle)
        return np.asarray(
            np.asarray(self.object_focus) + np.outer(forward, self.axis) + np.outer(lateral, left_of(self.axis))
        )

    def velocities(self, u: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2) of `points` with respect to their parameter, mm.

        The radius changes such that the velocity is perpendicular to the normal.
        """
        angle_deg = self.from_deg + u * (self.to_deg - self.from_deg)
        radius, angle = self.radius_from_object(angle_deg)[:, None], np.radians(angle_deg)
        ray = np.outer(np.cos(angle), self.axis) + np.outer(np.sin(angle), left_of(self.axis))
        across = np.outer(-np.sin(angle), self.axis) + np.outer(np.cos(angle), left_of(self.axis))
        from_image = np.asarray(self.object_focus) + radius * ray - np.asarray(self.image_focus)
        normal = self.n1 * ray + self.n2 * from_image / np.hypot(*from_image.T)[:, None]
        growth = -radius * np.sum(across * normal, axis=1)[:, None] / np.sum(ray * normal, axis=1)[:, None]
        return np.asarray(math.radians(self.to_deg - self.from_deg) * (growth * ray + radius * across))

    def part(self, u_from: float, u_to: float) -> "CartesianOval":
        """Return the part of the curve from one parameter to a larger one."""
        per_u = self.to_deg - self.from_deg
        return replace(self, from_deg=self.from_deg + u_from * per_u, to_deg=self.from_deg + u_to * per_u)

    def normal_at(self, point: Point) -> Point:
        """Return the left unit normal at a point of the curve."""
        to_1, to_2 = unit(minus(point, self.object_focus)), unit(minus(point, self.image_focus))
        outward = unit((self.n1 * to_1[0] + self.n2 * to_2[0], self.n1 * to_1[1] + self.n2 * to_2[1]))
        return outward if self.to_deg > self.from_deg else (-outward[0], -outward[1])

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Return the distances > 0 in mm at which a ray meets the curve, in any order."""
        roots = self._roots(origin, direction, leaving)
        return tuple(t for t in roots if t > 0.0 and self._holds(along(origin, direction, t)))

    def moved(self, motion: Rigid) -> "CartesianOval":
        """Return the curve after a rigid motion."""
        return replace(self, vertex=motion.point(self.vertex), axis=motion.vector(self.axis))

    def reversed(self) -> "CartesianOval":
        """Return the same curve traversed from end to start."""
        return replace(self, from_deg=self.to_deg, to_deg=self.from_deg)

    def residual_mm(self, point: Point) -> float:
        """Return the left-hand side of the oval's equation minus its right-hand side: 0 on the oval, negative inside.

        |P − F1| − s and |P − F2| − s' are computed as differences of squares divided by sums, which is also exact for a
        distant focus.
        """
        offset = minus(point, self.vertex)
        square, forward = dot(offset, offset), dot(offset, self.axis)
        to_1, to_2 = math.dist(point, self.object_focus), math.dist(point, self.image_focus)
        first = (square + 2.0 * self.object_mm * forward) / (to_1 + self.object_mm)
        second = (square - 2.0 * self.image_mm * forward) / (to_2 + self.image_mm)
        return self.n1 * first + self.n2 * second

    @property
    def end_rays(self) -> tuple[Point, Point]:
        """Unit directions from F1 to the ends, first on the right of the axis and then on its left."""
        right, left = sorted((self.from_deg, self.to_deg))
        turn = (Rigid.about((0.0, 0.0), right), Rigid.about((0.0, 0.0), left))
        return turn[0].vector(self.axis), turn[1].vector(self.axis)

    def _holds(self, point: Point) -> bool:
        """Return whether a point on the oval is on this part: between the rays from F1 to its ends, facing F1."""
        ray = minus(point, self.object_focus)
        right, left = self.end_rays
        within = cross(right, ray) >= -END_TOLERANCE_MM and cross(left, ray) <= END_TOLERANCE_MM
        return within and self._slope(point, ray) < 0.0

    def _roots(self, origin: Point, direction: Point, leaving: bool) -> Iterator[float]:
        """Yield the intersections of a line with the full oval, or only the far one if the line starts on the oval."""
        from_focus = minus(origin, self.image_focus)
        circle_mm = self.constant_mm / self.n2  # about F2; the oval lies inside it
        middle, offset = -dot(from_focus, direction), cross(from_focus, direction)
        if abs(offset) >= circle_mm or (leaving and self._slope(origin, direction) >= 0.0):
            return
        half_chord = math.sqrt(circle_mm**2 - offset**2)
        for outwards in (1.0,) if leaving else (-1.0, 1.0):
            root = self._newton(origin, direction, middle + outwards * half_chord, outwards)
            if root is not None:
                yield root

    def _newton(self, origin: Point, direction: Point, start: float, outwards: float) -> float | None:
        """Return the root reached from a start outside the oval; ``outwards`` is the sign of the slope there."""
        t = start
        for _ in range(200):
            p = along(origin, direction, t)
            value, slope = self.residual_mm(p), self._slope(p, direction)
            if slope * outwards <= 0.0:
                return None  # past the minimum without a root: the line misses the oval
            t -= value / slope
            lengths = abs(t) + math.dist(p, self.vertex)
            if value <= ROUNDING * lengths * (self.n1 + self.n2) or abs(value) <= ROUNDING * abs(t * slope):
                return t
        return None

    def _slope(self, point: Point, direction: Point) -> float:
        """Return the derivative of the residual along a direction."""
        to_1, to_2 = unit(minus(point, self.object_focus)), unit(minus(point, self.image_focus))
        return self.n1 * dot(to_1, direction) + self.n2 * dot(to_2, direction)

"""Exact plane curves: what every face of a body, every mirror and every receiver is made of.

A curve is directed, from its start to its end; *left* and its left normal are meant as seen walking along it. Nothing
is meshed: a ray meets the curve itself, at the roots of its equation. A ray that has just left a curve knows one root
already (the one it stands on); ``leaving=True`` divides that root out algebraically, so no distance threshold is
needed and no second hit is lost however close it is.

Interface: :class:`Curve` with its leaves :class:`Segment`, :class:`Arc`, :class:`Parabola` and :class:`CartesianOval`;
`solen.plane.Rigid` moves them. Coordinates are (x, z) in mm.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from solen.plane import Point, Rigid, along, cross, dot, left_of, minus, right_of, unit

END_TOLERANCE_MM = 1e-11
"""How far a curve reaches beyond its ends, so that no ray slips between two curves that share a corner."""

ROUNDING = 1e-15
"""Residual of an oval's equation, relative to its constant, that is nothing but the rounding of its square roots."""


def quadratic_roots(a: float, b: float, c: float, *, leaving: bool) -> tuple[float, ...]:
    """Real roots of a t² + b t + c, without cancellation; with ``leaving`` the root t = 0 is divided out."""
    if leaving:
        return (-b / a,) if a != 0.0 else ()
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return ()
    q = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    first = (q / a,) if a != 0.0 else ()
    second = (c / q,) if q != 0.0 else ()
    return first + second


class Curve(ABC):
    """A directed exact curve."""

    @abstractmethod
    def points(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (N, 2) in mm at parameters ``u`` (N,) in [0, 1], from start to end."""

    @abstractmethod
    def normal_at(self, point: Point) -> Point:
        """Left unit normal at a point of the curve."""

    @abstractmethod
    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Distances > 0 in mm at which a ray (unit direction) meets the curve, in no order.

        ``leaving`` says that the ray starts on this curve; that point is not among the hits.
        """

    @abstractmethod
    def moved(self, motion: Rigid) -> Self:
        """The curve after a rigid motion."""

    @abstractmethod
    def reversed(self) -> Self:
        """The same curve walked from end to start."""

    @property
    def start(self) -> Point:
        """First point, mm."""
        return self._point(0.0)

    @property
    def end(self) -> Point:
        """Last point, mm."""
        return self._point(1.0)

    def flattened(self, tolerance_mm: float = 1e-3) -> NDArray[np.float64]:
        """Polyline (N, 2) through points of the curve that leaves it by at most ``tolerance_mm``.

        Each piece is halved until its middle lies well within the tolerance of its chord.
        """
        u = np.linspace(0.0, 1.0, 9)
        while True:
            ends = self.points(u)
            middles = self.points(0.5 * (u[:-1] + u[1:]))
            chord = ends[1:] - ends[:-1]
            length = np.hypot(chord[:, 0], chord[:, 1])
            offset = middles - ends[:-1]
            sag = np.abs(chord[:, 0] * offset[:, 1] - chord[:, 1] * offset[:, 0]) / np.where(length > 0, length, 1)
            coarse = sag > 0.8 * tolerance_mm
            if not coarse.any() or len(u) > 2**16:
                return ends
            u = np.sort(np.concatenate([u, 0.5 * (u[:-1] + u[1:])[coarse]]))

    def _point(self, u: float) -> Point:
        x, z = self.points(np.array([u]))[0]
        return (float(x), float(z))


@dataclass(frozen=True)
class Segment(Curve):
    """Straight line between two points."""

    a: Point
    b: Point

    @property
    def start(self) -> Point:
        """First point, mm."""
        return self.a

    @property
    def end(self) -> Point:
        """Last point, mm."""
        return self.b

    @property
    def length_mm(self) -> float:
        """Length."""
        return math.dist(self.a, self.b)

    def points(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """See :meth:`Curve.points`."""
        a, b = np.asarray(self.a), np.asarray(self.b)
        return np.asarray((1.0 - u)[:, None] * a + u[:, None] * b)

    def normal_at(self, point: Point) -> Point:  # noqa: ARG002  the normal is the same everywhere
        """See :meth:`Curve.normal_at`."""
        return left_of(unit(minus(self.b, self.a)))

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """See :meth:`Curve.hits`."""
        along_it = unit(minus(self.b, self.a))
        slant = cross(direction, along_it)
        if leaving or slant == 0.0:
            return ()
        to_start = minus(self.a, origin)
        distance = cross(to_start, along_it) / slant
        place = cross(to_start, direction) / slant
        inside = -END_TOLERANCE_MM <= place <= self.length_mm + END_TOLERANCE_MM
        return (distance,) if distance > 0.0 and inside else ()

    def moved(self, motion: Rigid) -> "Segment":
        """See :meth:`Curve.moved`."""
        return Segment(motion.point(self.a), motion.point(self.b))

    def reversed(self) -> "Segment":
        """See :meth:`Curve.reversed`."""
        return Segment(self.b, self.a)


@dataclass(frozen=True)
class Arc(Curve):
    """Part of a circle, or all of it: from ``start_deg`` on by ``sweep_deg`` (counter-clockwise if positive).

    Here angles are polar, from +x: the point at angle a is ``center + radius (cos a, sin a)``.
    """

    center: Point
    radius_mm: float
    start_deg: float
    sweep_deg: float

    @classmethod
    def circle(cls, center: Point, radius_mm: float) -> "Arc":
        """Whole circle, counter-clockwise: its inside is on the left."""
        return cls(center, radius_mm, 0.0, 360.0)

    @classmethod
    def through(cls, a: Point, middle: Point, b: Point) -> "Arc":
        """Arc from ``a`` to ``b`` by way of ``middle``; `ValueError` where the three are on one line."""
        p, q = minus(middle, a), minus(b, a)
        twice_area = cross(p, q)
        if abs(twice_area) <= 1e-14 * math.hypot(*p) * math.hypot(*q):
            raise ValueError(f"no arc through {a}, {middle}, {b}: they lie on one line")
        pp, qq = dot(p, p), dot(q, q)
        to_center = (
            (q[1] * pp - p[1] * qq) / (2 * twice_area),
            (p[0] * qq - q[0] * pp) / (2 * twice_area),
        )
        center = (a[0] + to_center[0], a[1] + to_center[1])
        from_deg = math.degrees(math.atan2(a[1] - center[1], a[0] - center[0]))
        to_deg = math.degrees(math.atan2(b[1] - center[1], b[0] - center[0]))
        turn = (to_deg - from_deg) % 360.0
        return cls(center, math.hypot(*to_center), from_deg, turn if twice_area > 0 else turn - 360.0)

    @property
    def middle(self) -> Point:
        """Unit vector from the centre to the middle of the arc."""
        angle = math.radians(self.start_deg + 0.5 * self.sweep_deg)
        return (math.cos(angle), math.sin(angle))

    @property
    def cos_half(self) -> float:
        """Cosine of half the sweep: what a point's direction must have along the middle to be on the arc."""
        return math.cos(math.radians(min(abs(self.sweep_deg), 360.0) / 2))

    def points(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """See :meth:`Curve.points`."""
        angle = np.radians(self.start_deg + u * self.sweep_deg)
        x, z = self.center
        return np.column_stack([x + self.radius_mm * np.cos(angle), z + self.radius_mm * np.sin(angle)])

    def normal_at(self, point: Point) -> Point:
        """See :meth:`Curve.normal_at`."""
        outward = unit(minus(point, self.center))
        return (-outward[0], -outward[1]) if self.sweep_deg > 0 else outward

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """See :meth:`Curve.hits`."""
        from_center = minus(origin, self.center)
        roots = quadratic_roots(
            1.0,
            2.0 * dot(from_center, direction),
            dot(from_center, from_center) - self.radius_mm**2,
            leaving=leaving,
        )
        return tuple(t for t in roots if t > 0.0 and self._holds(along(origin, direction, t)))

    def moved(self, motion: Rigid) -> "Arc":
        """See :meth:`Curve.moved`."""
        turn_deg = math.degrees(math.atan2(motion.sin, motion.cos))
        return replace(self, center=motion.point(self.center), start_deg=self.start_deg + turn_deg)

    def reversed(self) -> "Arc":
        """See :meth:`Curve.reversed`."""
        return replace(self, start_deg=self.start_deg + self.sweep_deg, sweep_deg=-self.sweep_deg)

    def _holds(self, point: Point) -> bool:
        reach = dot(minus(point, self.center), self.middle)
        return reach >= self.radius_mm * self.cos_half - END_TOLERANCE_MM


@dataclass(frozen=True)
class Parabola(Curve):
    """Part of a parabola: ``vertex + u axis + curve_per_mm u² right_of(axis)``, u from ``from_mm`` to ``to_mm``.

    With the axis along +z this is x = x0 + c (z − z0)²: the flared side of a stem. ``axis`` is a unit vector.
    """

    vertex: Point
    axis: Point
    curve_per_mm: float
    from_mm: float
    to_mm: float

    def points(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """See :meth:`Curve.points`."""
        run = self.from_mm + u * (self.to_mm - self.from_mm)
        side = right_of(self.axis)
        rise = self.curve_per_mm * run * run
        return np.asarray(np.asarray(self.vertex) + np.outer(run, self.axis) + np.outer(rise, side))

    def normal_at(self, point: Point) -> Point:
        """See :meth:`Curve.normal_at`."""
        run = dot(minus(point, self.vertex), self.axis)
        slope = 2.0 * self.curve_per_mm * run
        side = right_of(self.axis)
        tangent = unit((self.axis[0] + slope * side[0], self.axis[1] + slope * side[1]))
        return left_of(tangent) if self.to_mm > self.from_mm else right_of(tangent)

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """See :meth:`Curve.hits`."""
        side, start = right_of(self.axis), minus(origin, self.vertex)
        run, rise = dot(start, self.axis), dot(start, side)
        d_run, d_rise = dot(direction, self.axis), dot(direction, side)
        c = self.curve_per_mm
        roots = quadratic_roots(-c * d_run**2, d_rise - 2.0 * c * run * d_run, rise - c * run**2, leaving=leaving)
        low, high = sorted((self.from_mm, self.to_mm))
        return tuple(
            t for t in roots if t > 0.0 and low - END_TOLERANCE_MM <= run + t * d_run <= high + END_TOLERANCE_MM
        )

    def moved(self, motion: Rigid) -> "Parabola":
        """See :meth:`Curve.moved`."""
        return replace(self, vertex=motion.point(self.vertex), axis=motion.vector(self.axis))

    def reversed(self) -> "Parabola":
        """See :meth:`Curve.reversed`."""
        return replace(self, from_mm=self.to_mm, to_mm=self.from_mm)


@dataclass(frozen=True)
class CartesianOval(Curve):
    """Front of a Cartesian oval: n1 |P − F1| + n2 |P − F2| = n1 s + n2 s', between two angles seen from F1.

    ``vertex`` lies on the oval and ``axis`` (a unit vector) points from it into the material; F1 is ``object_mm`` (s)
    before the vertex, F2 ``image_mm`` (s') behind it, and n2 > n1. Walked from ``from_deg`` to ``to_deg``: angles at
    F1, counter-clockwise from the axis. For a given angle the equation is quadratic in the distance from F1 and its
    smaller root is the front; the back of the oval, near the far focus, is the other root and is never taken.

    Along any straight line the left side is a convex function (a sum of distances) and the inside is a convex region:
    a ray meets it at most twice, and Newton's method started outside converges to the nearer root without overshoot.
    """

    vertex: Point
    axis: Point
    n1: float
    n2: float
    object_mm: float
    image_mm: float
    from_deg: float
    to_deg: float

    @property
    def constant_mm(self) -> float:
        """Optical path from focus to focus, n1 s + n2 s'."""
        return self.n1 * self.object_mm + self.n2 * self.image_mm

    @property
    def object_focus(self) -> Point:
        """F1."""
        return along(self.vertex, self.axis, -self.object_mm)

    @property
    def image_focus(self) -> Point:
        """F2."""
        return along(self.vertex, self.axis, self.image_mm)

    @property
    def depth_mm(self) -> float:
        """How far along the axis from the vertex this piece reaches."""
        ends = self.points(np.array([0.0, 1.0])) - np.asarray(self.vertex)
        return float(np.max(ends @ np.asarray(self.axis)))

    def radius_from_object(self, angle_deg: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance in mm from F1 to the front at angles from the axis; NaN where the line misses the oval.

        The smaller root of (n2²−n1²) r² − 2 (n2² D cos φ − n1 C) r + n2² D² − C² = 0; D = s + s', C the constant.
        """
        n1, n2, c = self.n1, self.n2, self.constant_mm
        d = self.object_mm + self.image_mm
        a = n2**2 - n1**2
        half_b = n2**2 * d * np.cos(np.radians(angle_deg)) - n1 * c
        rest = (n2 - n1) * self.object_mm * (n2 * d + c)  # n2² D² − C² without its cancellation
        discriminant = half_b**2 - a * rest
        with np.errstate(invalid="ignore"):
            return np.asarray(np.where(half_b > 0, rest / (half_b + np.sqrt(discriminant)), np.nan))

    def points(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """See :meth:`Curve.points`."""
        angle_deg = self.from_deg + u * (self.to_deg - self.from_deg)
        radius, angle = self.radius_from_object(angle_deg), np.radians(angle_deg)
        forward, lateral = radius * np.cos(angle), radius * np.sin(angle)
        return np.asarray(
            np.asarray(self.object_focus) + np.outer(forward, self.axis) + np.outer(lateral, left_of(self.axis))
        )

    def normal_at(self, point: Point) -> Point:
        """See :meth:`Curve.normal_at`."""
        to_1, to_2 = unit(minus(point, self.object_focus)), unit(minus(point, self.image_focus))
        outward = unit((self.n1 * to_1[0] + self.n2 * to_2[0], self.n1 * to_1[1] + self.n2 * to_2[1]))
        return outward if self.to_deg > self.from_deg else (-outward[0], -outward[1])

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """See :meth:`Curve.hits`."""
        depth = self.depth_mm + END_TOLERANCE_MM
        return tuple(
            t
            for t in self._roots(origin, direction, leaving)
            if t > 0.0 and dot(minus(along(origin, direction, t), self.vertex), self.axis) <= depth
        )

    def moved(self, motion: Rigid) -> "CartesianOval":
        """See :meth:`Curve.moved`."""
        return replace(self, vertex=motion.point(self.vertex), axis=motion.vector(self.axis))

    def reversed(self) -> "CartesianOval":
        """See :meth:`Curve.reversed`."""
        return replace(self, from_deg=self.to_deg, to_deg=self.from_deg)

    def residual_mm(self, point: Point) -> float:
        """Left side of the oval's equation minus its right side: 0 on the curve, negative inside."""
        return (
            self.n1 * math.dist(point, self.object_focus)
            + self.n2 * math.dist(point, self.image_focus)
            - self.constant_mm
        )

    def _roots(self, origin: Point, direction: Point, leaving: bool) -> Iterator[float]:
        """Where a line meets the whole oval: both roots, or the far one alone when the ray stands on the near one."""
        from_focus = minus(origin, self.image_focus)
        circle_mm = self.constant_mm / self.n2  # about F2; the oval lies inside it
        middle, nearest = -dot(from_focus, direction), cross(from_focus, direction)
        if abs(nearest) >= circle_mm or (leaving and self._slope(origin, direction) >= 0.0):
            return
        reach = math.sqrt(circle_mm**2 - nearest**2)
        for outwards in (1.0,) if leaving else (-1.0, 1.0):
            root = self._newton(origin, direction, middle + outwards * reach, outwards)
            if root is not None:
                yield root

    def _newton(self, origin: Point, direction: Point, start: float, outwards: float) -> float | None:
        """Root reached from a start outside the oval; ``outwards`` is the sign of the slope there."""
        t = start
        for _ in range(200):
            p = along(origin, direction, t)
            value, slope = self.residual_mm(p), self._slope(p, direction)
            if slope * outwards <= 0.0:
                return None  # past the lowest point without a root: the line misses the oval
            t -= value / slope
            if value <= ROUNDING * self.constant_mm:
                return t
        return None

    def _slope(self, point: Point, direction: Point) -> float:
        """Derivative of the residual along a direction."""
        to_1, to_2 = unit(minus(point, self.object_focus)), unit(minus(point, self.image_focus))
        return self.n1 * dot(to_1, direction) + self.n2 * dot(to_2, direction)

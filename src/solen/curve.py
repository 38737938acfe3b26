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

from solen.errors import DesignError
from solen.plane import Point, Rigid, along, cross, dot, left_of, minus, right_of, unit

END_TOLERANCE_MM = 1e-11
"""How far a curve reaches beyond its ends, so that no ray slips between two curves that share a corner."""

ROUNDING = 4e-16
"""Relative to the lengths it was computed from, a residual that is nothing but rounding."""
MOST_POINTS = 2**16
SMALL = 1e-3
"""How small the constant term of a quadratic must be for its root to be mended to first order."""


def quadratic_roots(a: float, b: float, c: float, *, leaving: bool) -> tuple[float, ...]:
    """Real roots of a t² + b t + c, without cancellation; with ``leaving`` the root next to t = 0 is divided out.

    The point a ray leaves from lies on its curve but for rounding, which leaves a tiny c. The other root −b/a is mended
    by it to first order, or the rounding of many chords of one circle would add up until they leave it.
    """
    if leaving:
        mend = c / b if abs(a * c) < SMALL * b * b else 0.0
        return (-b / a + mend,) if a != 0.0 else ()
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return ()
    q = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    first = (q / a,) if a != 0.0 else ()
    second = (c / q,) if q != 0.0 else ()
    return first + second


def check_numbers(what: str, *values: object) -> None:
    """`DesignError` where one of the values is not finite, or not a number at all."""
    for value in values:
        if not (isinstance(value, int | float) and math.isfinite(value)):
            raise DesignError(what, value=repr(value), limit="must be a finite number")


def check_count(what: str, value: object, least: int) -> None:
    """`DesignError` where a value is not a whole number of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise DesignError(what, value=value, limit=f"must be a whole number of at least {least}")


def check_points(what: str, *points: object) -> None:
    """`DesignError` where one of the points is not a pair of finite numbers."""
    for point in points:
        if not (isinstance(point, tuple) and len(point) == 2):
            raise DesignError(what, value=repr(point), limit="must be a pair (x, z)")
        check_numbers(what, *point)


def _check_axis(what: str, axis: Point) -> None:
    check_points(what, axis)
    if abs(math.hypot(*axis) - 1.0) > 1e-9:
        raise DesignError(what, value=axis, limit="must be a unit vector")


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

    @property
    def middle_point(self) -> Point:
        """Point halfway along the parameter, mm."""
        return self._point(0.5)

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
            if not coarse.any():
                return ends
            if len(u) > MOST_POINTS:
                raise DesignError(
                    "tolerance_mm", value=tolerance_mm, limit=f"would take more than {MOST_POINTS} points"
                )
            u = np.sort(np.concatenate([u, 0.5 * (u[:-1] + u[1:])[coarse]]))

    def _point(self, u: float) -> Point:
        x, z = self.points(np.array([u]))[0]
        return (float(x), float(z))


@dataclass(frozen=True)
class Segment(Curve):
    """Straight line between two points; `DesignError` where they are one."""

    a: Point
    b: Point

    def __post_init__(self) -> None:
        check_points("segment", self.a, self.b)
        if self.a == self.b:
            raise DesignError("segment", value=f"from {self.a} to itself", limit="must have a length")

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

    def flattened(self, tolerance_mm: float = 1e-3) -> NDArray[np.float64]:  # noqa: ARG002  it is straight
        """See :meth:`Curve.flattened`."""
        return np.array([self.a, self.b])

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

    def __post_init__(self) -> None:
        check_points("arc", self.center)
        check_numbers("arc", self.radius_mm, self.start_deg, self.sweep_deg)
        if not self.radius_mm > 0.0:
            raise DesignError("arc radius_mm", value=self.radius_mm, limit="must be above 0")
        if not 0.0 < abs(self.sweep_deg) <= 360.0 + 1e-9:
            raise DesignError("arc sweep_deg", value=self.sweep_deg, limit="must be from -360 to 360 and not 0")

    @classmethod
    def circle(cls, center: Point, radius_mm: float) -> "Arc":
        """Whole circle, counter-clockwise: its inside is on the left."""
        return cls(center, radius_mm, 0.0, 360.0)

    @classmethod
    def through(cls, a: Point, middle: Point, b: Point) -> "Arc":
        """Arc from ``a`` to ``b`` by way of ``middle``.

        `DesignError` where it is all but straight: its centre could not be placed to 1e-9 mm.
        """
        check_points("arc", a, middle, b)
        p, q = minus(middle, a), minus(b, a)
        twice_area = cross(p, q)
        r = minus(b, middle)
        if not abs(twice_area) > 1e-6 * max(dot(p, p), dot(q, q), dot(r, r)):
            raise DesignError(
                "arc", value=f"through {a}, {middle}, {b}", limit="the three lie on one line", remedy="use a segment"
            )
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
    def half_deg(self) -> float:
        """Half the angle it spans, at most 180."""
        return min(0.5 * abs(self.sweep_deg), 180.0)

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
        half_b = dot(from_center, direction)
        rest = dot(from_center, from_center) - self.radius_mm**2
        roots: tuple[float, ...] = ()
        if leaving:
            roots = quadratic_roots(1.0, 2.0 * half_b, rest, leaving=True)
        else:
            passes_mm = abs(cross(from_center, direction))  # far away, rounding would drown b² − 4ac
            square = (self.radius_mm - passes_mm) * (self.radius_mm + passes_mm)
            if square >= 0.0:
                q = -half_b - math.copysign(math.sqrt(square), half_b)
                roots = (q, rest / q) if q != 0.0 else ()
        return tuple(t for t in roots if t > 0.0 and self._holds(along(origin, direction, t)))

    def moved(self, motion: Rigid) -> "Arc":
        """See :meth:`Curve.moved`."""
        turn_deg = math.degrees(math.atan2(motion.sin, motion.cos))
        return replace(self, center=motion.point(self.center), start_deg=self.start_deg + turn_deg)

    def reversed(self) -> "Arc":
        """See :meth:`Curve.reversed`."""
        return replace(self, start_deg=self.start_deg + self.sweep_deg, sweep_deg=-self.sweep_deg)

    def _holds(self, point: Point) -> bool:
        """Whether a point of the circle lies on the arc: by its distance from the arc's axis of symmetry."""
        offset = minus(point, self.center)
        beside = abs(cross(self.middle, offset))
        end = self.radius_mm * math.sin(math.radians(self.half_deg))
        if self.half_deg <= 90.0:
            return dot(self.middle, offset) >= -END_TOLERANCE_MM and beside <= end + END_TOLERANCE_MM
        return dot(self.middle, offset) >= 0.0 or beside >= end - END_TOLERANCE_MM


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

    def __post_init__(self) -> None:
        check_points("parabola", self.vertex)
        _check_axis("parabola axis", self.axis)
        check_numbers("parabola", self.curve_per_mm, self.from_mm, self.to_mm)
        if self.from_mm == self.to_mm:
            raise DesignError("parabola", value=f"from {self.from_mm} mm to itself", limit="must have a length")

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

    def __post_init__(self) -> None:
        check_points("oval", self.vertex)
        _check_axis("oval axis", self.axis)
        check_numbers("oval", self.n1, self.n2, self.object_mm, self.image_mm, self.from_deg, self.to_deg)
        if not (self.n2 > self.n1 > 0.0 and self.object_mm > 0.0 and self.image_mm > 0.0):
            found = f"n1 {self.n1}, n2 {self.n2}, object_mm {self.object_mm}, image_mm {self.image_mm}"
            raise DesignError("oval", value=found, limit="needs n2 above n1 and both distances above 0")
        if self.from_deg == self.to_deg or np.isnan(self.points(np.array([0.0, 1.0]))).any():
            found = f"from {self.from_deg} to {self.to_deg} deg"
            raise DesignError(
                "oval", value=found, limit="must have a length and end before its tangents from the object"
            )

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
        roots = self._roots(origin, direction, leaving)
        return tuple(t for t in roots if t > 0.0 and self._holds(along(origin, direction, t)))

    def moved(self, motion: Rigid) -> "CartesianOval":
        """See :meth:`Curve.moved`."""
        return replace(self, vertex=motion.point(self.vertex), axis=motion.vector(self.axis))

    def reversed(self) -> "CartesianOval":
        """See :meth:`Curve.reversed`."""
        return replace(self, from_deg=self.to_deg, to_deg=self.from_deg)

    def residual_mm(self, point: Point) -> float:
        """Left side of the oval's equation minus its right side: 0 on the curve, negative inside.

        |P − F1| − s and |P − F2| − s' are differences of squares over sums, exact also where a focus is far away.
        """
        offset = minus(point, self.vertex)
        square, forward = dot(offset, offset), dot(offset, self.axis)
        to_1, to_2 = math.dist(point, self.object_focus), math.dist(point, self.image_focus)
        first = (square + 2.0 * self.object_mm * forward) / (to_1 + self.object_mm)
        second = (square - 2.0 * self.image_mm * forward) / (to_2 + self.image_mm)
        return self.n1 * first + self.n2 * second

    @property
    def end_rays(self) -> tuple[Point, Point]:
        """Unit directions from F1 to the end on the right of the axis and to the one on its left."""
        right, left = sorted((self.from_deg, self.to_deg))
        turn = (Rigid.about((0.0, 0.0), right), Rigid.about((0.0, 0.0), left))
        return turn[0].vector(self.axis), turn[1].vector(self.axis)

    def _holds(self, point: Point) -> bool:
        """Whether a point of the oval is on this piece: between the rays from F1 to its ends, facing F1."""
        ray = minus(point, self.object_focus)
        right, left = self.end_rays
        within = cross(right, ray) >= -END_TOLERANCE_MM and cross(left, ray) <= END_TOLERANCE_MM
        return within and self._slope(point, ray) < 0.0

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
            lengths = abs(t) + math.dist(p, self.vertex)
            if value <= ROUNDING * lengths * (self.n1 + self.n2) or abs(value) <= ROUNDING * abs(t * slope):
                return t
        return None

    def _slope(self, point: Point, direction: Point) -> float:
        """Derivative of the residual along a direction."""
        to_1, to_2 = unit(minus(point, self.object_focus)), unit(minus(point, self.image_focus))
        return self.n1 * dot(to_1, direction) + self.n2 * dot(to_2, direction)

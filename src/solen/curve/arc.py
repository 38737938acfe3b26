"""The circle and its arcs."""

import math
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import END_TOLERANCE_MM, Curve, check_numbers, check_points, check_range, quadratic_roots
from solen.errors import DesignError
from solen.plane import Point, Rigid, along, cross, dot, minus, unit


@dataclass(frozen=True)
class Arc(Curve):
    """Part of a circle, or a full one: from ``start_deg`` over ``sweep_deg`` (counter-clockwise if positive).

    Angles here are polar, from +x: the point at angle a is ``center + radius (cos a, sin a)``.
    """

    center: Point
    radius_mm: float
    start_deg: float
    sweep_deg: float

    def __post_init__(self) -> None:
        check_points("arc", self.center)
        check_numbers("arc", self.start_deg, self.sweep_deg)
        check_range("arc radius_mm", self.radius_mm, above=0.0)
        if not 0.0 < abs(self.sweep_deg) <= 360.0 + 1e-9:
            raise DesignError("arc sweep_deg", value=self.sweep_deg, limit="must be from -360 to 360 and not 0")

    @classmethod
    def circle(cls, center: Point, radius_mm: float) -> "Arc":
        """Return a full circle, counter-clockwise, so that its inside is on the left."""
        return cls(center, radius_mm, 0.0, 360.0)

    @classmethod
    def through(cls, a: Point, middle: Point, b: Point) -> "Arc":
        """Return the arc from ``a`` to ``b`` through ``middle``.

        Raise `DesignError` if the arc is too nearly straight to determine its centre to 1e-9 mm.
        """
        check_points("arc", a, middle, b)
        p, q = minus(middle, a), minus(b, a)
        twice_area = cross(p, q)
        r = minus(b, middle)
        if not abs(twice_area) > 1e-6 * max(dot(p, p), dot(q, q), dot(r, r)):
            raise DesignError(
                "arc through points",
                value=(a, middle, b),
                limit="must not be on one line",
                remedy="use a segment",
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
        """Unit vector from the centre to the midpoint of the arc."""
        angle = math.radians(self.start_deg + 0.5 * self.sweep_deg)
        return (math.cos(angle), math.sin(angle))

    @property
    def half_deg(self) -> float:
        """Half the angle subtended by the arc, at most 180."""
        return min(0.5 * abs(self.sweep_deg), 180.0)

    def points(self, u: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm at parameters ``u`` (N,) in [0, 1]."""
        angle = np.radians(self.start_deg + u * self.sweep_deg)
        x, z = self.center
        return np.column_stack([x + self.radius_mm * np.cos(angle), z + self.radius_mm * np.sin(angle)])

    def velocities(self, u: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2) of `points` with respect to their parameter, mm."""
        angle = np.radians(self.start_deg + u * self.sweep_deg)
        per_u = self.radius_mm * math.radians(self.sweep_deg)
        return np.column_stack([-per_u * np.sin(angle), per_u * np.cos(angle)])

    def part(self, u_from: float, u_to: float) -> "Arc":
        """Return the part of the curve from one parameter to a larger one."""
        start_deg = self.start_deg + u_from * self.sweep_deg
        return replace(self, start_deg=start_deg, sweep_deg=(u_to - u_from) * self.sweep_deg)

    def normal_at(self, point: Point) -> Point:
        """Return the left unit normal at a point of the curve."""
        outward = unit(minus(point, self.center))
        return (-outward[0], -outward[1]) if self.sweep_deg > 0 else outward

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Return the distances > 0 in mm at which a ray meets the curve, in any order."""
        from_center = minus(origin, self.center)
        half_b = dot(from_center, direction)
        rest = dot(from_center, from_center) - self.radius_mm**2
        roots: tuple[float, ...] = ()
        if leaving:
            roots = quadratic_roots(1.0, 2.0 * half_b, rest, leaving=True)
        else:
            nearest_mm = abs(cross(from_center, direction))  # for a distant origin, rounding would swamp b² − 4ac
            square = (self.radius_mm - nearest_mm) * (self.radius_mm + nearest_mm)
            if square > 0.0:  # a tangent line does not cross the arc
                q = -half_b - math.copysign(math.sqrt(square), half_b)
                roots = (q, rest / q) if q != 0.0 else ()
        return tuple(t for t in roots if t > 0.0 and self._holds(along(origin, direction, t)))

    def moved(self, motion: Rigid) -> "Arc":
        """Return the curve after a rigid motion."""
        turn_deg = math.degrees(math.atan2(motion.sin, motion.cos))
        return replace(self, center=motion.point(self.center), start_deg=self.start_deg + turn_deg)

    def reversed(self) -> "Arc":
        """Return the same curve traversed from end to start."""
        return replace(self, start_deg=self.start_deg + self.sweep_deg, sweep_deg=-self.sweep_deg)

    def _holds(self, point: Point) -> bool:
        """Return whether a point on the circle is on the arc, from its distance from the arc's axis of symmetry."""
        offset = minus(point, self.center)
        lateral = abs(cross(self.middle, offset))
        end = self.radius_mm * math.sin(math.radians(self.half_deg))
        if self.half_deg <= 90.0:
            return dot(self.middle, offset) >= -END_TOLERANCE_MM and lateral <= end + END_TOLERANCE_MM
        return dot(self.middle, offset) >= 0.0 or lateral >= end - END_TOLERANCE_MM

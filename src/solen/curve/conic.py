"""Conic sections: the parabola of a flared stem, and general conics in the vertex form used in optics."""

import math
from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import END_TOLERANCE_MM, Curve, check_axis, check_numbers, check_points, quadratic_roots
from solen.errors import DesignError
from solen.plane import Point, Rigid, dot, left_of, minus, right_of, unit


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
        check_axis("parabola axis", self.axis)
        check_numbers("parabola", self.curve_per_mm, self.from_mm, self.to_mm)
        if self.from_mm == self.to_mm:
            raise DesignError("parabola from_mm and to_mm", value=self.from_mm, limit="must differ")

    def points(self, u: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm at parameters ``u`` (N,) in [0, 1]."""
        run = self.from_mm + u * (self.to_mm - self.from_mm)
        side = right_of(self.axis)
        rise = self.curve_per_mm * run * run
        return np.asarray(np.asarray(self.vertex) + np.outer(run, self.axis) + np.outer(rise, side))

    def velocities(self, u: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2) of `points` with respect to their parameter, mm."""
        per_u = self.to_mm - self.from_mm
        run = self.from_mm + u * per_u
        slope = 2.0 * self.curve_per_mm * run
        return np.asarray(per_u * (np.asarray(self.axis) + np.outer(slope, right_of(self.axis))))

    def part(self, u_from: float, u_to: float) -> "Parabola":
        """Return the part of the curve from one parameter to a larger one."""
        per_u = self.to_mm - self.from_mm
        return replace(self, from_mm=self.from_mm + u_from * per_u, to_mm=self.from_mm + u_to * per_u)

    def normal_at(self, point: Point) -> Point:
        """Return the left unit normal at a point of the curve."""
        run = dot(minus(point, self.vertex), self.axis)
        slope = 2.0 * self.curve_per_mm * run
        side = right_of(self.axis)
        tangent = unit((self.axis[0] + slope * side[0], self.axis[1] + slope * side[1]))
        return left_of(tangent) if self.to_mm > self.from_mm else right_of(tangent)

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Return the distances > 0 in mm at which a ray meets the curve, in any order."""
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
        """Return the curve after a rigid motion."""
        return replace(self, vertex=motion.point(self.vertex), axis=motion.vector(self.axis))

    def reversed(self) -> "Parabola":
        """Return the same curve traversed from end to start."""
        return replace(self, from_mm=self.to_mm, to_mm=self.from_mm)


MIN_RADICAND = 1e-6
"""Minimum 1 − (1 + K) c² r² at an end of a conic; closer to the widest point, r hardly changes along the curve."""
MIN_ON_VERTEX_SIDE = -1e-9
"""Minimum 1 − (1 + K) c w on the vertex side of a conic: it is 0 at the widest point, but for rounding, and negative
beyond.
"""


@dataclass(frozen=True)
class Conic(Curve):
    """Part of a conic section in vertex form, c r² − 2 w + (1 + K) c w² = 0, w along the axis and r across it.

    r is positive on the right of ``axis`` (a unit vector): with the axis along +z, r is x − x0 and w is z − z0. c is
    ``curvature_per_mm``, 1 over the vertex radius, positive if the curve bends to where ``axis`` points; K is
    ``conic_constant``: 0 for a circle, −1 for a parabola, below −1 for a hyperbola, above −1 for an ellipse (oblate for
    K > 0). The curve runs from r = ``from_mm`` to ``to_mm``, and both ends are before its widest point: it is on the
    vertex side and, for a hyperbola, on the vertex branch. The other side and the other branch satisfy the equation but
    are not part of the curve.
    """

    vertex: Point
    axis: Point
    curvature_per_mm: float
    conic_constant: float
    from_mm: float
    to_mm: float

    def __post_init__(self) -> None:
        check_points("conic", self.vertex)
        check_axis("conic axis", self.axis)
        check_numbers("conic", self.curvature_per_mm, self.conic_constant, self.from_mm, self.to_mm)
        if self.from_mm == self.to_mm:
            raise DesignError("conic from_mm and to_mm", value=self.from_mm, limit="must differ")
        for name, end_mm in (("from_mm", self.from_mm), ("to_mm", self.to_mm)):
            if not self._radicand(end_mm) >= MIN_RADICAND:
                raise DesignError(
                    f"conic {name}",
                    value=end_mm,
                    limit=f"must be within {math.sqrt(1.0 - MIN_RADICAND) * self.half_width_mm:.9g} mm of the axis",
                    remedy="end the conic nearer to the axis, or reduce the curvature or the conic constant",
                )

    @property
    def half_width_mm(self) -> float:
        """Distance from the axis at which the curve is widest and turns back; finite for an ellipse only."""
        c, k = self.curvature_per_mm, self.conic_constant
        return 1.0 / (abs(c) * math.sqrt(1.0 + k)) if k > -1.0 and c != 0.0 else math.inf

    def sag_mm(self, lateral_mm: FloatArray) -> FloatArray:
        """Return the sag w along the axis at distances r from it: c r² / (1 + √(1 − (1 + K) c² r²))."""
        c, r = self.curvature_per_mm, lateral_mm
        return np.asarray(c * r * r / (1.0 + np.sqrt(1.0 - (1.0 + self.conic_constant) * (c * r) ** 2)))

    def points(self, u: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm at parameters ``u`` (N,) in [0, 1]."""
        lateral = (1.0 - u) * self.from_mm + u * self.to_mm
        across = np.outer(lateral, right_of(self.axis))
        return np.asarray(np.asarray(self.vertex) + across + np.outer(self.sag_mm(lateral), self.axis))

    def velocities(self, u: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2) of `points` with respect to their parameter, mm."""
        per_u, c = self.to_mm - self.from_mm, self.curvature_per_mm
        lateral = (1.0 - u) * self.from_mm + u * self.to_mm
        slope = c * lateral / np.sqrt(1.0 - (1.0 + self.conic_constant) * (c * lateral) ** 2)
        return np.asarray(per_u * (np.asarray(right_of(self.axis)) + np.outer(slope, self.axis)))

    def part(self, u_from: float, u_to: float) -> "Conic":
        """Return the part of the curve from one parameter to a larger one."""
        ends = [(1.0 - u) * self.from_mm + u * self.to_mm for u in (u_from, u_to)]
        return replace(self, from_mm=ends[0], to_mm=ends[1])

    def normal_at(self, point: Point) -> Point:
        """Return the left unit normal at a point of the curve."""
        lateral, depth = self._frame(minus(point, self.vertex))
        tangent = unit(self._tangent(lateral, depth))
        side, sign = right_of(self.axis), 1.0 if self.to_mm > self.from_mm else -1.0
        forwards = (
            sign * (tangent[0] * side[0] + tangent[1] * self.axis[0]),
            sign * (tangent[0] * side[1] + tangent[1] * self.axis[1]),
        )
        return left_of(forwards)

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Return the distances > 0 in mm at which a ray meets the curve, in any order."""
        c, k = self.curvature_per_mm, self.conic_constant
        start = minus(origin, self.vertex)
        # Distances from the point nearest to the vertex: for a distant origin, rounding would swamp b² − 4ac.
        to_nearest = 0.0 if leaving else -dot(start, direction)
        r, w = self._frame((start[0] + to_nearest * direction[0], start[1] + to_nearest * direction[1]))
        dr, dw = self._frame(direction)
        square = c * (dr * dr + (1.0 + k) * dw * dw)
        linear = 2.0 * (c * r * dr - dw + (1.0 + k) * c * w * dw)
        rest = c * r * r - 2.0 * w + (1.0 + k) * c * w * w
        roots = quadratic_roots(square, linear, rest, leaving=leaving)
        return tuple(to_nearest + t for t in roots if to_nearest + t > 0.0 and self._holds(r + t * dr, w + t * dw))

    def moved(self, motion: Rigid) -> "Conic":
        """Return the curve after a rigid motion."""
        return replace(self, vertex=motion.point(self.vertex), axis=motion.vector(self.axis))

    def reversed(self) -> "Conic":
        """Return the same curve traversed from end to start."""
        return replace(self, from_mm=self.to_mm, to_mm=self.from_mm)

    def _frame(self, vector: Point) -> Point:
        """Return a vector as (r, w)."""
        return (dot(vector, right_of(self.axis)), dot(vector, self.axis))

    def _radicand(self, lateral_mm: float) -> float:
        return 1.0 - (1.0 + self.conic_constant) * (self.curvature_per_mm * lateral_mm) ** 2

    def _tangent(self, lateral: float, depth: float) -> Point:
        """Return a tangent vector (1 − (1 + K) c w, c r), towards increasing r; its r is 0 at the widest point."""
        c = self.curvature_per_mm
        return (1.0 - (1.0 + self.conic_constant) * c * depth, c * lateral)

    def _holds(self, lateral: float, depth: float) -> bool:
        """Return whether a point of the full conic is on this part: on the vertex's side and not beyond either end."""
        low, high = sorted((self.from_mm, self.to_mm))
        on_vertex_side = self._tangent(lateral, depth)[0] > MIN_ON_VERTEX_SIDE
        past = max(self._past_mm(lateral, depth, high, 1.0), self._past_mm(lateral, depth, low, -1.0))
        return on_vertex_side and past <= END_TOLERANCE_MM

    def _past_mm(self, lateral: float, depth: float, end_mm: float, outwards: float) -> float:
        """Return the distance of a point beyond an end, along the tangent there.

        Near the widest point, r hardly changes along the curve. From the vertex the curve turns by less than 90 degrees
        in either direction, so this distance increases monotonically. ``outwards`` is the sign of increasing distance.
        """
        if lateral * end_mm < 0.0:
            return outwards * (lateral - end_mm)
        end_depth = float(self.sag_mm(np.array(end_mm)))
        tangent = unit(self._tangent(end_mm, end_depth))
        return outwards * dot((lateral - end_mm, depth - end_depth), tangent)

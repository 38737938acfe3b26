"""Base class of curves, with their tolerances, checks of numbers, and quadratic equations."""

import math
from abc import ABC, abstractmethod
from typing import Self

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DesignError
from solen.plane import Point, Rigid

END_TOLERANCE_MM = 1e-11
"""Distance by which a curve extends beyond its ends, so that no ray slips between two curves that share a corner."""

ROUNDING = 4e-16
"""Residual due to rounding, relative to the lengths from which it was computed."""
MAX_POINTS = 2**16
SMALL = 1e-3
"""Largest constant term of a polynomial, relative to its other terms, for which a root is corrected to first order."""


def quadratic_roots(a: float, b: float, c: float, *, leaving: bool) -> tuple[float, ...]:
    """Return the real roots of a t² + b t + c, without cancellation; ``leaving`` divides out the root next to t = 0.

    A double root is omitted: a line that only touches a curve does not cross it.

    The starting point of a ray is on its curve only to within rounding error, which leaves a tiny c. The other root
    −b/a is corrected for c to first order; otherwise the rounding errors of many chords of one circle would add up
    until the chords leave it.
    """
    if leaving:
        correction = c / b if abs(a * c) < SMALL * b * b else 0.0
        return (-b / a + correction,) if a != 0.0 else ()
    discriminant = b * b - 4.0 * a * c
    if discriminant <= 0.0:
        return ()
    q = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    first = (q / a,) if a != 0.0 else ()
    second = (c / q,) if q != 0.0 else ()
    return first + second


def check_numbers(what: str, *values: object) -> None:
    """Raise `DesignError` if one of the values is not a finite number."""
    for value in values:
        if not (isinstance(value, int | float) and math.isfinite(value)):
            raise DesignError(what, value=repr(value), limit="must be a finite number")


def check_range(
    what: str, value: float, least: float = -math.inf, most: float = math.inf, *, above: float = -math.inf
) -> None:
    """Raise `DesignError` unless a value is a finite number from ``least`` to ``most`` and greater than ``above``."""
    check_numbers(what, value)
    if least <= value <= most and value > above:
        return
    limits = [f"above {above:g}" if above > -math.inf else "", f"at least {least:g}" if least > -math.inf else ""]
    limits.append(f"at most {most:g}" if most < math.inf else "")
    raise DesignError(what, value=value, limit=f"must be {' and '.join(filter(None, limits))}")


def check_count(what: str, value: object, least: int) -> None:
    """Raise `DesignError` if a value is not an integer of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise DesignError(what, value=value, limit=f"must be an integer of at least {least}")
    if value >= 2**63:
        raise DesignError(what, limit="must be below 2 to the power of 63")


def check_points(what: str, *points: object) -> None:
    """Raise `DesignError` if one of the points is not a pair of finite numbers."""
    for point in points:
        if not (isinstance(point, tuple) and len(point) == 2):
            raise DesignError(what, value=repr(point), limit="must be a pair (x, z)")
        check_numbers(what, *point)


def check_axis(what: str, axis: Point) -> None:
    """Raise `DesignError` if a direction is not a unit vector."""
    check_points(what, axis)
    if abs(math.hypot(*axis) - 1.0) > 1e-9:
        raise DesignError(what, value=axis, limit="must be a unit vector")


class Curve(ABC):
    """A directed exact curve."""

    @abstractmethod
    def points(self, u: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm at parameters ``u`` (N,) in [0, 1], from start to end."""

    @abstractmethod
    def velocities(self, u: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2) of `points` with respect to their parameter, mm."""

    @abstractmethod
    def part(self, u_from: float, u_to: float) -> "Curve":
        """Return the part of the curve from one parameter to a larger one; all its points are exactly on the curve."""

    @abstractmethod
    def normal_at(self, point: Point) -> Point:
        """Return the left unit normal at a point of the curve."""

    @abstractmethod
    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Return the distances > 0 in mm at which a ray (unit direction) meets the curve, in any order.

        ``leaving`` means that the ray starts on this curve; its starting point is then not one of the intersections.
        """

    @abstractmethod
    def moved(self, motion: Rigid) -> Self:
        """Return the curve after a rigid motion."""

    @abstractmethod
    def reversed(self) -> Self:
        """Return the same curve traversed from end to start."""

    @property
    def start(self) -> Point:
        """First point, mm."""
        return self.point_at(0.0)

    @property
    def end(self) -> Point:
        """Last point, mm."""
        return self.point_at(1.0)

    @property
    def middle_point(self) -> Point:
        """Point at half the parameter range, mm."""
        return self.point_at(0.5)

    def flattened(self, tolerance_mm: float = 1e-3) -> FloatArray:
        """Return a polyline (N, 2) through points of the curve that deviates from it by at most ``tolerance_mm``.

        Pieces are halved until the midpoint of each is well within the tolerance of its chord.
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
            if len(u) > MAX_POINTS:
                raise DesignError("tolerance_mm", value=tolerance_mm, limit=f"would need more than {MAX_POINTS} points")
            u = np.sort(np.concatenate([u, 0.5 * (u[:-1] + u[1:])[coarse]]))

    def velocity_at(self, u: float) -> Point:
        """Return the derivative of `points` at one parameter, mm."""
        x, z = self.velocities(np.array([u]))[0]
        return (float(x), float(z))

    def point_at(self, u: float) -> Point:
        """Return the point at one parameter, mm."""
        x, z = self.points(np.array([u]))[0]
        return (float(x), float(z))

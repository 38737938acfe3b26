"""Centre line of a guide (straight, an arc or a spline), and its walls, which are offset curves of that line.

The offset of a wall is a polynomial in the length along the line. Along a straight line, a wall whose polynomial is of
degree 3 or less is exact: a segment, a parabola or a Bézier curve. At a constant offset from an arc it is an arc. Any
other wall is a spline within `WALL_TOLERANCE_MM`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.curve import (
    Arc,
    ArcLength,
    Bezier,
    Curve,
    Function,
    Parabola,
    Segment,
    Spline,
    displaced_spline,
    fitted_spline,
)
from solen.errors import DesignError
from solen.geometry.bend import BEND_TOLERANCE_MM as WALL_TOLERANCE_MM
from solen.geometry.bend import MAX_RADIUS_MM
from solen.plane import Point, Rigid, along, heading, left_of, minus, right_of, unit

SAMPLES, PANELS = 257, 8
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
Offset = tuple[float, ...]
"""Coefficients of the offset to the right of the line, in mm, as a polynomial in the length along it."""


@dataclass(frozen=True)
class Spine:
    """A centre line: from ``start`` along a unit direction, turning uniformly by ``turn_deg``, or a ``free`` spline.

    A free line may be bent: its direction is then rotated by an angle that increases in proportion to the length, up to
    ``bend_deg`` at the end. ``heading_deg`` is the initial direction if it was specified as an angle.
    """

    start: Point
    direction: Point
    length_mm: float
    turn_deg: float = 0.0
    free: Spline | None = None
    heading_deg: float | None = None
    bend_deg: float = 0.0

    @classmethod
    def from_heading(cls, start: Point, heading_deg: float, length_mm: float, turn_deg: float) -> "Spine":
        """Return a line with a heading and a length."""
        return cls(start, heading(heading_deg), length_mm, turn_deg, heading_deg=heading_deg)

    @classmethod
    def between(cls, start: Point, end: Point, turn_deg: float, through: Sequence[Point]) -> "Spine":
        """Return a line between two points: straight, an arc, or a spline through further points."""
        if through:
            free = Spline.through([start, *through, end])
            return cls(start, unit(free.velocity_at(0.0)), ArcLength(free).length_mm, free=free)
        half = math.radians(0.5 * turn_deg)
        chord = unit(minus(end, start))
        first = Rigid(math.cos(half), -math.sin(half)).vector(chord) if turn_deg else chord
        return cls(start, first, math.dist(start, end) / float(np.sinc(half / math.pi)), turn_deg)

    @cached_property
    def end(self) -> Point:
        """Last point of the line."""
        if self.free is not None:
            x, z = self.free.end if self.bend_deg == 0.0 else self._panel_points[-1]
            return (float(x), float(z))
        if self.turn_deg == 0.0:
            return along(self.start, self.direction, self.length_mm)
        x, z = self._points(np.array([self.length_mm]))[0]
        return (float(x), float(z))

    @cached_property
    def end_direction(self) -> Point:
        """Unit direction at the end of the line."""
        turn_deg, last = self.turn_deg, self.direction
        if self.free is not None:
            turn_deg, last = self.bend_deg, unit(self.free.velocity_at(1.0))
        turn = math.radians(turn_deg)
        return Rigid(math.cos(turn), math.sin(turn)).vector(last) if turn_deg else last

    def moved(self, motion: Rigid) -> "Spine":
        """Return the line after a rigid motion."""
        if motion == Rigid():
            return self
        free = None if self.free is None else self.free.moved(motion)
        start, direction = motion.point(self.start), motion.vector(self.direction)
        return replace(self, start=start, direction=direction, free=free, heading_deg=None)

    def bent(self, angle_deg: float, *, from_end: bool) -> "tuple[Spine, Rigid]":
        """Return the line with its end rotated by an angle, at a constant added curvature, and the motion of that end.

        The start is fixed; if ``from_end`` is set, the end is fixed and the start moves.
        """
        if not from_end:
            bent = self._with_turn(angle_deg)
            return bent, motion_between(self.end, bent.end, angle_deg)
        bent = self._with_turn(-angle_deg)
        return_motion = motion_between(bent.end, self.end, angle_deg)
        bent = bent.moved(return_motion)
        return bent, motion_between(self.start, bent.start, angle_deg)

    def _with_turn(self, angle_deg: float) -> "Spine":
        """Return the line with the same start and length that turns uniformly by an additional angle."""
        if self.free is None:
            return replace(self, turn_deg=self.turn_deg + angle_deg)
        return replace(self, bend_deg=self.bend_deg + angle_deg)

    def wall(self, offset: Offset, what: str) -> Curve:
        """Return the wall at an offset from the line; raise `DesignError` about ``what`` if it would fold over."""
        offset = offset[: max((i + 1 for i, value in enumerate(offset) if value), default=1)]
        if self.free is not None:
            return self._wall_along_free(self.free, offset, what)
        if self.turn_deg == 0.0:
            return self._wall_along_straight(offset)
        return self._wall_along_arc(offset, what)

    def _wall_along_straight(self, offset: Offset) -> Curve:
        first, right, end = self.start, right_of(self.direction), along(self.start, self.direction, self.length_mm)
        if len(offset) <= 2:
            last = float(polynomial.polyval(self.length_mm, offset)) if len(offset) == 2 else offset[0]
            return Segment(along(first, right, offset[0]), along(end, right, last))
        if len(offset) == 3:
            a, b, c = offset
            shift = 0.5 * b / c
            vertex = along(along(first, right, a - c * shift * shift), self.direction, -shift)
            return Parabola(vertex, self.direction, c, shift, self.length_mm + shift)
        if len(offset) == 4:
            third = self.length_mm / 3.0
            a, b, c, d = (value * self.length_mm**i for i, value in enumerate(offset))
            offsets = (a, a + b / 3.0, a + (2.0 * b + c) / 3.0, a + b + c + d)
            return Bezier(*(along(along(first, self.direction, i * third), right, x) for i, x in enumerate(offsets)))
        return fitted_spline(*self._wall_functions(offset), WALL_TOLERANCE_MM)

    def _wall_along_arc(self, offset: Offset, what: str) -> Curve:
        per_mm = math.radians(self.turn_deg) / self.length_mm
        self._check_fold(polynomial.polyval(np.linspace(0.0, self.length_mm, SAMPLES), offset), per_mm, what)
        if len(offset) > 1 or abs(1.0 / per_mm) > MAX_RADIUS_MM:
            return fitted_spline(*self._wall_functions(offset), WALL_TOLERANCE_MM)
        radius = 1.0 / per_mm  # positive towards the left
        center = along(self.start, left_of(self.direction), radius)
        x, z = right_of(self.direction) if radius > 0.0 else left_of(self.direction)
        return Arc(center, abs(radius + offset[0]), math.degrees(math.atan2(z, x)), self.turn_deg)

    def _wall_along_free(self, free: Spline, offset: Offset, what: str) -> Curve:
        if offset == (0.0,) and self.bend_deg == 0.0:
            return free
        measure, slope = self._measure, polynomial.polyder(offset)
        bend_per_mm, cubic_count = math.radians(self.bend_deg) / measure.length_mm, len(free.controls)

        def carry(piece: Curve, start: float, end: float) -> tuple[Function, Function, tuple[float, float]]:
            if not isinstance(piece, Spline):
                raise AssertionError("a free line consists of splines")
            controls = np.array(piece.controls[0])

            first = round(start * cubic_count) * PANELS

            def frame(u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
                velocity, s = piece.velocities(u), measure.lengths_at(start + (end - start) * u)
                speed = np.hypot(*velocity.T)
                return s, speed, _turned(velocity / speed[:, None], bend_per_mm * s)

            def centre(u: FloatArray) -> FloatArray:
                if self.bend_deg == 0.0:
                    return piece.points(u)
                panel = np.minimum((u * PANELS).astype(int), PANELS - 1)
                low = start + (end - start) * panel / PANELS
                return np.asarray(
                    self._panel_points[first + panel] + self._displacements(low, start + (end - start) * u)
                )

            def point(u: FloatArray) -> FloatArray:
                s, _, direction = frame(u)
                return np.asarray(centre(u) + polynomial.polyval(s, offset)[:, None] * _right_of_each(direction))

            def velocity(u: FloatArray) -> FloatArray:
                s, speed, direction = frame(u)
                bends = np.diff(controls, 2, axis=0)
                second = 6.0 * ((1.0 - u)[:, None] * bends[0] + u[:, None] * bends[1])
                undeformed = _turned(direction, -bend_per_mm * s)
                per_mm = (undeformed[:, 0] * second[:, 1] - undeformed[:, 1] * second[:, 0]) / speed**2 + bend_per_mm
                offset_mm = polynomial.polyval(s, offset)
                self._check_fold(offset_mm, per_mm, what)
                rise = (polynomial.polyval(s, slope) * speed)[:, None] * _right_of_each(direction)
                return np.asarray((speed * (1.0 + per_mm * offset_mm))[:, None] * direction + rise)

            return point, velocity, (0.0, 1.0)

        return displaced_spline(free, carry, WALL_TOLERANCE_MM)

    @cached_property
    def _panel_points(self) -> FloatArray:
        """Points (N, 2) of a bent free line at the ends of its panels, `PANELS` for each of its cubics."""
        assert self.free is not None  # noqa: S101  only called for a free line
        ends = np.linspace(0.0, 1.0, len(self.free.controls) * PANELS + 1)
        displacements = np.cumsum(self._displacements(ends[:-1], ends[1:]), axis=0)
        return np.asarray(np.array(self.free.start) + np.vstack([np.zeros((1, 2)), displacements]))

    def _displacements(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return displacements (N, 2) along a bent free line between parameters within a panel, by quadrature."""
        assert self.free is not None  # noqa: S101  only called for a free line
        half = 0.5 * (high - low)
        at = (low + half)[:, None] + half[:, None] * NODES
        measure = self._measure
        turn = math.radians(self.bend_deg) * measure.lengths_at(at.ravel()) / measure.length_mm
        velocities = _turned(self.free.velocities(at.ravel()), turn).reshape(*at.shape, 2)
        return np.asarray(half[:, None] * np.einsum("k,nkd->nd", WEIGHTS, velocities))

    @cached_property
    def _measure(self) -> ArcLength:
        assert self.free is not None  # noqa: S101  only called for a free line
        return ArcLength(self.free)

    def _wall_functions(self, offset: Offset) -> tuple[Function, Function]:
        """Return the points and velocities of a wall of a line or an arc, as functions of the length fraction."""
        slope, per_mm = polynomial.polyder(offset), math.radians(self.turn_deg) / self.length_mm

        def point(u: FloatArray) -> FloatArray:
            s = u * self.length_mm
            return np.asarray(
                self._points(s) + polynomial.polyval(s, offset)[:, None] * _right_of_each(self._directions(s))
            )

        def velocity(u: FloatArray) -> FloatArray:
            s = u * self.length_mm
            direction, offset_mm = self._directions(s), polynomial.polyval(s, offset)
            axial = (1.0 + per_mm * offset_mm)[:, None] * direction
            return np.asarray(
                self.length_mm * (axial + polynomial.polyval(s, slope)[:, None] * _right_of_each(direction))
            )

        return point, velocity

    def _directions(self, s: FloatArray, fraction: float = 1.0) -> FloatArray:
        """Return unit directions (N, 2) at lengths ``s`` along a line, with its turn multiplied by ``fraction``."""
        angle = fraction * math.radians(self.turn_deg) / self.length_mm * s
        x, z = self.direction
        return np.column_stack([np.cos(angle) * x - np.sin(angle) * z, np.sin(angle) * x + np.cos(angle) * z])

    def _points(self, s: FloatArray) -> FloatArray:
        half = 0.5 * math.radians(self.turn_deg) / self.length_mm * s
        return np.asarray(np.asarray(self.start) + (s * np.sinc(half / math.pi))[:, None] * self._directions(s, 0.5))

    def _check_fold(self, offset_mm: ArrayLike, per_mm: ArrayLike, what: str) -> None:
        if float(np.min(1.0 + np.multiply(per_mm, offset_mm))) <= 0.0:
            limit = "folds over: the radius of its centre line is smaller than the distance to the wall"
            raise DesignError(
                what, limit=limit, remedy="bend it by a smaller angle or over a greater length, or make it narrower"
            )


def _turned(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """Return vectors (N, 2) rotated by angles (N,)."""
    (x, z), cos, sin = vectors.T, np.cos(angle), np.sin(angle)
    return np.column_stack([x * cos - z * sin, x * sin + z * cos])


def motion_between(before: Point, after: Point, angle_deg: float) -> Rigid:
    """Return the motion that rotates by an angle and moves one point to another."""
    if angle_deg == 0.0 and before == after:
        return Rigid()
    angle = math.radians(angle_deg)
    turn = Rigid(math.cos(angle), math.sin(angle))
    return replace(turn, shift=minus(after, turn.point(before)))


def _right_of_each(direction: FloatArray) -> FloatArray:
    return np.column_stack([direction[:, 1], -direction[:, 0]])

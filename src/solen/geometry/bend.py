"""A bend: the straight axis of a stem becomes a curve, and everything attached to it moves with it.

Every cross-section of the stem stays straight and perpendicular to the centre line, and the centre line keeps its
length (the kinematics of a slender beam, without forces). Everything above the bent segment stays fixed; everything
below it (lens, emitter) moves rigidly with the lowest section. ``angle_deg`` rotates that section relative to the fork,
counter-clockwise, as a rigid rotation by the same angle would.

In a bend of constant curvature, a wall parallel to the axis becomes an exact circular arc. Any other curve becomes a
spline within `BEND_TOLERANCE_MM`. Without a bend every curve remains the same object.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, ArcLength, Curve, Function, Parabola, Segment, Spline, displaced_spline
from solen.errors import DesignError
from solen.plane import Point, Rigid

BEND_TOLERANCE_MM = 1e-9
"""Maximum deviation of a spline from the bent wall."""
MAX_RADIUS_MM = 1000.0
"""Arcs with a larger radius are represented by splines: their centres are too far away for exact end points."""
HEIGHT_TOLERANCE_MM = 1e-9
"""A curve that extends across a height by less than this is treated as lying on one side of it."""
PARALLEL_MM = 1e-13
"""A line is parallel to the axis if the x coordinates of its ends differ by at most this."""
SAMPLES = 257
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
PANELS = 256
"""Number of panels in the table of the centre line, each integrated with 12 nodes."""


class Profile(Protocol):
    """Distribution of a bend: the fraction of its angle, as a function of the fraction of the length below the fork."""

    def turn(self, fraction: FloatArray) -> FloatArray:
        """Return the fraction of the angle at fractions of the length; both are 0 at the fork."""

    def turn_slope(self, fraction: FloatArray) -> FloatArray:
        """Return the derivative of `turn`."""


class UniformProfile:
    """Constant curvature."""

    def turn(self, fraction: FloatArray) -> FloatArray:
        """See `Profile`."""
        return fraction

    def turn_slope(self, fraction: FloatArray) -> FloatArray:
        """See `Profile`."""
        return np.ones_like(fraction)


class DrawnProfile:
    """Distribution defined by the direction of a drawn centre line relative to its direction at the fork.

    The line is a spline through the drawn points. The full bend angle corresponds to the largest angle of the line
    relative to the fork, so an S shape may also be drawn; the length of the line does not matter.
    """

    def __init__(self, points: Sequence[Point]) -> None:
        from scipy.interpolate import CubicSpline

        line = Spline.through(points)
        measure = ArcLength(line)
        fraction = np.linspace(0.0, 1.0, PANELS + 1)
        u = np.array([measure.u_at((1.0 - s) * measure.length_mm) for s in fraction])
        x, z = line.velocities(u).T
        heading = np.unwrap(np.arctan2(-x, z))
        turn = heading - heading[0]
        largest = float(turn[np.argmax(np.abs(turn))])
        if abs(largest) < math.radians(0.1):
            raise DesignError("motion.centre_line", limit="must change direction by at least 0.1 deg")
        self._spline = CubicSpline(fraction, turn / largest)
        self._slope = self._spline.derivative()

    def turn(self, fraction: FloatArray) -> FloatArray:
        """See `Profile`."""
        return np.asarray(self._spline(fraction))

    def turn_slope(self, fraction: FloatArray) -> FloatArray:
        """See `Profile`."""
        return np.asarray(self._slope(fraction))


@dataclass(frozen=True)
class Bend:
    """The axis x = 0 bent between two heights by ``angle_deg``."""

    from_mm: float
    to_mm: float
    angle_deg: float
    profile: Profile

    @property
    def length_mm(self) -> float:
        """Length of the bent segment."""
        return self.to_mm - self.from_mm

    def section_motion(self, z_mm: float) -> Rigid:
        """Return the motion of the section at a height: none above the segment, that of the lowest section below it."""
        if z_mm >= self.to_mm or self.angle_deg == 0.0:
            return Rigid()
        z = np.array([max(z_mm, self.from_mm)])
        x, up = self._centre(z)[0]
        turn = float(self._turn(z)[0])
        cos, sin = math.cos(turn), math.sin(turn)
        return Rigid(cos, sin, (float(x) + sin * float(z[0]), float(up) - cos * float(z[0])))

    def bent_points(self, points: FloatArray) -> FloatArray:
        """Return the bent positions of points (N, 2) between the two heights."""
        x, z = points.T
        turn = self._turn(z)
        return np.asarray(self._centre(z) + np.column_stack([x * np.cos(turn), x * np.sin(turn)]))

    def velocities(self, points: FloatArray, velocities: FloatArray) -> FloatArray:
        """Return the velocities (N, 2) of bent points, from the velocities of the points before the bend."""
        (x, z), (dx, dz) = points.T, velocities.T
        turn = self._turn(z)
        cos, sin = np.cos(turn), np.sin(turn)
        axial = dz * (1.0 + x * self._turn_per_mm(z))
        return np.column_stack([dx * cos - axial * sin, dx * sin + axial * cos])

    def carry(self, curve: Curve, _start: float, _end: float) -> tuple[Function, Function, tuple[float, float]]:
        """Return the functions for the points and velocities of a bent curve, for `solen.curve.displaced_spline`."""

        def velocity(u: FloatArray) -> FloatArray:
            return self.velocities(curve.points(u), curve.velocities(u))

        return lambda u: self.bent_points(curve.points(u)), velocity, (0.0, 1.0)

    def check_fold(self, points: FloatArray) -> None:
        """Raise `DesignError` if points (N, 2) are beyond the centre of curvature: the material would fold over."""
        smallest = float(np.min(1.0 + points[:, 0] * self._turn_per_mm(points[:, 1])))
        if smallest <= 0.0:
            raise DesignError(
                "motion",
                limit=f"a bend by {self.angle_deg:g} deg over {self.length_mm:g} mm folds the inner wall over: its "
                "radius is smaller than half the width of the stem",
                remedy="bend by a smaller angle or over a longer segment",
            )

    def _fraction(self, z: FloatArray) -> FloatArray:
        return np.clip((self.to_mm - z) / self.length_mm, 0.0, 1.0)

    def _turn(self, z: FloatArray) -> FloatArray:
        """Return the section angles at heights (N,), in radians."""
        return math.radians(self.angle_deg) * self.profile.turn(self._fraction(z))

    def _turn_per_mm(self, z: FloatArray) -> FloatArray:
        return -math.radians(self.angle_deg) / self.length_mm * self.profile.turn_slope(self._fraction(z))

    def _centre(self, z: FloatArray) -> FloatArray:
        """Return points (N, 2) of the bent axis at heights (N,), integrated downwards from the fork."""
        fraction = self._fraction(z)
        if isinstance(self.profile, UniformProfile):
            half = 0.5 * math.radians(self.angle_deg) * fraction
            chord = self.length_mm * fraction * np.sinc(half / math.pi)
            return np.column_stack([chord * np.sin(half), self.to_mm - chord * np.cos(half)])
        panel = np.minimum((fraction * PANELS).astype(int), PANELS - 1)
        return np.asarray(
            np.array([0.0, self.to_mm])
            + self._panel_displacements[panel]
            + self._displacements(panel / PANELS, fraction)
        )

    @cached_property
    def _panel_displacements(self) -> FloatArray:
        """Displacements (PANELS, 2) from the fork to the start of every panel."""
        edge = np.arange(PANELS) / PANELS
        steps = self._displacements(edge, edge + 1.0 / PANELS)
        return np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)[:-1]])

    def _displacements(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return displacements (N, 2) along the centre line between fractions of its length."""
        half = 0.5 * (high - low)
        fraction = (0.5 * (low + high))[:, None] + half[:, None] * NODES
        turn = math.radians(self.angle_deg) * self.profile.turn(fraction.ravel()).reshape(fraction.shape)
        down = np.stack([np.sin(turn) @ WEIGHTS, -np.cos(turn) @ WEIGHTS], axis=1)
        return np.asarray(self.length_mm * half[:, None] * down)


def bend_of(centre_line: Sequence[Point] | None, from_mm: float, to_mm: float, angle_deg: float) -> Bend:
    """Return the bend between two heights, with constant curvature or as defined by a drawn centre line."""
    profile = UniformProfile() if centre_line is None else _drawn_profile(tuple((x, z) for x, z in centre_line))
    return Bend(from_mm, to_mm, angle_deg, profile)


@lru_cache(maxsize=8)
def _drawn_profile(points: tuple[Point, ...]) -> DrawnProfile:
    return DrawnProfile(points)


def bent(curve: Curve, bend: Bend) -> tuple[Curve, ...]:
    """Return the bent curve, divided where it enters and leaves the bent segment."""
    if bend.angle_deg == 0.0:
        return (curve,)
    return tuple(_bent(piece, bend) for piece in _divided(curve, bend))


def _divided(curve: Curve, bend: Bend) -> list[Curve]:
    """Return the segments of the curve above, within and below the bent segment."""
    cuts = sorted({u for height in (bend.from_mm, bend.to_mm) for u in _crossings(curve, height)})
    ends = [0.0, *cuts, 1.0]
    return [curve.part(low, high) for low, high in pairwise(ends)] if cuts else [curve]


def _crossings(curve: Curve, height_mm: float) -> list[float]:
    """Return the parameters at which a curve crosses a height, except at its ends."""
    from scipy.optimize import brentq

    def above(u: float) -> float:
        return curve.point_at(u)[1] - height_mm

    u = np.linspace(0.0, 1.0, SAMPLES)
    side = curve.points(u)[:, 1] - height_mm
    side[np.abs(side) <= HEIGHT_TOLERANCE_MM] = 0.0
    nonzero = np.flatnonzero(side)
    changes = [(a, b) for a, b in pairwise(nonzero) if side[a] * side[b] < 0.0]
    return [float(brentq(above, float(u[a]), float(u[b]), xtol=1e-15)) for a, b in changes]


def _bent(curve: Curve, bend: Bend) -> Curve:
    """Return the bent curve of a segment that lies above, within or below the bent stem segment."""
    z = curve.points(np.linspace(0.0, 1.0, SAMPLES))[:, 1]
    low, high = float(z.min()), float(z.max())
    if low >= bend.to_mm - HEIGHT_TOLERANCE_MM:
        return curve
    if high <= bend.from_mm + HEIGHT_TOLERANCE_MM:
        return curve.moved(bend.section_motion(bend.from_mm))
    if isinstance(curve, Segment) and high - low <= HEIGHT_TOLERANCE_MM:
        return curve.moved(bend.section_motion(low))
    bend.check_fold(curve.points(np.linspace(0.0, 1.0, SAMPLES)))
    arc = _arc(curve, bend)
    if arc is not None:
        return arc
    return displaced_spline(curve, bend.carry, BEND_TOLERANCE_MM)


def _arc(curve: Curve, bend: Bend) -> Arc | None:
    """Return the arc of a line parallel to the axis in a uniform bend; None for other curves and very flat arcs."""
    straight = isinstance(curve, Segment) or (isinstance(curve, Parabola) and curve.curve_per_mm == 0.0)
    (x, z_start), (end_x, z_end) = curve.start, curve.end
    if not straight or abs(x - end_x) > PARALLEL_MM or not isinstance(bend.profile, UniformProfile):
        return None
    turn = math.radians(bend.angle_deg)
    to_center_mm = bend.length_mm / turn if turn else math.inf  # from the fork to the right
    if abs(x - to_center_mm) > MAX_RADIUS_MM:
        return None
    start_deg, end_deg = (bend.angle_deg * (bend.to_mm - z) / bend.length_mm for z in (z_start, z_end))
    side_deg = 0.0 if x > to_center_mm else 180.0
    return Arc((to_center_mm, bend.to_mm), abs(x - to_center_mm), start_deg + side_deg, end_deg - start_deg)

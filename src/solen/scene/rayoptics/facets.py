"""Curves defined by formulas as ray-optics traces them: chords between sampled points, with blended normals.

ray-optics does not follow the exact curve of a formula but a fine polyline. The normal turns gradually along each
chord, from that of the previous chord to that of the next. The curves in this module reproduce the ray-optics results
exactly; `solen.scene.rayoptics.formula_curves` provides the true curves. Only the tracers in plain Python support
facets.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Curve
from solen.plane import Point, Rigid, cross, dot, left_of
from solen.scene.rayoptics.fields import MAX_NUMBER, UnreadError

Blend = Literal["images", "lengths", "units"]

STEP, FIRST, BEYOND = 0.1000001, 0.05, 0.09
"""For a formula over a line: sampling step, offset of the first point, and maximum distance of the last point beyond
the end of the line.
"""
UNLIKE = 10.0
"""Neighbouring chords of a parametric curve are not blended if the ratio of their lengths is at least this large."""
MAX_CORNERS = 200_000


@dataclass(frozen=True)
class Facets(Curve):
    """Polyline through ``corners``, from parameter ``low`` to ``high``; its integer part is the chord number.

    ``blend`` determines how neighbouring chords are blended. Along a base line, mirrors blend *images* and glasses
    blend normals, both weighted by the squared *lengths* of the chords. A parametric curve blends normals with weights
    that add up to 1 (*units*), except between chords of very different lengths. A hit closer than ``skin`` is ignored
    for a ray that leaves the curve.
    """

    corners: tuple[Point, ...]
    blend: Blend
    skin: float
    low: float
    high: float

    @classmethod
    def through(cls, corners: tuple[Point, ...], blend: Blend, skin: float) -> "Facets":
        """Return the polyline through these corners, with all its chords."""
        return cls(corners, blend, skin, 0.0, len(corners) - 1.0)

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Start points, steps and lengths of all chords."""
        corners = np.array(self.corners)
        steps = np.diff(corners, axis=0)
        return corners[:-1], steps, np.hypot(*steps.T)

    @property
    def closed(self) -> bool:
        """Whether the polyline ends where it starts."""
        return self.corners[0] == self.corners[-1]

    def points(self, u: FloatArray) -> FloatArray:
        """See `Curve.points`."""
        starts, steps, _ = self._table
        place = self.low + u * (self.high - self.low)
        which = np.clip(np.floor(place), 0, len(starts) - 1).astype(int)
        return np.asarray(starts[which] + (place - which)[:, None] * steps[which])

    def velocities(self, u: FloatArray) -> FloatArray:
        """See `Curve.velocities`; at a corner, the velocity of the next chord is returned."""
        _, steps, _ = self._table
        place = self.low + u * (self.high - self.low)
        return np.asarray((self.high - self.low) * steps[np.clip(np.floor(place), 0, len(steps) - 1).astype(int)])

    def part(self, u_from: float, u_to: float) -> "Facets":
        """See `Curve.part`; the normals at the ends are blended with those of the facets beyond the ends."""
        span = self.high - self.low
        return replace(self, low=self.low + u_from * span, high=self.low + u_to * span)

    def place(self, point: Point) -> float:
        """Parameter, from 0 to 1, of the point on the curve that is nearest to ``point``."""
        chord, share = self._chord(point)
        return min(max((chord + share - self.low) / (self.high - self.low), 0.0), 1.0)

    def normal_at(self, point: Point) -> Point:
        """See `Curve.normal_at`; normals are blended as for a mirror.

        The sum of two images points along half the angle of the sum of their angle-doubled directions.
        """
        blended = self._blended(point)
        doubled = sum(weight * complex(*tangent) ** 2 for weight, tangent in blended)
        half = np.sqrt(doubled / abs(doubled)) if doubled else 1.0
        own = complex(*blended[0][1])
        turned = half * math.copysign(1.0, (half * own.conjugate()).real)
        return left_of((turned.real, turned.imag))

    def normal_met(self, point: Point, direction: Point) -> Point:
        """Left normal where a ray meets the curve.

        For a glass, each chord is also weighted by the cosine of the incidence angle.
        """
        if self.blend == "images":
            return self.normal_at(point)
        x = z = 0.0
        for weight, tangent in self._blended(point):
            normal = left_of(tangent)
            stands = weight * dot(direction, normal)
            x, z = x + stands * normal[0], z + stands * normal[1]
        left = left_of(self._blended(point)[0][1])
        way = math.copysign(1.0, dot((x, z), left)) / (math.hypot(x, z) or math.nan)
        return (way * x, way * z) if way == way else left

    def _blended(self, point: Point) -> list[tuple[float, Point]]:
        """Weights and unit tangents of the chord nearest to a point and, if they are blended, of its neighbour."""
        chord, share = self._chord(point)
        other = chord - 1 if share < 0.5 else chord + 1
        own = 0.5 + share if share < 0.5 else 1.5 - share
        _, steps, lengths = self._table
        if self.closed and self.blend != "units":
            other %= len(steps)
        if not 0 <= other < len(steps) or lengths[other] == 0.0:
            return [(1.0, self._tangent(chord))]
        if self.blend == "units":
            if not 1.0 / UNLIKE < lengths[other] / lengths[chord] < UNLIKE:
                return [(1.0, self._tangent(chord))]
            weights = (own, 1.0 - own)
        else:
            weights = (own * float(lengths[chord]) ** 2, (1.0 - own) * float(lengths[other]) ** 2)
        return [(weights[0], self._tangent(chord)), (weights[1], self._tangent(other))]

    def _tangent(self, chord: int) -> Point:
        _, steps, lengths = self._table
        x, z = (steps[chord] / lengths[chord]).tolist()
        return (x, z)

    def sign_at(self, point: Point, direction: Point) -> int:
        """Return 1 if a ray crosses the nearest chord to its right, −1 if to its left."""
        step = self._table[1][self._chord(point)[0]]
        return 1 if cross((float(step[0]), float(step[1])), direction) < 0.0 else -1

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """See `Curve.hits`."""
        starts, steps, _ = self._table
        x, z = starts[:, 0] - origin[0], starts[:, 1] - origin[1]
        slant = direction[0] * steps[:, 1] - direction[1] * steps[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (x * steps[:, 1] - z * steps[:, 0]) / slant
            place = np.arange(len(starts)) + (x * direction[1] - z * direction[0]) / slant
            share = place - np.arange(len(starts))
            held = (share >= 0.0) & (share <= 1.0) & (place >= self.low) & (place <= self.high)
            found = t[held & (t > (self.skin if leaving else 0.0))]
        return tuple(found.tolist())

    def moved(self, motion: Rigid) -> "Facets":
        """See `Curve.moved`."""
        return replace(self, corners=tuple(motion.point(corner) for corner in self.corners))

    def reversed(self) -> "Facets":
        """See `Curve.reversed`."""
        last = len(self.corners) - 1.0
        return replace(self, corners=self.corners[::-1], low=last - self.high, high=last - self.low)

    def _chord(self, point: Point) -> tuple[int, float]:
        """Return the chord nearest to a point, and the position along this chord as a fraction of its length."""
        starts, steps, lengths = self._table
        offset = np.array(point) - starts
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.clip((offset * steps).sum(axis=1) / lengths**2, 0.0, 1.0)
        away = np.hypot(*(offset - share[:, None] * steps).T)
        chord = int(np.nanargmin(away))
        return chord, float(share[chord])


def over_line(length: float, scale: float) -> list[float]:
    """Return the positions along a base at which ray-optics evaluates a formula, from one end to the other."""
    if length / scale > MAX_CORNERS * STEP:
        raise UnreadError("p2", f"would produce more than {MAX_CORNERS} facets")
    values, i = [], -STEP * scale
    while i < length + BEYOND * scale:
        values.append(min(max(i + FIRST * scale, 0.0), length))
        i += STEP * scale
    return values


def along_parameter(low: float, high: float, step: float) -> list[float]:
    """Return the parameters at which ray-optics evaluates a parametric formula."""
    if not step > 0.0 or (high - low) / step > MAX_CORNERS:
        raise UnreadError("tStep", f"must be above 0 and give at most {MAX_CORNERS} facets, not {step:g}")
    found, t = [low], low + step
    while t < high:
        found.append(t)
        t += step
    return [*found, high]


def sampled(at: Callable[[float], Point], places: list[float], key: str) -> list[Point]:
    """Return the points at these positions; raise `UnreadError` if the formula is undefined there."""
    points = [at(place) for place in places]
    if not all(abs(x) <= MAX_NUMBER and abs(z) <= MAX_NUMBER for x, z in points):
        raise UnreadError(key, f"is undefined or exceeds {MAX_NUMBER:g} in part of its range")
    return points

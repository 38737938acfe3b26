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
from solen.scene.rayoptics.fields import MAX_NUMBER, UnreadableError

Blend = Literal["images", "lengths", "units"]

STEP, FIRST_OFFSET, MAX_OVERSHOOT = 0.1000001, 0.05, 0.09
"""For a formula over a line: sampling step, offset of the first point, and maximum distance by which the last point may
overshoot the end of the line.
"""
MAX_LENGTH_RATIO = 10.0
"""Neighbouring chords of a parametric curve are not blended if the ratio of their lengths is at least this large."""
MAX_CORNERS = 200_000


@dataclass(frozen=True)
class Facets(Curve):
    """Polyline through ``corners`` from position ``low`` to ``high``; the integer part of a position is a chord number.

    ``blend`` determines how neighbouring chords are blended. For a formula over a line, a mirror blends the mirror
    images of the ray (``"images"``) and a glass blends the normals (``"lengths"``), both weighted by the squared chord
    lengths. A parametric curve blends normals with weights that add up to 1 (``"units"``), except between chords
    of very different lengths. A hit closer than ``skin`` is ignored for a ray that leaves the curve.
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
        position = self.low + u * (self.high - self.low)
        chords = np.clip(np.floor(position), 0, len(starts) - 1).astype(int)
        return np.asarray(starts[chords] + (position - chords)[:, None] * steps[chords])

    def velocities(self, u: FloatArray) -> FloatArray:
        """See `Curve.velocities`; at a corner, the velocity of the next chord is returned."""
        _, steps, _ = self._table
        position = self.low + u * (self.high - self.low)
        return np.asarray((self.high - self.low) * steps[np.clip(np.floor(position), 0, len(steps) - 1).astype(int)])

    def part(self, u_from: float, u_to: float) -> "Facets":
        """See `Curve.part`; the normals at the ends are blended with those of the facets beyond the ends."""
        span = self.high - self.low
        return replace(self, low=self.low + u_from * span, high=self.low + u_to * span)

    def parameter_of(self, point: Point) -> float:
        """Return the parameter, from 0 to 1, of the point on the curve that is nearest to ``point``."""
        chord, fraction = self._chord(point)
        return min(max((chord + fraction - self.low) / (self.high - self.low), 0.0), 1.0)

    def normal_at(self, point: Point) -> Point:
        """See `Curve.normal_at`; normals are blended as for a mirror.

        Each tangent is weighted after its angle has been doubled; half the angle of the sum gives the blended tangent.
        """
        blended = self._blended(point)
        doubled = sum(weight * complex(*tangent) ** 2 for weight, tangent in blended)
        half = np.sqrt(doubled / abs(doubled)) if doubled else 1.0
        nearest = complex(*blended[0][1])
        tangent = half * math.copysign(1.0, (half * nearest.conjugate()).real)
        return left_of((tangent.real, tangent.imag))

    def normal_at_hit(self, point: Point, direction: Point) -> Point:
        """Return the left normal at a point for a ray that arrives in ``direction``.

        For a glass, each chord is also weighted by the cosine of the angle of incidence.
        """
        if self.blend == "images":
            return self.normal_at(point)
        x = z = 0.0
        for weight, tangent in self._blended(point):
            normal = left_of(tangent)
            scaled = weight * dot(direction, normal)
            x, z = x + scaled * normal[0], z + scaled * normal[1]
        left = left_of(self._blended(point)[0][1])
        sign = math.copysign(1.0, dot((x, z), left)) / (math.hypot(x, z) or math.nan)
        return (sign * x, sign * z) if sign == sign else left

    def _blended(self, point: Point) -> list[tuple[float, Point]]:
        """Weights and unit tangents of the chord nearest to a point and, if they are blended, of its neighbour."""
        chord, fraction = self._chord(point)
        other = chord - 1 if fraction < 0.5 else chord + 1
        weight = 0.5 + fraction if fraction < 0.5 else 1.5 - fraction
        _, steps, lengths = self._table
        if self.closed and self.blend != "units":
            other %= len(steps)
        if not 0 <= other < len(steps) or lengths[other] == 0.0:
            return [(1.0, self._tangent(chord))]
        if self.blend == "units":
            if not 1.0 / MAX_LENGTH_RATIO < lengths[other] / lengths[chord] < MAX_LENGTH_RATIO:
                return [(1.0, self._tangent(chord))]
            weights = (weight, 1.0 - weight)
        else:
            weights = (weight * float(lengths[chord]) ** 2, (1.0 - weight) * float(lengths[other]) ** 2)
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
            position = np.arange(len(starts)) + (x * direction[1] - z * direction[0]) / slant
            fraction = position - np.arange(len(starts))
            within = (fraction >= 0.0) & (fraction <= 1.0) & (position >= self.low) & (position <= self.high)
            hits = t[within & (t > (self.skin if leaving else 0.0))]
        return tuple(hits.tolist())

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
            fraction = np.clip((offset * steps).sum(axis=1) / lengths**2, 0.0, 1.0)
        distances = np.hypot(*(offset - fraction[:, None] * steps).T)
        chord = int(np.nanargmin(distances))
        return chord, float(fraction[chord])


def over_line(length: float, scale: float) -> list[float]:
    """Return the positions along a base at which ray-optics evaluates a formula, from one end to the other."""
    if length / scale > MAX_CORNERS * STEP:
        raise UnreadableError("p2", f"would produce more than {MAX_CORNERS} facets")
    values, i = [], -STEP * scale
    while i < length + MAX_OVERSHOOT * scale:
        values.append(min(max(i + FIRST_OFFSET * scale, 0.0), length))
        i += STEP * scale
    return values


def along_parameter(low: float, high: float, step: float) -> list[float]:
    """Return the parameters at which ray-optics evaluates a parametric formula."""
    if not step > 0.0 or (high - low) / step > MAX_CORNERS:
        raise UnreadableError("tStep", f"must be above 0 and give at most {MAX_CORNERS} facets, not {step:g}")
    parameters, t = [low], low + step
    while t < high:
        parameters.append(t)
        t += step
    return [*parameters, high]


def sampled(at: Callable[[float], Point], parameters: list[float], key: str) -> list[Point]:
    """Return the points at these parameters; raise `UnreadableError` if the formula is undefined there."""
    points = [at(parameter) for parameter in parameters]
    if not all(abs(x) <= MAX_NUMBER and abs(z) <= MAX_NUMBER for x, z in points):
        raise UnreadableError(key, f"is undefined or exceeds {MAX_NUMBER:g} in part of its range")
    return points

"""The face of a lens for skew rays in the reference tracer: a ray meets it where it enters or leaves the solid.

Up to the base of the stem, the solid is bounded by the face and by |x| at the half width; behind the base, it is the
part of the prism that is behind the face. The lens is the only code shared with the compiled tracing through the face.
"""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.geometry import Front
from solen.lens import LayeredLens, LineFocusLens

Vector = tuple[float, float, float]
STEPS, HALVINGS, MIN_MM = 400, 60, 1e-9
"""Number of points along a ray at which a smooth face is tested, number of bisections, and smallest hit distance."""


class FrontHit(NamedTuple):
    """Distance along a ray to the face, the outward normal there, and whether the ray enters the solid."""

    distance: float
    normal: Vector
    enters: bool


class FrontInSpace:
    """The face of the lens for skew rays in a scene."""

    def __init__(self, front: Front) -> None:
        self.lens, self.motion = front.lens, front.motion
        self.half_width, self.base = front.lens.half_width_mm, front.lens.depth_mm
        self.nearest, self.deepest = front.lens.nearest_mm, front.lens.deepest_mm

    def hit(self, at: Vector, d: Vector) -> FrontHit | None:
        """Return the nearest hit of a ray on the face, its ledges or the lens sides up to the base of the stem."""
        at, d = self.to_lens_frame(at, shift=True), self.to_lens_frame(d, shift=False)
        hits = [*self.on_face(at, d), *self._sides(at, d)]
        if not hits:
            return None
        nearest = min(hits, key=lambda hit: hit.distance)
        return nearest._replace(normal=self._to_scene(nearest.normal))

    def hides(self, at: Vector) -> bool:
        """Return whether a point on a prism wall is in front of the face, where the prism is cut away."""
        x, y, z = self.to_lens_frame(at, shift=True)
        if abs(y) > self.lens.half_height_mm or z > self.deepest or abs(x) > 1.1 * self.half_width:
            return False
        return z < self._depth(x, y)

    def to_lens_frame(self, v: Vector, *, shift: bool) -> Vector:
        """Transform a point or a direction from the scene frame to the lens frame."""
        m = self.motion
        x, z = (v[0] - m.shift[0], v[2] - m.shift[1]) if shift else (v[0], v[2])
        return (m.cos * x + m.sin * z, v[1], m.cos * z - m.sin * x)

    def _to_scene(self, v: Vector) -> Vector:
        x, z = self.motion.vector((v[0], v[2]))
        return (x, v[1], z)

    def _depth(self, x: float, y: float) -> float:
        return float(self.lens.z_at(np.array([x]), np.array([y]))[0])

    def _search_range(self, at: Vector, d: Vector) -> tuple[float, float]:
        """Return the range of distances along a ray in which it is within the bounding box of the face."""
        low, high = MIN_MM, math.inf
        box = (
            (-self.half_width, self.half_width),
            (-self.lens.half_height_mm, self.lens.half_height_mm),
            (self.nearest - 1e-6, max(self.deepest, self.base) + 1e-6),
        )
        for position, slope, (box_min, box_max) in zip(at, d, box, strict=True):
            if slope == 0.0:
                high = high if box_min <= position <= box_max else -math.inf
                continue
            ends = sorted(((box_min - position) / slope, (box_max - position) / slope))
            low, high = max(low, ends[0]), min(high, ends[1])
        return low, high

    def on_face(self, at: Vector, d: Vector) -> Iterator[FrontHit]:
        """Yield the nearest hit of a ray on the face or its ledges, if there is one, in the lens frame."""
        low, high = self._search_range(at, d)
        if not low < high:
            return
        if isinstance(self.lens, LayeredLens):
            yield from self._layers(self.lens, at, d, low, high)
            return
        if not isinstance(self.lens, LineFocusLens):
            raise TypeError(type(self.lens).__name__)
        lens = self.lens

        def outside(distance: FloatArray) -> FloatArray:
            return lens.residual_mm(*(np.asarray(a + distance * b) for a, b in zip(at, d, strict=True)))

        distances = np.linspace(low, high, STEPS)
        is_outside = outside(distances) > 0.0
        for i in np.flatnonzero(is_outside[:-1] != is_outside[1:])[:1]:
            distance = _bisected(outside, float(distances[i]), float(distances[i + 1]))
            yield FrontHit(distance, _normal(lens, at, d, distance), bool(is_outside[i]))

    def _layers(self, lens: LayeredLens, at: Vector, d: Vector, low: float, high: float) -> Iterator[FrontHit]:
        """Yield the nearest hit on the profile of a layer or on the ledge between it and the next layer."""
        edges = [(edge - at[1]) / d[1] for edge in lens.edges_mm] if d[1] != 0.0 else []
        stops = [low, *sorted(distance for distance in edges if low < distance < high), high]
        middles = np.array([0.5 * (a + b) for a, b in pairwise(stops)])
        layers = np.searchsorted(lens.edges_mm, at[1] + middles * d[1], side="right") - 1
        layers = np.clip(layers, 0, lens.layers - 1)
        for i, layer in enumerate(layers):

            def outside(distance: FloatArray, layer: int = int(layer)) -> FloatArray:
                x, z = at[0] + distance * d[0], at[2] + distance * d[2]
                return lens.profile_mm(np.full(np.shape(x), layer), np.minimum(np.abs(x), lens.half_width_mm)) - z

            first, last = stops[i], stops[i + 1]
            distances = np.linspace(first, last, 6 if len(stops) > 3 else STEPS)
            is_outside = outside(distances) > 0.0
            changes = np.flatnonzero(is_outside[:-1] != is_outside[1:])
            if len(changes):
                k = changes[0]
                distance = _bisected(outside, float(distances[k]), float(distances[k + 1]))
                if distance > 2.0 * MIN_MM:
                    normal = _profile_normal(lens, int(layer), at[0] + distance * d[0])
                    yield FrontHit(distance, normal, bool(is_outside[k]))
                    return
            if i + 1 < len(layers):
                x, z = at[0] + last * d[0], at[2] + last * d[2]
                outside_next = float(lens.profile_mm(np.array([layers[i + 1]]), np.array([x]))[0]) - z > 0.0
                if outside_next != bool(is_outside[-1]):
                    up = 1.0 if d[1] > 0.0 else -1.0
                    yield FrontHit(last, (0.0, -up if is_outside[-1] else up, 0.0), bool(is_outside[-1]))
                    return

    def _sides(self, at: Vector, d: Vector) -> Iterator[FrontHit]:
        """Yield hits on the planes at the edges of the aperture, between the face and the base of the stem."""
        for side in (-1.0, 1.0):
            if d[0] == 0.0:
                continue
            distance = (side * self.half_width - at[0]) / d[0]
            y, z = at[1] + distance * d[1], at[2] + distance * d[2]
            leaves, half = side * d[0] > 0.0, self.lens.half_height_mm  # like all walls, they extend above and below
            if distance <= MIN_MM or (abs(y) > half and not leaves) or z >= self.base:
                continue
            if z > self._depth(self.half_width, min(max(y, -half), half)):
                yield FrontHit(distance, (side, 0.0, 0.0), side * d[0] < 0.0)


def _bisected(outside: Callable[[FloatArray], FloatArray], low: float, high: float) -> float:
    """Return where a function changes sign, by bisection."""
    starts_outside = bool(outside(np.array(low)) > 0.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if bool(outside(np.array(middle)) > 0.0) == starts_outside:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _normal(lens: LineFocusLens, at: Vector, d: Vector, distance: float) -> Vector:
    """Return the outward normal of a smooth face, from small differences of its optical path length."""
    point = [a + distance * b for a, b in zip(at, d, strict=True)]
    step, slopes = 1e-6, []
    for i in range(3):
        ends = [[value + side * step * (k == i) for k, value in enumerate(point)] for side in (-1.0, 1.0)]
        low, high = (float(lens.residual_mm(*(np.array(value) for value in end))) for end in ends)
        slopes.append((high - low) / (2.0 * step))
    size = math.hypot(*slopes)
    return (slopes[0] / size, slopes[1] / size, slopes[2] / size)


def _profile_normal(lens: LayeredLens, layer: int, x: float) -> Vector:
    """Return the outward normal of a layer wall, from small differences of its profile."""
    step = 1e-5
    at = np.clip(np.array([x - step, x + step]), -lens.half_width_mm, lens.half_width_mm)
    low, high = lens.profile_mm(np.array([layer, layer]), at)
    slope = float((high - low) / (at[1] - at[0]))
    size = math.hypot(1.0, slope)
    return (slope / size, 0.0, -1.0 / size)

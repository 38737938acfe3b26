"""A face in space in the reference tracer: a hit is the position where a line enters or leaves the solid.

Up to the base of the stem, the solid is bounded by the face and by |x| not exceeding the half width; behind the base,
it is the part of the prism that is behind the face. The lens is the only code shared with the compiled tracing through
the face.
"""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.geometry import Front
from solen.lens import LayeredLens, LensInSpace, LineFocusLens

Vector = tuple[float, float, float]
PLACES, HALVINGS, MIN_MM = 400, 60, 1e-9
"""Number of points along a ray at which a smooth face is tested, number of bisections, and smallest hit distance."""


class FrontHit(NamedTuple):
    """Distance along a ray to the face, the outward normal there, and whether the ray enters the solid."""

    way: float
    normal: Vector
    goes_in: bool


class FrontInSpace:
    """The face in space of a scene."""

    def __init__(self, front: Front) -> None:
        self.lens, self.motion = front.lens, front.motion
        self.half_width, self.base = front.lens.half_width_mm, front.lens.depth_mm
        self.nearest, self.deepest = front.lens.nearest_mm, front.lens.deepest_mm

    def hit(self, at: Vector, d: Vector) -> FrontHit | None:
        """Return the nearest hit of a ray on the face, its ledges or the lens sides up to the base of the stem."""
        at, d = self.own(at, shift=True), self.own(d, shift=False)
        hits = [*self.on_face(at, d), *self._sides(at, d)]
        if not hits:
            return None
        first = min(hits, key=lambda hit: hit.way)
        return first._replace(normal=self._scene(first.normal))

    def hides(self, at: Vector) -> bool:
        """Return whether a point on a prism wall is in front of the face, where the prism is cut away."""
        x, y, z = self.own(at, shift=True)
        if abs(y) > self.lens.half_height_mm or z > self.deepest or abs(x) > 1.1 * self.half_width:
            return False
        return z < self._depth(x, y)

    def own(self, v: Vector, *, shift: bool) -> Vector:
        """Transform a point or a direction from the scene frame to the lens frame."""
        m = self.motion
        x, z = (v[0] - m.shift[0], v[2] - m.shift[1]) if shift else (v[0], v[2])
        return (m.cos * x + m.sin * z, v[1], m.cos * z - m.sin * x)

    def _scene(self, v: Vector) -> Vector:
        x, z = self.motion.vector((v[0], v[2]))
        return (x, v[1], z)

    def _depth(self, x: float, y: float) -> float:
        return float(self.lens.z_at(np.array([x]), np.array([y]))[0])

    def _search_range(self, at: Vector, d: Vector) -> tuple[float, float]:
        """Return the distances along a ray between which it is inside or in front of the lens."""
        low, high = MIN_MM, math.inf
        box = (
            (-self.half_width, self.half_width),
            (-self.lens.half_height_mm, self.lens.half_height_mm),
            (self.nearest - 1e-6, max(self.deepest, self.base) + 1e-6),
        )
        for place, along, (least, most) in zip(at, d, box, strict=True):
            if along == 0.0:
                high = high if least <= place <= most else -math.inf
                continue
            ends = sorted(((least - place) / along, (most - place) / along))
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

        def outside(way: FloatArray) -> FloatArray:
            return lens.residual_mm(*(np.asarray(a + way * b) for a, b in zip(at, d, strict=True)))

        ways = np.linspace(low, high, PLACES)
        sign = outside(ways) > 0.0
        for i in np.flatnonzero(sign[:-1] != sign[1:])[:1]:
            way = _halved(outside, float(ways[i]), float(ways[i + 1]))
            yield FrontHit(way, _normal(lens, at, d, way), bool(sign[i]))

    def _layers(self, lens: LayeredLens, at: Vector, d: Vector, low: float, high: float) -> Iterator[FrontHit]:
        """Yield the nearest hit on the profile of a layer or on the ledge between it and the next layer."""
        borders = [(edge - at[1]) / d[1] for edge in lens.edges_mm] if d[1] != 0.0 else []
        stops = [low, *sorted(way for way in borders if low < way < high), high]
        middles = np.array([0.5 * (a + b) for a, b in pairwise(stops)])
        layers = np.searchsorted(lens.edges_mm, at[1] + middles * d[1], side="right") - 1
        layers = np.clip(layers, 0, lens.layers - 1)
        for i, layer in enumerate(layers):

            def outside(way: FloatArray, layer: int = int(layer)) -> FloatArray:
                x, z = at[0] + way * d[0], at[2] + way * d[2]
                return lens.profile_mm(np.full(np.shape(x), layer), np.minimum(np.abs(x), lens.half_width_mm)) - z

            first, last = stops[i], stops[i + 1]
            ways = np.linspace(first, last, 6 if len(stops) > 3 else PLACES)
            sign = outside(ways) > 0.0
            changes = np.flatnonzero(sign[:-1] != sign[1:])
            if len(changes):
                k = changes[0]
                way = _halved(outside, float(ways[k]), float(ways[k + 1]))
                if way > 2.0 * MIN_MM:
                    yield FrontHit(way, _profile_normal(lens, int(layer), at[0] + way * d[0]), bool(sign[k]))
                    return
            if i + 1 < len(layers):
                x, z = at[0] + last * d[0], at[2] + last * d[2]
                beyond = float(lens.profile_mm(np.array([layers[i + 1]]), np.array([x]))[0]) - z > 0.0
                if beyond != bool(sign[-1]):
                    up = 1.0 if d[1] > 0.0 else -1.0
                    yield FrontHit(last, (0.0, -up if sign[-1] else up, 0.0), bool(sign[-1]))
                    return

    def _sides(self, at: Vector, d: Vector) -> Iterator[FrontHit]:
        """Yield hits on the planes at the edges of the aperture, between the face and the base of the stem."""
        for side in (-1.0, 1.0):
            if d[0] == 0.0:
                continue
            way = (side * self.half_width - at[0]) / d[0]
            y, z = at[1] + way * d[1], at[2] + way * d[2]
            leaves, half = side * d[0] > 0.0, self.lens.half_height_mm  # like all walls, they extend above and below
            if way <= MIN_MM or (abs(y) > half and not leaves) or z >= self.base:
                continue
            if z > self._depth(self.half_width, min(max(y, -half), half)):
                yield FrontHit(way, (side, 0.0, 0.0), side * d[0] < 0.0)


def _halved(outside: Callable[[FloatArray], FloatArray], low: float, high: float) -> float:
    """Locate the sign change of a function by bisection."""
    before = bool(outside(np.array(low)) > 0.0)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if bool(outside(np.array(middle)) > 0.0) == before:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _normal(lens: LensInSpace, at: Vector, d: Vector, way: float) -> Vector:
    """Return the outward normal of a smooth face, from small differences of its optical length."""
    point = [a + way * b for a, b in zip(at, d, strict=True)]
    step, slopes = 1e-6, []
    if not isinstance(lens, LineFocusLens):
        raise TypeError(type(lens).__name__)
    for i in range(3):
        ends = [[value + side * step * (k == i) for k, value in enumerate(point)] for side in (-1.0, 1.0)]
        one, two = (float(lens.residual_mm(*(np.array(value) for value in end))) for end in ends)
        slopes.append((two - one) / (2.0 * step))
    size = math.hypot(*slopes)
    return (slopes[0] / size, slopes[1] / size, slopes[2] / size)


def _profile_normal(lens: LayeredLens, layer: int, x: float) -> Vector:
    """Return the outward normal of a layer wall, from small differences of its profile."""
    step = 1e-5
    at = np.clip(np.array([x - step, x + step]), -lens.half_width_mm, lens.half_width_mm)
    one, two = lens.profile_mm(np.array([layer, layer]), at)
    slope = float((two - one) / (at[1] - at[0]))
    size = math.hypot(1.0, slope)
    return (slope / size, 0.0, -1.0 / size)

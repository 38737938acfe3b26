"""Intersection of rays with chains of cubic Bézier pieces.

A chain is stored as simple pieces (see `solen.curve.cubic`). For each joint between two pieces, the side of the ray's
line on which it lies is decided once for both: a ray can neither slip through a joint nor intersect the curve twice
there.

A ray that leaves the chain starts at a point on one piece. That piece is cut there into two parts with a known root at
their common end, which is divided out. On the neighbouring pieces, distances from the ray are also summed from the
starting point across the joint rather than taken from coordinates, so a second intersection just beyond a joint is as
exact as one on the same piece. If a ray starts at a joint, its known root is on both pieces.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import END_TOLERANCE_MM, MAX_POINTS, SMALL, Curve
from solen.curve.cubic import (
    Control,
    Piece,
    Rises,
    Steps,
    backwards,
    crossings,
    cut,
    halves,
    other_crossing,
    point_at,
    rise,
    simple_pieces,
    slope,
    solve,
    steps_after,
    steps_of,
    tangent_at,
)
from solen.errors import DesignError
from solen.plane import Point, cross, dot, left_of, minus, unit


class Ray(NamedTuple):
    """A ray, with the coordinates of points and steps across and along it."""

    origin: Point
    direction: Point

    def offset(self, point: Point) -> float:
        """Return the distance of a point from the ray's line, positive on its left."""
        return cross(self.direction, minus(point, self.origin))

    def distance(self, point: Point) -> float:
        """Return the distance of a point from the origin, measured along the ray."""
        return dot(self.direction, minus(point, self.origin))

    def lateral_rises(self, steps: Steps) -> Rises:
        """Return the change of the distance from the line over each step."""
        a, b, c = steps
        return (cross(self.direction, a), cross(self.direction, b), cross(self.direction, c))

    def forward_rises(self, steps: Steps) -> Rises:
        """Return the change of the distance along the ray over each step."""
        a, b, c = steps
        return (dot(self.direction, a), dot(self.direction, b), dot(self.direction, c))


class ChainPoint(NamedTuple):
    """Position of a point on a chain: index of the piece, parameter on it, and distance of the point from it."""

    piece: int
    v: float
    distance_mm: float


class CubicChain(Curve):
    """Cubic Bézier pieces, each starting where the previous one ends."""

    @property
    @abstractmethod
    def controls(self) -> tuple[Control, ...]:
        """Control points of every cubic, in order."""

    @abstractmethod
    def name_of(self, index: int) -> str:
        """Return the name of a cubic in error messages."""

    @cached_property
    def closed(self) -> bool:
        """Whether the chain ends where it starts; that point is then a joint like any other."""
        return self.controls[0][0] == self.controls[-1][3]

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Simple pieces of the entire chain, in order; ``u_from`` and ``u_to`` are parameters of `points`."""
        n = len(self.controls)
        pieces: list[Piece] = []
        for i, control in enumerate(self.controls):
            parts = simple_pieces(control, self.name_of(i))
            pieces += [Piece(part, (i + u_from) / n, (i + u_to) / n) for part, u_from, u_to in parts]
        if self.closed and len(pieces) == 2:  # `hits` requires different neighbours at both ends of a piece
            pieces = [half for piece in pieces for half in halves(piece)]
        return tuple(pieces)

    @property
    def start(self) -> Point:
        """First point, mm."""
        return self.controls[0][0]

    @property
    def end(self) -> Point:
        """Last point, mm."""
        return self.controls[-1][3]

    def points(self, u: FloatArray) -> FloatArray:
        """Return points (N, 2) in mm at parameters ``u`` (N,) in [0, 1]; each cubic has an equal part of it."""
        n = len(self.controls)
        index = np.clip(np.floor(u * n), 0, n - 1).astype(int)
        v = (u * n - index)[:, None]
        w = 1.0 - v
        a, b, c, d = np.asarray(self.controls)[index].transpose(1, 0, 2)
        return np.asarray(w**3 * a + 3.0 * w * v * (w * b + v * c) + v**3 * d)

    def velocities(self, u: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2) of `points` by their parameter, mm; at a joint, that of the following piece."""
        n = len(self.controls)
        index = np.clip(np.floor(u * n), 0, n - 1).astype(int)
        v = (u * n - index)[:, None]
        w = 1.0 - v
        steps = np.diff(np.asarray(self.controls)[index], axis=1)
        return np.asarray(3.0 * n * (w * w * steps[:, 0] + 2.0 * w * v * steps[:, 1] + v * v * steps[:, 2]))

    def parts(self, u_from: float, u_to: float) -> tuple[Control, ...]:
        """Return the control points of the cubics between two parameters, in order; the first and the last are cut."""
        n = len(self.controls)
        first = min(int(u_from * n), n - 1)
        last = max(min(math.ceil(u_to * n) - 1, n - 1), first)
        controls = list(self.controls[first : last + 1])
        if (end := u_to * n - last) < 1.0:
            controls[-1] = cut(controls[-1], end)[0]
        else:
            end = 1.0
        if (start := u_from * n - first) > 0.0:
            controls[0] = cut(controls[0], start / end if first == last else start)[1]
        return tuple(controls)

    def flattened(self, tolerance_mm: float = 1e-3) -> FloatArray:
        """Return a polyline (N, 2) that deviates from the curve by at most ``tolerance_mm``.

        A piece deviates from its chord by at most 3/4 as much as its handles do.
        """
        waiting = [piece.control for piece in reversed(self.pieces)]
        points = [self.start]
        while waiting:
            control = waiting.pop()
            chord = unit(minus(control[3], control[0]))
            if 0.75 * max(abs(cross(chord, minus(handle, control[0]))) for handle in control[1:3]) <= tolerance_mm:
                points.append(control[3])
            else:
                waiting += reversed(cut(control, 0.5))
            if len(points) + len(waiting) > MAX_POINTS:
                raise DesignError("tolerance_mm", value=tolerance_mm, limit=f"would need more than {MAX_POINTS} points")
        return np.array(points)

    def normal_at(self, point: Point) -> Point:
        """Return the left unit normal at a point of the curve; at a corner, the normal of one of the two pieces."""
        nearest = self._nearest(point)
        return left_of(tangent_at(self.pieces[nearest.piece].control, nearest.v))

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """Return the distances > 0 in mm at which a ray meets the curve, in any order."""
        ray = Ray(origin, direction)
        sides = self._sides(ray)
        values: list[float] = []
        done: set[int] = set()
        if leaving:
            start = self._nearest(origin)
            for forwards in (True, False):
                values += self._leave(ray, start, sides, forwards)
                done |= {start.piece, self._next(start.piece, forwards)}
        for i in range(len(self.pieces)):
            if i not in done:
                values += self._meet(ray, i, sides)
        if not self.closed:
            for end, offset in ((-1, ray.offset(self.start)), (len(self.pieces), ray.offset(self.end))):
                if end not in done:
                    values += self._meet_end(ray, offset, forwards=end > 0)
        return tuple(t for t in values if t > 0.0)

    def _next(self, piece: int, forwards: bool) -> int:
        """Return the index of the piece beyond one end of a piece; out of range at the ends of an open chain."""
        following = piece + 1 if forwards else piece - 1
        return following % len(self.pieces) if self.closed else following

    def _control(self, piece: int, forwards: bool) -> Control:
        """Return the control points of a piece in the direction in which it is traversed."""
        control = self.pieces[piece].control
        return control if forwards else backwards(control)

    def _sides(self, ray: Ray) -> list[bool]:
        """Return whether the start of each piece, and finally the end of the chain, is on the left of the ray's line.

        A joint on the line itself is assigned to the side of the piece before it: a line that only touches the curve
        there does not meet it, and a line that crosses it meets it once.
        """
        sides = []
        for i, piece in enumerate(self.pieces):
            offset = ray.offset(piece.control[0])
            if offset == 0.0 and (i > 0 or self.closed):
                rises = ray.lateral_rises(steps_of(self.pieces[i - 1].control))
                offset = next((-rise for rise in reversed(rises) if rise != 0.0), 0.0)
            sides.append(offset > 0.0)
        return [*sides, sides[0] if self.closed else ray.offset(self.pieces[-1].control[3]) > 0.0]

    def _meet(self, ray: Ray, piece: int, sides: list[bool]) -> Iterator[float]:
        """Yield the distances to the intersections with a piece on which the ray does not start."""
        control = self.pieces[piece].control
        first, last = sides[piece], sides[piece + 1]
        if all((ray.offset(handle) > 0.0) == first == last for handle in control[1:3]):
            return
        steps = steps_of(control)
        forward = ray.forward_rises(steps)
        for v in crossings(ray.offset(control[0]), ray.lateral_rises(steps), first, last):
            yield ray.distance(control[0]) + rise(forward, v)

    def _meet_end(self, ray: Ray, offset: float, forwards: bool) -> Iterator[float]:
        """Yield the distance to the straight extension of the chain beyond an end that is ``offset`` from the line."""
        control = self._control(-1 if forwards else 0, forwards)
        outwards = unit(minus(control[3], control[2]))
        extension = END_TOLERANCE_MM * cross(ray.direction, outwards)
        if (offset > 0.0) != (offset + extension > 0.0):
            fraction = -offset / extension
            yield ray.distance(control[3]) + fraction * END_TOLERANCE_MM * dot(ray.direction, outwards)

    def _leave(self, ray: Ray, start: ChainPoint, sides: list[bool], forwards: bool) -> Iterator[float]:
        """Yield the distances to intersections with the piece on which the ray starts and the next in one direction."""
        origin = point_at(self.pieces[start.piece].control, start.v)
        rest = ray.offset(origin)
        before, after = (start.v, 1.0 - start.v) if forwards else (1.0 - start.v, start.v)
        steps = steps_after(steps_of(self._control(start.piece, forwards)), before, after)
        lateral = ray.lateral_rises(steps)
        offset = sum(lateral)
        for v in other_crossing(lateral, offset > 0.0):
            yield _corrected(ray, origin, steps, v, rest)
        following = self._next(start.piece, forwards)
        if not 0 <= following < len(self.pieces):
            if offset != 0.0:
                yield from self._meet_end(ray, offset, forwards)
            return
        control = self._control(following, forwards)
        steps = steps_of(control)
        lateral = ray.lateral_rises(steps)
        far_side = sides[following + 1] if forwards else sides[following]
        known = offset == 0.0  # the ray starts at the joint, or the chain follows the ray's line up to the joint
        for v in other_crossing(lateral, far_side) if known else crossings(offset, lateral, offset > 0.0, far_side):
            yield _corrected(ray, control[0], steps, v, rest)

    @cached_property
    def _boxes(self) -> tuple[tuple[float, float, float, float], ...]:
        """Minimum and maximum x, then z, of every piece's control points."""
        boxes = []
        for piece in self.pieces:
            x, z = zip(*piece.control, strict=True)
            boxes.append((min(x), max(x), min(z), max(z)))
        return tuple(boxes)

    def _nearest(self, point: Point) -> ChainPoint:
        """Return the position of a point that is on the chain to within rounding, by its projection on each chord."""
        best = ChainPoint(0, 0.0, math.inf)
        x, z = point
        for i, (x_low, x_high, z_low, z_high) in enumerate(self._boxes):
            if max(x_low - x, x - x_high, z_low - z, z - z_high) >= best.distance_mm:
                continue
            v = _projected(self.pieces[i].control, point)
            distance = math.dist(point_at(self.pieces[i].control, v), point)
            if distance < best.distance_mm:
                best = ChainPoint(i, v, distance)
        return best


def _projected(control: Control, point: Point) -> float:
    """Return the parameter in [0, 1] at which a simple piece and a point have the same projection on its chord.

    The projection of the piece increases monotonically.
    """
    chord = Ray(point, unit(minus(control[3], control[0])))
    start, rises = chord.distance(control[0]), chord.forward_rises(steps_of(control))
    if start >= 0.0:
        return 0.0
    if chord.distance(control[3]) <= 0.0:
        return 1.0
    return solve(lambda v: start + rise(rises, v), lambda v: slope(rises, v), growing=True)


def _corrected(ray: Ray, start: Point, steps: Steps, v: float, rest: float) -> float:
    """Return the distance to the root v of a cubic, corrected to first order for its omitted constant ``rest``.

    The constant is only the rounding error of the ray's start, but such errors would add up over many reflections, as
    in `solen.curve.quadratic_roots`.
    """
    lateral, forward = ray.lateral_rises(steps), ray.forward_rises(steps)
    distance = ray.distance(start) + rise(forward, v)
    across, along = slope(lateral, v), slope(forward, v)
    if abs(rest) * math.hypot(across, along) < SMALL * abs(across * distance):
        distance -= rest / across * along
    return distance

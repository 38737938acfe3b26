"""Intersection of rays with chains of cubic Bézier pieces.

A chain is stored as simple pieces (see `solen.curve.cubic`). For each joint between two pieces, the side of the ray's
line on which it lies is decided once for both: a ray can neither slip through a joint nor intersect the curve twice
there.

A ray that leaves the chain starts at a point on one piece. That piece is cut there into two parts with a known root at
their common end, which is divided out. The pieces beyond the far ends are also computed relative to the starting point,
across the joint rather than by coordinates, so a second intersection just beyond a joint is as exact as one on the same
piece. If a ray starts at a joint, its known root is on both pieces.
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
    risen,
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
    """A ray, with coordinates of points and steps relative to it."""

    origin: Point
    direction: Point

    def beside(self, point: Point) -> float:
        """Return the distance of a point from the ray's line, positive on its left."""
        return cross(self.direction, minus(point, self.origin))

    def ahead(self, point: Point) -> float:
        """Return the distance of a point from the origin along the ray."""
        return dot(self.direction, minus(point, self.origin))

    def aside(self, steps: Steps) -> Rises:
        """Return the change of the distance from the line along steps."""
        a, b, c = steps
        return (cross(self.direction, a), cross(self.direction, b), cross(self.direction, c))

    def onwards(self, steps: Steps) -> Rises:
        """Return the change of the distance along the ray over steps."""
        a, b, c = steps
        return (dot(self.direction, a), dot(self.direction, b), dot(self.direction, c))


class Place(NamedTuple):
    """Position of a point on a chain: piece index, parameter on the piece, and distance from the piece."""

    piece: int
    v: float
    distance_mm: float


class CubicChain(Curve):
    """Cubic Bézier pieces, each starting where the previous one ends."""

    @property
    @abstractmethod
    def controls(self) -> tuple[Control, ...]:
        """Return the control points of every cubic, in order."""

    @abstractmethod
    def name_of(self, number: int) -> str:
        """Return the name of a cubic in error messages."""

    @cached_property
    def closed(self) -> bool:
        """Whether the chain ends where it starts; that point is then a joint like any other."""
        return self.controls[0][0] == self.controls[-1][3]

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Simple pieces of the entire chain, in order; ``u_from`` and ``u_to`` are parameters of `points`."""
        n = len(self.controls)
        found: list[Piece] = []
        for i, control in enumerate(self.controls):
            parts = simple_pieces(control, self.name_of(i))
            found += [Piece(part, (i + u_from) / n, (i + u_to) / n) for part, u_from, u_to in parts]
        if self.closed and len(found) == 2:  # a ray that leaves one must find two others behind its ends
            found = [half for piece in found for half in halves(piece)]
        return tuple(found)

    @property
    def start(self) -> Point:
        """See :attr:`Curve.start`."""
        return self.controls[0][0]

    @property
    def end(self) -> Point:
        """See :attr:`Curve.end`."""
        return self.controls[-1][3]

    def points(self, u: FloatArray) -> FloatArray:
        """See :meth:`Curve.points`; each cubic has an equal share of the parameter range."""
        n = len(self.controls)
        which = np.clip(np.floor(u * n), 0, n - 1).astype(int)
        v = (u * n - which)[:, None]
        w = 1.0 - v
        a, b, c, d = np.asarray(self.controls)[which].transpose(1, 0, 2)
        return np.asarray(w**3 * a + 3.0 * w * v * (w * b + v * c) + v**3 * d)

    def velocities(self, u: FloatArray) -> FloatArray:
        """See :meth:`Curve.velocities`; at a joint, the velocity of the following piece."""
        n = len(self.controls)
        which = np.clip(np.floor(u * n), 0, n - 1).astype(int)
        v = (u * n - which)[:, None]
        w = 1.0 - v
        steps = np.diff(np.asarray(self.controls)[which], axis=1)
        return np.asarray(3.0 * n * (w * w * steps[:, 0] + 2.0 * w * v * steps[:, 1] + v * v * steps[:, 2]))

    def parts(self, u_from: float, u_to: float) -> tuple[Control, ...]:
        """Return the control points of the cubics between two parameters, in order; the first and the last are cut."""
        n = len(self.controls)
        first = min(int(u_from * n), n - 1)
        last = max(min(math.ceil(u_to * n) - 1, n - 1), first)
        found = list(self.controls[first : last + 1])
        if (end := u_to * n - last) < 1.0:
            found[-1] = cut(found[-1], end)[0]
        else:
            end = 1.0
        if (start := u_from * n - first) > 0.0:
            found[0] = cut(found[0], start / end if first == last else start)[1]
        return tuple(found)

    def flattened(self, tolerance_mm: float = 1e-3) -> FloatArray:
        """See :meth:`Curve.flattened`; a piece deviates from its chord by at most 3/4 of its handles' deviation."""
        waiting = [piece.control for piece in reversed(self.pieces)]
        found = [self.start]
        while waiting:
            control = waiting.pop()
            chord = unit(minus(control[3], control[0]))
            if 0.75 * max(abs(cross(chord, minus(handle, control[0]))) for handle in control[1:3]) <= tolerance_mm:
                found.append(control[3])
            else:
                waiting += reversed(cut(control, 0.5))
            if len(found) + len(waiting) > MAX_POINTS:
                raise DesignError("tolerance_mm", value=tolerance_mm, limit=f"would need more than {MAX_POINTS} points")
        return np.array(found)

    def normal_at(self, point: Point) -> Point:
        """See :meth:`Curve.normal_at`; at a corner, the normal of one of the two pieces."""
        place = self._place(point)
        return left_of(tangent_at(self.pieces[place.piece].control, place.v))

    def hits(self, origin: Point, direction: Point, *, leaving: bool = False) -> tuple[float, ...]:
        """See :meth:`Curve.hits`."""
        ray = Ray(origin, direction)
        sides = self._sides(ray)
        values: list[float] = []
        done: set[int] = set()
        if leaving:
            place = self._place(origin)
            for forwards in (True, False):
                values += self._leave(ray, place, sides, forwards)
                done |= {place.piece, self._next(place.piece, forwards)}
        for i in range(len(self.pieces)):
            if i not in done:
                values += self._meet(ray, i, sides)
        if not self.closed:
            for end, beside in ((-1, ray.beside(self.start)), (len(self.pieces), ray.beside(self.end))):
                if end not in done:
                    values += self._meet_end(ray, beside, forwards=end > 0)
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

        A joint on the line itself counts as on the side from which the preceding piece comes: a line that only touches
        the curve there does not meet it, and a line that crosses it meets it once.
        """
        sides = []
        for i, piece in enumerate(self.pieces):
            beside = ray.beside(piece.control[0])
            if beside == 0.0 and (i > 0 or self.closed):
                rises = ray.aside(steps_of(self.pieces[i - 1].control))
                beside = next((-rise for rise in reversed(rises) if rise != 0.0), 0.0)
            sides.append(beside > 0.0)
        return [*sides, sides[0] if self.closed else ray.beside(self.pieces[-1].control[3]) > 0.0]

    def _meet(self, ray: Ray, piece: int, sides: list[bool]) -> Iterator[float]:
        """Return distances to a piece on which the ray does not start."""
        control = self.pieces[piece].control
        first, last = sides[piece], sides[piece + 1]
        if all((ray.beside(handle) > 0.0) == first == last for handle in control[1:3]):
            return
        steps = steps_of(control)
        onwards = ray.onwards(steps)
        for v in crossings(ray.beside(control[0]), ray.aside(steps), first, last):
            yield ray.ahead(control[0]) + risen(onwards, v)

    def _meet_end(self, ray: Ray, beside: float, forwards: bool) -> Iterator[float]:
        """Return the distance to the straight extension of the chain beyond an end at a given offset from the line."""
        control = self._control(-1 if forwards else 0, forwards)
        outwards = unit(minus(control[3], control[2]))
        rise = END_TOLERANCE_MM * cross(ray.direction, outwards)
        if (beside > 0.0) != (beside + rise > 0.0):
            share = -beside / rise
            yield ray.ahead(control[3]) + share * END_TOLERANCE_MM * dot(ray.direction, outwards)

    def _leave(self, ray: Ray, place: Place, sides: list[bool], forwards: bool) -> Iterator[float]:
        """Return the intersections in one direction from the ray's start, on its own piece and those beyond."""
        here = point_at(self.pieces[place.piece].control, place.v)
        rest = ray.beside(here)
        done, left = (place.v, 1.0 - place.v) if forwards else (1.0 - place.v, place.v)
        steps = steps_after(steps_of(self._control(place.piece, forwards)), done, left)
        aside = ray.aside(steps)
        beside = sum(aside)
        for v in other_crossing(aside, beside > 0.0):
            yield _corrected(ray, here, steps, v, rest)
        behind = self._next(place.piece, forwards)
        if not 0 <= behind < len(self.pieces):
            if beside != 0.0:
                yield from self._meet_end(ray, beside, forwards)
            return
        control = self._control(behind, forwards)
        steps = steps_of(control)
        aside = ray.aside(steps)
        far_side = sides[behind + 1] if forwards else sides[behind]
        known = beside == 0.0  # it stands on the joint, or slides along the line to it
        for v in other_crossing(aside, far_side) if known else crossings(beside, aside, beside > 0.0, far_side):
            yield _corrected(ray, control[0], steps, v, rest)

    @cached_property
    def _boxes(self) -> tuple[tuple[float, float, float, float], ...]:
        """Minimum and maximum x, then z, of every piece's control points."""
        boxes = []
        for piece in self.pieces:
            x, z = zip(*piece.control, strict=True)
            boxes.append((min(x), max(x), min(z), max(z)))
        return tuple(boxes)

    def _place(self, point: Point) -> Place:
        """Return the position of a point on the chain despite rounding, by its projection on each chord."""
        best = Place(0, 0.0, math.inf)
        x, z = point
        for i, (x_low, x_high, z_low, z_high) in enumerate(self._boxes):
            if max(x_low - x, x - x_high, z_low - z, z - z_high) >= best.distance_mm:
                continue
            v = _beside_chord(self.pieces[i].control, point)
            distance = math.dist(point_at(self.pieces[i].control, v), point)
            if distance < best.distance_mm:
                best = Place(i, v, distance)
        return best


def _beside_chord(control: Control, point: Point) -> float:
    """Return the parameter in [0, 1] at which a simple piece is as far along its chord as a point.

    The position along the chord increases monotonically.
    """
    chord = Ray(point, unit(minus(control[3], control[0])))
    start, rises = chord.ahead(control[0]), chord.onwards(steps_of(control))
    if start >= 0.0:
        return 0.0
    if chord.ahead(control[3]) <= 0.0:
        return 1.0
    return solve(lambda v: start + risen(rises, v), lambda v: slope(rises, v), growing=True)


def _corrected(ray: Ray, start: Point, steps: Steps, v: float, rest: float) -> float:
    """Return the distance to the root v of a cubic, corrected to first order for its omitted constant ``rest``.

    As in `solen.curve.quadratic_roots`, the ray deviates from the curve only by rounding, but such errors would add up.
    """
    aside, onwards = ray.aside(steps), ray.onwards(steps)
    distance = ray.ahead(start) + risen(onwards, v)
    across, ahead = slope(aside, v), slope(onwards, v)
    if abs(rest) * math.hypot(across, ahead) < SMALL * abs(across * distance):
        distance -= rest / across * ahead
    return distance

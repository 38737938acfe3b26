"""One cubic Bézier piece: cutting, splitting into simple pieces, and intersection with a line.

For a ray, only two cubics in the parameter matter: the distance of the curve's points from the ray's line, and their
position along it. Both are stored as a value at v = 0 and three *rises*, the components of the piece's three *steps*
(from each control point to the next). Differences of rises are independent of the large absolute coordinates, so if the
value at v = 0 is known to be 0, the root there is divided out exactly and the other is accurate to all digits.

A *simple* piece has no inflection and turns by less than `MAX_TURN_DEG`. All its tangents are within this angle, so its
speed is nowhere 0, it is parallel to a line at one point at most, and its distance from a line has at most two roots.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

from solen.curve.base import ROUNDING, quadratic_roots
from solen.errors import DesignError
from solen.plane import Point, cross, dot, minus, unit

Control = tuple[Point, Point, Point, Point]
"""Control points of a cubic Bézier piece: its start, a handle for each end, its end."""
Rises = tuple[float, float, float]
"""Changes of a value over three successive steps."""
Steps = tuple[Point, Point, Point]

MAX_TURN_DEG = 60.0
"""Upper limit for the turn of a simple piece."""
MAX_PIECES = 100
"""Maximum number of simple pieces: far more than a cubic has unless it is nearly a cusp."""
MAX_STEPS = 200
"""Maximum number of steps of `solve`: far more than bisection needs, unless the root is next to 0."""
CLEAR_TURN_DEG = 170.0
"""Largest turn of a piece for which the bisector of its end tangents is certainly a tangent between its ends."""
MIN_FRACTION = 1e-6
"""Smallest part of a piece that is cut off: a bend within less is a corner, and an inflection nearer to an end is
insignificant.
"""


class Piece(NamedTuple):
    """A simple part of a longer curve: its control points, and its range of that curve's parameter."""

    control: Control
    u_from: float
    u_to: float


def simple_pieces(control: Control, what: str = "bezier") -> list[Piece]:
    """Split a cubic into simple pieces that share their ends exactly, in order; ``u_from`` and ``u_to`` are in [0, 1].

    The cubic is cut at its inflections, and then at half of its turn until every piece turns by less than 60 degrees.
    Raise `DesignError`, with its name ``what``, if this does not end: the cubic then has no length, a cusp, or a handle
    that coincides with its end.
    """
    waiting = _between_inflections(control)[::-1]
    pieces: list[Piece] = []
    while waiting:
        piece = waiting.pop()
        if turn_deg(steps_of(piece.control)) < MAX_TURN_DEG:
            pieces.append(piece)
        elif piece.u_to - piece.u_from < MIN_FRACTION or len(pieces) + len(waiting) > MAX_PIECES:
            x, z = piece.control[0]
            raise DesignError(
                f"{what} near x = {x:.6g} mm, z = {z:.6g} mm",
                limit="must not have zero length, a cusp, or a handle that coincides with its end",
                remedy="move the handles away from the ends and from each other, or split the cubic into two",
            )
        else:
            waiting += reversed(halves(piece))
    return pieces


def _between_inflections(control: Control) -> list[Piece]:
    rest, u_from = control, 0.0
    pieces = []
    for u in inflections(control):
        first, rest = cut(rest, (u - u_from) / (1.0 - u_from))
        pieces.append(Piece(first, u_from, u))
        u_from = u
    return [*pieces, Piece(rest, u_from, 1.0)]


def halves(piece: Piece) -> tuple[Piece, Piece]:
    """Return both parts of a piece, split at half of its turn, or at v = 0.5 if that is unclear or near an end."""
    d0, d1, d2 = steps_of(piece.control)
    v = 0.5
    if 0.0 < turn_deg((d0, d1, d2)) < CLEAR_TURN_DEG:
        first, last = unit(d0), unit(d2)
        bisector = (first[0] + last[0], first[1] + last[1])
        rises = (cross(bisector, d0), cross(bisector, d1), cross(bisector, d2))
        v = extremum_of(rises)
        v = v if MIN_FRACTION < v < 1.0 - MIN_FRACTION else 0.5
    left, right = cut(piece.control, v)
    middle = piece.u_from + v * (piece.u_to - piece.u_from)
    return Piece(left, piece.u_from, middle), Piece(right, middle, piece.u_to)


def steps_of(control: Control) -> Steps:
    """Return the vectors from each control point to the next."""
    a, b, c, d = control
    return (minus(b, a), minus(c, b), minus(d, c))


def turn_deg(steps: Steps) -> float:
    """Return the total turn of the control polygon, an upper bound for that of the piece.

    It is infinite if a handle coincides with its end.
    """
    if steps[0] == (0.0, 0.0) or steps[2] == (0.0, 0.0):
        return math.inf
    moving = [unit(step) for step in steps if step != (0.0, 0.0)]
    return math.degrees(sum(abs(math.atan2(cross(a, b), dot(a, b))) for a, b in pairwise(moving)))


def inflections(control: Control) -> list[float]:
    """Return the parameters inside (0, 1) at which the curvature changes sign: P' × P'' = 0, which is quadratic."""
    d0, d1, d2 = steps_of(control)
    d01, d02, d12 = cross(d0, d1), cross(d0, d2), cross(d1, d2)
    longest = max(dot(d, d) for d in (d0, d1, d2))
    if max(abs(d01), abs(d02), abs(d12)) <= ROUNDING * longest:
        return []  # straight
    values: list[float] = []
    for v in sorted(quadratic_roots(d01 + d12 - d02, d02 - 2.0 * d01, d01, leaving=False)):
        if (values[-1] if values else 0.0) + MIN_FRACTION < v < 1.0 - MIN_FRACTION:
            values.append(v)
    return values


def cut(control: Control, v: float) -> tuple[Control, Control]:
    """Return the parts of a cubic before and after parameter v (de Casteljau); both contain the point at v."""
    a, b, c, d = control
    ab, bc, cd = _between(a, b, v), _between(b, c, v), _between(c, d, v)
    abc, bcd = _between(ab, bc, v), _between(bc, cd, v)
    middle = _between(abc, bcd, v)
    return (a, ab, abc, middle), (middle, bcd, cd, d)


def _between(a: Point, b: Point, v: float) -> Point:
    return ((1.0 - v) * a[0] + v * b[0], (1.0 - v) * a[1] + v * b[1])


def point_at(control: Control, v: float) -> Point:
    """Return the point of a cubic at parameter v."""
    return cut(control, v)[0][3]


def tangent_at(control: Control, v: float) -> Point:
    """Return the unit tangent of a cubic at parameter v."""
    d0, d1, d2 = steps_of(control)
    w = 1.0 - v
    w0, w1, w2 = w * w, 2.0 * w * v, v * v
    return unit((w0 * d0[0] + w1 * d1[0] + w2 * d2[0], w0 * d0[1] + w1 * d1[1] + w2 * d2[1]))


def backwards(control: Control) -> Control:
    """Return the same piece traversed from its end."""
    a, b, c, d = control
    return (d, c, b, a)


def steps_after(steps: Steps, v: float, w: float) -> Steps:
    """Return the steps of the part after parameter v; ``w`` is 1 − v, a separate argument to keep its digits."""
    d0, d1, d2 = steps
    d01 = (w * d0[0] + v * d1[0], w * d0[1] + v * d1[1])
    d12 = (w * d1[0] + v * d2[0], w * d1[1] + v * d2[1])
    d012 = (w * d01[0] + v * d12[0], w * d01[1] + v * d12[1])
    return ((w * d012[0], w * d012[1]), (w * d12[0], w * d12[1]), (w * d2[0], w * d2[1]))


def rise(rises: Rises, v: float) -> float:
    """Return the sum of the rises up to v: a cubic that is 0 at 0, and their total at 1."""
    return v * rise_per_v(rises, v)


def rise_per_v(rises: Rises, v: float) -> float:
    """Return `rise` divided by v: a quadratic."""
    g0, g1, g2 = rises
    w = 1.0 - v
    return 3.0 * w * (w * g0 + v * (g0 + g1)) + v * v * (g0 + g1 + g2)


def slope(rises: Rises, v: float) -> float:
    """Return the derivative of `rise`."""
    g0, g1, g2 = rises
    w = 1.0 - v
    return 3.0 * (w * w * g0 + 2.0 * w * v * g1 + v * v * g2)


def extremum_of(rises: Rises) -> float:
    """Return the parameter at which `rise` has its extremum, if its first and last rise have different signs."""
    g0, g1, g2 = rises
    return solve(lambda v: slope(rises, v), lambda v: 6.0 * ((1.0 - v) * (g1 - g0) + v * (g2 - g1)), growing=g2 > 0.0)


def crossings(start: float, rises: Rises, left_first: bool, left_last: bool) -> list[float]:
    """Return the roots in [0, 1] of start + rise(v) for a simple piece, in order.

    ``left_first`` and ``left_last`` indicate whether its ends are on the left of the line. Two pieces that share an end
    use the same side there, so they neither both find a root at the end nor both miss it.
    """
    bounds = [(0.0, left_first), (1.0, left_last)]
    if (rises[0] > 0.0) != (rises[2] > 0.0):
        extremum = extremum_of(rises)
        bounds.insert(1, (extremum, start + rise(rises, extremum) > 0.0))
    return [
        solve(lambda v: start + rise(rises, v), lambda v: slope(rises, v), low, high, growing=left_high)
        for (low, left_low), (high, left_high) in pairwise(bounds)
        if left_low != left_high
    ]


def other_crossing(rises: Rises, left_last: bool) -> list[float]:
    """Return the root of rise(v) in (0, 1] of a simple piece other than v = 0, as a list that may be empty."""
    g0, g1, g2 = rises
    left_first = g0 > 0.0
    if g0 == 0.0 or left_first == left_last:
        return []
    square, linear = g0 - 2.0 * g1 + g2, 3.0 * (g1 - g0)
    return [solve(lambda v: rise_per_v(rises, v), lambda v: 2.0 * square * v + linear, growing=left_last)]


def solve(
    value: Callable[[float], float],
    slope_of: Callable[[float], float],
    low: float = 0.0,
    high: float = 1.0,
    *,
    growing: bool,
) -> float:
    """Return the root between two bounds to the last digit, by Newton's method safeguarded by bisection.

    ``growing`` indicates that the value is positive at the upper bound; it is never evaluated at the bounds themselves.
    """
    v, previous_step = 0.5 * (low + high), high - low
    for _ in range(MAX_STEPS):
        error = value(v)
        if error == 0.0:
            return v
        if (error > 0.0) == growing:
            high = v
        else:
            low = v
        gradient = slope_of(v)
        step = -error / gradient if gradient != 0.0 else math.inf
        if abs(step) <= ROUNDING * v:
            return v
        if not (low < v + step < high and abs(step) < 0.5 * previous_step):
            step = 0.5 * (low + high) - v
            if v + step in (low, high):
                return v
        previous_step = abs(step)
        v += step
    return v

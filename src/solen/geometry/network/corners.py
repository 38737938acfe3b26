"""Corners of a network: the junctions between the walls of two guides, and their fillets.

One wall arrives at a node and the next departs from it, both with the material on their left.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Curve, Segment
from solen.errors import DesignError
from solen.geometry.body import GAP_MM, place_text
from solen.plane import Point, along, cross, dot, left_of, minus, right_of, unit

PIECES = 64
"""Number of segments into which two curves are divided for the first search for intersections."""
NEWTON_STEPS = 30
STRAIGHT = 1e-12
"""Sine of the smallest angle between walls that form a corner."""


@dataclass(frozen=True)
class Run:
    """One side of a guide in the direction of the outline, and the part of it that remains.

    ``low`` and ``high`` are parameters of its curve; ``first`` and ``last`` are the points there if a corner determines
    them.
    """

    guide: str
    side: str
    curve: Curve
    low: float = 0.0
    high: float = 1.0
    first: Point | None = None
    last: Point | None = None
    heading_deg: float | None = None
    """direction of the guide, if it is straight, has a constant width, and its direction was specified"""
    back_mm: float = 0.0
    """length by which a straight wall may be extended beyond the first section of its guide to meet another straight
    wall
    """

    @property
    def start(self) -> Point:
        """Start of the remaining part."""
        return self.first or self.curve.point_at(self.low)

    @property
    def end(self) -> Point:
        """End of the remaining part."""
        return self.last or self.curve.point_at(self.high)

    @property
    def rest(self) -> Curve:
        """The remaining part of the curve."""
        if not self.low < self.high:
            limit = f"is shorter than the corners at its ends, at {place_text(self.curve.middle_point)}"
            raise DesignError(
                f"guide {self.guide}",
                limit=limit,
                remedy="lengthen or narrow the guide, or increase the angles between guides",
            )
        if isinstance(self.curve, Segment):
            return Segment(self.start, self.end)
        return self.curve if (self.low, self.high) == (0.0, 1.0) else self.curve.part(self.low, self.high)


def joined(arriving: Run, departing: Run, fillet_mm: float, node: str, at: Point) -> tuple[Run, Run, Curve | None]:
    """Return two walls cut at their intersection, and the curve between them: a fillet, or a line if they do not meet.

    If a guide ends wider than the next one begins, there is a shoulder along its last section.

    Raises
    ------
    DesignError
        If the fillet is too large for the walls.
    """
    if math.dist(arriving.end, departing.start) <= GAP_MM:
        return arriving, departing, None
    met = _crossing(arriving, departing)
    if met is None:
        return _shouldered(arriving, departing, at)
    u, v, corner = met
    cut = replace(arriving, high=u, last=corner), replace(departing, low=v, first=corner)
    return (*cut, None) if fillet_mm == 0.0 else _filleted(*cut, fillet_mm, node)


def cut_at(run: Run, base: Point, ahead: Point, height_mm: float, *, at_end: bool) -> Run:
    """Return a wall without the part below a height over the section through a base; `DesignError` if nothing remains.

    The section is at the end of the wall if ``at_end`` is set, otherwise at its start.
    """
    from scipy.optimize import brentq

    def above(u: float) -> float:
        return dot(minus(run.curve.point_at(u), base), ahead) - height_mm

    near, far = (run.high, run.low) if at_end else (run.low, run.high)
    if above(far) <= 0.0:
        limit = f"is shorter than the {height_mm:.3g} mm over which a lens joins it, at {place_text(base)}"
        raise DesignError(f"guide {run.guide}", limit=limit, remedy="reduce the rotation angle, or lengthen the guide")
    u = float(brentq(above, near, far, xtol=1e-15)) if above(near) < 0.0 else near
    place = run.curve.point_at(u)
    return replace(run, high=u, last=place) if at_end else replace(run, low=u, first=place)


def _shouldered(arriving: Run, departing: Run, at: Point) -> tuple[Run, Run, Curve | None]:
    """Return two walls that do not meet, and the straight face between them."""
    last, first = _section(arriving, arriving.end, at), _section(departing, at, departing.start)
    if last is not None and (met := _crossing(last, departing)) is not None and met[0] > 0.0:
        return arriving, replace(departing, low=met[1], first=met[2]), Segment(arriving.end, met[2])
    if first is not None and (met := _crossing(arriving, first)) is not None and met[1] < 1.0:
        return replace(arriving, high=met[0], last=met[2]), departing, Segment(met[2], departing.start)
    return arriving, departing, Segment(arriving.end, departing.start)


def _section(run: Run, start: Point, end: Point) -> Run | None:
    return None if start == end else Run(run.guide, run.side, Segment(start, end))


def _crossing(a: Run, b: Run) -> tuple[float, float, Point] | None:
    """Parameters of the intersection nearest to the end of one wall and the start of the next; its position."""
    if isinstance(a.curve, Segment) and isinstance(b.curve, Segment):
        return _crossing_of_lines(a, b, a.curve, b.curve)
    ends = np.linspace(0.0, 1.0, PIECES + 1)
    found = _near_crossings(a.curve.points(ends), b.curve.points(ends))
    for u, v in sorted(found, key=lambda pair: (1.0 - pair[0]) + pair[1]):
        exact = _refined(a.curve, b.curve, u, v)
        if exact is not None:
            return (*exact, a.curve.point_at(exact[0]))
    return None


def _crossing_of_lines(a: Run, b: Run, one: Segment, other: Segment) -> tuple[float, float, Point] | None:
    p, q, apart = minus(one.b, one.a), minus(other.b, other.a), minus(other.a, one.a)
    area = cross(p, q)
    if abs(area) <= STRAIGHT * math.hypot(*p) * math.hypot(*q):
        return None
    u, v = cross(apart, q) / area, cross(apart, p) / area
    back = min(a.back_mm, b.back_mm)
    if not (0.0 <= u <= 1.0 + back / one.length_mm and -back / other.length_mm <= v <= 1.0):
        return None
    return u, v, _of_mirror_images(a, b, one, other) or one.point_at(u)


def _of_mirror_images(a: Run, b: Run, one: Segment, other: Segment) -> Point | None:
    """Intersection of two lines mirrored about an upright line, placed exactly on it to preserve symmetry."""
    if a.heading_deg is None or b.heading_deg is None or a.heading_deg != -b.heading_deg or one.a[1] != other.b[1]:
        return None
    middle = 0.5 * (one.a[0] + other.b[0])
    return (middle, one.a[1] + (one.a[0] - middle) / math.tan(math.radians(a.heading_deg)))


def _near_crossings(a: FloatArray, b: FloatArray) -> list[tuple[float, float]]:
    """Return approximate parameters of every intersection of two polylines (N, 2)."""
    p, q = np.diff(a, axis=0)[:, None], np.diff(b, axis=0)[None]
    apart = b[None, :-1] - a[:-1, None]
    area = p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (apart[..., 0] * q[..., 1] - apart[..., 1] * q[..., 0]) / area
        v = (apart[..., 0] * p[..., 1] - apart[..., 1] * p[..., 0]) / area
    slack = 0.05
    rows, columns = np.nonzero((u >= -slack) & (u <= 1.0 + slack) & (v >= -slack) & (v <= 1.0 + slack))
    places = np.column_stack([rows + u[rows, columns], columns + v[rows, columns]]) / PIECES
    return [(float(u), float(v)) for u, v in places]


def _refined(a: Curve, b: Curve, u: float, v: float) -> tuple[float, float] | None:
    """Return an intersection refined by Newton's method; None if it is beyond an end."""
    for _ in range(NEWTON_STEPS):
        u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
        off = minus(b.point_at(v), a.point_at(u))
        p, q = a.velocity_at(u), b.velocity_at(v)
        area = cross(p, q)
        if area == 0.0:
            return None
        step_u, step_v = cross(off, q) / area, cross(off, p) / area
        u, v = u + step_u, v + step_v
        if abs(step_u) + abs(step_v) <= 1e-15:
            break
    inside = 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0
    return (u, v) if inside and math.dist(a.point_at(u), b.point_at(v)) <= 0.1 * GAP_MM else None


def _filleted(arriving: Run, departing: Run, radius_mm: float, node: str) -> tuple[Run, Run, Curve]:
    """Return a corner with a fillet: an arc tangent to both walls, centred in air on their right."""
    p, q = unit(arriving.curve.velocity_at(arriving.high)), unit(departing.curve.velocity_at(departing.low))
    turn = math.atan2(-cross(p, q), dot(p, q))
    if turn <= 0.0:
        limit = f"the corner at {place_text(arriving.end)} is convex: no material fills it"
        raise DesignError(f"network.nodes {node}", value=radius_mm, limit=limit, remedy="set fillet_mm = 0.0")
    reach_mm = radius_mm * math.tan(0.5 * turn)
    touches = _touches(arriving, departing, radius_mm, reach_mm)
    if touches is None:
        where = place_text(arriving.end)
        room_mm = min(_length_mm(arriving), _length_mm(departing)) / math.tan(0.5 * turn)
        raise DesignError(
            f"node {node}: fillet_mm",
            value=radius_mm,
            limit=f"at {where}, the walls of {arriving.guide} and {departing.guide} have room for a fillet of at most "
            f"{room_mm:.3g} mm",
            remedy="make it smaller",
        )
    before, behind, center = touches
    first, last = before.end, behind.start
    start_deg, end_deg = (math.degrees(math.atan2(z - center[1], x - center[0])) for x, z in (first, last))
    sweep_deg = (end_deg - start_deg) % 360.0 - 360.0
    return before, behind, Arc(center, radius_mm, start_deg, sweep_deg)


def _length_mm(run: Run) -> float:
    ends = run.curve.points(np.linspace(run.low, run.high, PIECES + 1))
    return sum(math.dist(one, other) for one, other in pairwise(map(tuple, ends.tolist())))


def _touches(a: Run, b: Run, radius_mm: float, reach_mm: float) -> tuple[Run, Run, Point] | None:
    """Return walls that end where the fillet begins, and the centre of the fillet; None if they are too short."""
    if isinstance(a.curve, Segment) and isinstance(b.curve, Segment):
        return _touches_of_lines(a, b, a.curve, b.curve, radius_mm, reach_mm)
    from scipy.optimize import root

    def center(curve: Curve, at: float) -> Point:
        at = min(max(at, 0.0), 1.0)
        return along(curve.point_at(at), right_of(unit(curve.velocity_at(at))), radius_mm)

    def apart(places: FloatArray) -> Point:
        return minus(center(a.curve, float(places[0])), center(b.curve, float(places[1])))

    guess = np.array(
        [
            max(a.high - reach_mm / math.hypot(*a.curve.velocity_at(a.high)), a.low),
            min(b.low + reach_mm / math.hypot(*b.curve.velocity_at(b.low)), b.high),
        ]
    )
    found = root(apart, guess, tol=1e-15)
    u, v = (float(place) for place in found.x)
    if not (a.low < u < a.high and b.low < v < b.high) or math.hypot(*apart(found.x)) > 0.1 * GAP_MM:
        return None
    return replace(a, high=u, last=None), replace(b, low=v, first=None), center(a.curve, u)


def _touches_of_lines(
    a: Run, b: Run, one: Segment, other: Segment, radius_mm: float, reach_mm: float
) -> tuple[Run, Run, Point] | None:
    p, q = unit(minus(one.b, one.a)), unit(minus(other.b, other.a))
    u, v = a.high - reach_mm / one.length_mm, b.low + reach_mm / other.length_mm
    if not (a.low < u and v < b.high):
        return None
    first, last = along(a.end, p, -reach_mm), along(b.start, q, reach_mm)
    return replace(a, high=u, last=first), replace(b, low=v, first=last), along(first, left_of(p), -radius_mm)

"""Corners of a network: where the walls of two guides meet, and their fillets.

One wall arrives at a node and the next departs from it, both with the material on their left.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, Curve, Segment
from solen.errors import DesignError
from solen.geometry.body import GAP_MM, point_text
from solen.plane import Point, along, cross, dot, left_of, minus, right_of, unit

SEGMENTS = 64
"""Number of segments into which each curve is divided in the first search for intersections."""
NEWTON_STEPS = 30
MIN_SINE = 1e-12
"""Minimum sine of the angle between straight walls that form a corner."""


@dataclass(frozen=True)
class Run:
    """One side of a guide, in the direction of the outline, and the part of it that remains between its corners.

    The part is between the parameters ``low`` and ``high`` of the curve; ``first`` and ``last`` are its ends where a
    corner determines them.
    """

    guide: str
    side: str
    curve: Curve
    low: float = 0.0
    high: float = 1.0
    first: Point | None = None
    last: Point | None = None
    heading_deg: float | None = None
    """Direction of a straight guide of constant width whose direction was specified; None for other guides."""
    extension_mm: float = 0.0
    """Length by which a straight wall may be extended beyond the first section of its guide to meet another straight
    wall.
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
    def remaining(self) -> Curve:
        """The remaining part of the curve; `DesignError` if nothing remains."""
        if not self.low < self.high:
            limit = f"is shorter than the corners at its ends, at {point_text(self.curve.middle_point)}"
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

    If a guide ends wider than the next one begins, the line is a shoulder along its last section.

    Raises
    ------
    DesignError
        If the fillet is too large for the walls.
    """
    if math.dist(arriving.end, departing.start) <= GAP_MM:
        return arriving, departing, None
    crossing = _crossing(arriving, departing)
    if crossing is None:
        return _with_shoulder(arriving, departing, at)
    u, v, corner = crossing
    cut = replace(arriving, high=u, last=corner), replace(departing, low=v, first=corner)
    return (*cut, None) if fillet_mm == 0.0 else _filleted(*cut, fillet_mm, node)


def cut_at(run: Run, base: Point, ahead: Point, height_mm: float, *, at_end: bool) -> Run:
    """Return the part of a wall whose distance from the section through ``base`` is at least ``height_mm``.

    Distances are measured along ``ahead``. The section is at the end of the wall if ``at_end`` is set, otherwise at its
    start. `DesignError` is raised if no part of the wall is that far from the section.
    """
    from scipy.optimize import brentq

    def above(u: float) -> float:
        return dot(minus(run.curve.point_at(u), base), ahead) - height_mm

    kept_end, other_end = (run.high, run.low) if at_end else (run.low, run.high)
    if above(other_end) <= 0.0:
        limit = f"is shorter than the {height_mm:.3g} mm over which a lens joins it, at {point_text(base)}"
        raise DesignError(f"guide {run.guide}", limit=limit, remedy="reduce the rotation angle, or lengthen the guide")
    u = float(brentq(above, kept_end, other_end, xtol=1e-15)) if above(kept_end) < 0.0 else kept_end
    point = run.curve.point_at(u)
    return replace(run, high=u, last=point) if at_end else replace(run, low=u, first=point)


def _with_shoulder(arriving: Run, departing: Run, at: Point) -> tuple[Run, Run, Curve | None]:
    """Return two walls that do not meet, and the straight line between them."""
    last_section, first_section = _section(arriving, arriving.end, at), _section(departing, at, departing.start)
    if last_section is not None and (crossing := _crossing(last_section, departing)) is not None and crossing[0] > 0.0:
        return arriving, replace(departing, low=crossing[1], first=crossing[2]), Segment(arriving.end, crossing[2])
    if first_section is not None and (crossing := _crossing(arriving, first_section)) is not None and crossing[1] < 1.0:
        return replace(arriving, high=crossing[0], last=crossing[2]), departing, Segment(crossing[2], departing.start)
    return arriving, departing, Segment(arriving.end, departing.start)


def _section(run: Run, start: Point, end: Point) -> Run | None:
    return None if start == end else Run(run.guide, run.side, Segment(start, end))


def _crossing(a: Run, b: Run) -> tuple[float, float, Point] | None:
    """Return the parameters and point of the intersection nearest to the end of a wall and the start of the next."""
    if isinstance(a.curve, Segment) and isinstance(b.curve, Segment):
        return _crossing_of_lines(a, b, a.curve, b.curve)
    ends = np.linspace(0.0, 1.0, SEGMENTS + 1)
    candidates = _near_crossings(a.curve.points(ends), b.curve.points(ends))
    for u, v in sorted(candidates, key=lambda pair: (1.0 - pair[0]) + pair[1]):
        exact = _refined(a.curve, b.curve, u, v)
        if exact is not None:
            return (*exact, a.curve.point_at(exact[0]))
    return None


def _crossing_of_lines(a: Run, b: Run, first: Segment, second: Segment) -> tuple[float, float, Point] | None:
    p, q, offset = minus(first.b, first.a), minus(second.b, second.a), minus(second.a, first.a)
    area = cross(p, q)
    if abs(area) <= MIN_SINE * math.hypot(*p) * math.hypot(*q):
        return None
    u, v = cross(offset, q) / area, cross(offset, p) / area
    extension_mm = min(a.extension_mm, b.extension_mm)
    if not (0.0 <= u <= 1.0 + extension_mm / first.length_mm and -extension_mm / second.length_mm <= v <= 1.0):
        return None
    return u, v, _crossing_of_mirror_images(a, b, first, second) or first.point_at(u)


def _crossing_of_mirror_images(a: Run, b: Run, first: Segment, second: Segment) -> Point | None:
    """Return the intersection, exactly on their axis, of two lines that mirror each other in x; None for others."""
    if a.heading_deg is None or b.heading_deg is None or a.heading_deg != -b.heading_deg or first.a[1] != second.b[1]:
        return None
    middle = 0.5 * (first.a[0] + second.b[0])
    return (middle, first.a[1] + (first.a[0] - middle) / math.tan(math.radians(a.heading_deg)))


def _near_crossings(a: FloatArray, b: FloatArray) -> list[tuple[float, float]]:
    """Return approximate parameters of every intersection of two polylines (N, 2)."""
    p, q = np.diff(a, axis=0)[:, None], np.diff(b, axis=0)[None]
    offset = b[None, :-1] - a[:-1, None]
    area = p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (offset[..., 0] * q[..., 1] - offset[..., 1] * q[..., 0]) / area
        v = (offset[..., 0] * p[..., 1] - offset[..., 1] * p[..., 0]) / area
    slack = 0.05
    rows, columns = np.nonzero((u >= -slack) & (u <= 1.0 + slack) & (v >= -slack) & (v <= 1.0 + slack))
    parameters = np.column_stack([rows + u[rows, columns], columns + v[rows, columns]]) / SEGMENTS
    return [(float(u), float(v)) for u, v in parameters]


def _refined(a: Curve, b: Curve, u: float, v: float) -> tuple[float, float] | None:
    """Return the parameters of an intersection refined by Newton's method; None if it is outside a curve."""
    for _ in range(NEWTON_STEPS):
        u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
        offset = minus(b.point_at(v), a.point_at(u))
        p, q = a.velocity_at(u), b.velocity_at(v)
        area = cross(p, q)
        if area == 0.0:
            return None
        step_u, step_v = cross(offset, q) / area, cross(offset, p) / area
        u, v = u + step_u, v + step_v
        if abs(step_u) + abs(step_v) <= 1e-15:
            break
    inside = 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0
    return (u, v) if inside and math.dist(a.point_at(u), b.point_at(v)) <= 0.1 * GAP_MM else None


def _filleted(arriving: Run, departing: Run, radius_mm: float, node: str) -> tuple[Run, Run, Curve]:
    """Return two walls and their fillet: an arc tangent to both, centred in air on their right."""
    p, q = unit(arriving.curve.velocity_at(arriving.high)), unit(departing.curve.velocity_at(departing.low))
    turn = math.atan2(-cross(p, q), dot(p, q))
    if turn <= 0.0:
        limit = f"does not apply to the convex corner at {point_text(arriving.end)}: there is nothing to fill"
        raise DesignError(f"node {node}: fillet_mm", value=radius_mm, limit=limit, remedy="set fillet_mm = 0.0")
    reach_mm = radius_mm * math.tan(0.5 * turn)
    tangents = _tangents(arriving, departing, radius_mm, reach_mm)
    if tangents is None:
        max_radius_mm = min(_length_mm(arriving), _length_mm(departing)) / math.tan(0.5 * turn)
        raise DesignError(
            f"node {node}: fillet_mm",
            value=radius_mm,
            limit=f"must be at most {max_radius_mm:.3g} mm: the walls of {arriving.guide} and {departing.guide} leave "
            f"no more room at {point_text(arriving.end)}",
            remedy="reduce fillet_mm",
        )
    first_run, second_run, center = tangents
    first, last = first_run.end, second_run.start
    start_deg, end_deg = (math.degrees(math.atan2(z - center[1], x - center[0])) for x, z in (first, last))
    sweep_deg = (end_deg - start_deg) % 360.0 - 360.0
    return first_run, second_run, Arc(center, radius_mm, start_deg, sweep_deg)


def _length_mm(run: Run) -> float:
    points = run.curve.points(np.linspace(run.low, run.high, SEGMENTS + 1))
    return sum(math.dist(start, end) for start, end in pairwise(map(tuple, points.tolist())))


def _tangents(a: Run, b: Run, radius_mm: float, reach_mm: float) -> tuple[Run, Run, Point] | None:
    """Return the walls up to the fillet, and the centre of the fillet; None if they are too short for it."""
    if isinstance(a.curve, Segment) and isinstance(b.curve, Segment):
        return _tangents_of_lines(a, b, a.curve, b.curve, radius_mm, reach_mm)
    from scipy.optimize import root

    def center(curve: Curve, at: float) -> Point:
        at = min(max(at, 0.0), 1.0)
        return along(curve.point_at(at), right_of(unit(curve.velocity_at(at))), radius_mm)

    def difference(parameters: FloatArray) -> Point:
        return minus(center(a.curve, float(parameters[0])), center(b.curve, float(parameters[1])))

    guess = np.array(
        [
            max(a.high - reach_mm / math.hypot(*a.curve.velocity_at(a.high)), a.low),
            min(b.low + reach_mm / math.hypot(*b.curve.velocity_at(b.low)), b.high),
        ]
    )
    solution = root(difference, guess, tol=1e-15)
    u, v = (float(parameter) for parameter in solution.x)
    if not (a.low < u < a.high and b.low < v < b.high) or math.hypot(*difference(solution.x)) > 0.1 * GAP_MM:
        return None
    return replace(a, high=u, last=None), replace(b, low=v, first=None), center(a.curve, u)


def _tangents_of_lines(
    a: Run, b: Run, first_line: Segment, second_line: Segment, radius_mm: float, reach_mm: float
) -> tuple[Run, Run, Point] | None:
    p, q = unit(minus(first_line.b, first_line.a)), unit(minus(second_line.b, second_line.a))
    u, v = a.high - reach_mm / first_line.length_mm, b.low + reach_mm / second_line.length_mm
    if not (a.low < u and v < b.high):
        return None
    tangent_a, tangent_b = along(a.end, p, -reach_mm), along(b.start, q, reach_mm)
    return (
        replace(a, high=u, last=tangent_a),
        replace(b, low=v, first=tangent_b),
        along(tangent_a, left_of(p), -radius_mm),
    )

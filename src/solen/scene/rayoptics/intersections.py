"""Overlaps, crossings and parts of curves, used to arrange the plane into regions.

Positions on a curve are its parameters from 0 to 1, as in `Curve.points`. Crossings of a straight line with any curve
and of two circles are computed from their equations. Crossings of cubics with arcs or with one another start from
crossings of fine polylines and are refined by Newton's method. Two curves that overlap have no crossings;
`parameter_of` locates the ends of their overlap.
"""

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Arc, CubicChain, Curve, Segment
from solen.plane import Point, along, cross, dot, minus, unit
from solen.scene.overlaps import chords_meet
from solen.scene.rayoptics.facets import Facets

Parameters = tuple[float, float]
"""Parameters of a common point on the first and on the second curve."""

SAMPLES_PER_CUBIC = 48
SAMPLES_PER_ARC = 128
PARALLEL = 1e-7
"""Sine of the angle below which two chords are treated as parallel and do not cross."""
SLIVER = 1e-9
"""Smallest fraction of a cubic that is cut off."""
STEPS = 60
"""Number of steps of a ternary search, and maximum number of Newton steps."""


def part(curve: Curve, low: float, high: float) -> Curve:
    """Return the part of a curve between two parameters; a parameter very close to a joint of cubics is moved to it."""
    if isinstance(curve, CubicChain):
        low, high = (_at_joint(u, len(curve.controls)) for u in (low, high))
    return curve if (low, high) == (0.0, 1.0) else curve.part(low, high)


def _at_joint(u: float, cubics: int) -> float:
    joint = round(u * cubics)
    return joint / cubics if abs(u * cubics - joint) < SLIVER else u


def parameter_of(curve: Curve, point: Point, tolerance: float) -> float | None:
    """Return the parameter of a point on a curve, or None if the curve is further from the point than the tolerance."""
    if isinstance(curve, Segment):
        u = dot(minus(point, curve.a), unit(minus(curve.b, curve.a))) / curve.length_mm
    elif isinstance(curve, Arc):
        u = _parameter_on_arc(curve, point)
    elif isinstance(curve, Facets):
        u = curve.parameter_of(point)
    else:
        u = _nearest(curve, point, tolerance)
    u = min(max(u, 0.0), 1.0)
    return u if math.dist(curve.point_at(u), point) <= tolerance else None


def crossings(a: Curve, b: Curve, tolerance: float) -> list[Parameters]:
    """Return the parameter pairs at which two curves cross or touch, excluding overlaps."""
    if isinstance(a, Segment):
        return _on_line(a, b, tolerance)
    if isinstance(b, Segment):
        return [(v, u) for u, v in _on_line(b, a, tolerance)]
    if isinstance(a, Arc) and isinstance(b, Arc):
        return _parameters_on_both(a, b, _of_circles(a, b), tolerance)
    return _refined(a, b, tolerance)


def turning_deg(curve: Curve) -> float:
    """Return the approximate total turning angle of a curve; below 180 degrees, a curve cannot intersect itself."""
    steps = np.diff(curve.points(samples(curve)), axis=0)
    before, after = steps[:-1], steps[1:]
    turns = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    return float(np.degrees(np.abs(turns).sum()))


def samples(curve: Curve) -> FloatArray:
    """Return the parameters of a fine polyline along a curve."""
    if isinstance(curve, Segment):
        return np.array([0.0, 1.0])
    if isinstance(curve, Facets):
        inner = np.arange(math.ceil(curve.low), math.floor(curve.high) + 1.0)
        return np.unique(
            np.concatenate([[0.0], np.clip((inner - curve.low) / (curve.high - curve.low), 0.0, 1.0), [1.0]])
        )
    if isinstance(curve, CubicChain):
        n = len(curve.controls)
        return np.linspace(0.0, 1.0, n * max(4, SAMPLES_PER_CUBIC // n) + 1)
    return np.linspace(0.0, 1.0, SAMPLES_PER_ARC + 1)


def _parameter_on_arc(arc: Arc, point: Point) -> float:
    turn_deg = math.degrees(math.atan2(point[1] - arc.center[1], point[0] - arc.center[0])) - arc.start_deg
    turn_deg = turn_deg % 360.0 if arc.sweep_deg > 0 else -(-turn_deg % 360.0)
    u = turn_deg / arc.sweep_deg
    period = 360.0 / abs(arc.sweep_deg)
    return u if u <= 0.5 * (1.0 + period) else u - period  # slightly before the start, not far beyond the end


def _nearest(curve: Curve, point: Point, tolerance: float) -> float:
    """Return the parameter of the point on a curve nearest to another point, by ternary search around near samples."""
    u = samples(curve)
    points = curve.points(u)
    distance = np.hypot(*(points - np.array(point)).T)
    best = (math.inf, 0.0)
    longest = float(np.hypot(*np.diff(points, axis=0).T).max())
    around = np.concatenate([[math.inf], distance, [math.inf]])
    lowest = (distance <= around[:-2]) & (distance <= around[2:]) & (distance <= longest + tolerance)
    for i in np.flatnonzero(lowest).tolist():
        low, high = float(u[max(i - 1, 0)]), float(u[min(i + 1, len(u) - 1)])
        for _ in range(STEPS):
            third = (high - low) / 3.0
            left, right = (math.dist(curve.point_at(v), point) for v in (low + third, high - third))
            low, high = (low, high - third) if left <= right else (low + third, high)
        for v in (0.5 * (low + high), float(u[i])):
            best = min(best, (math.dist(curve.point_at(v), point), v))
    return best[1]


def _on_line(line: Segment, other: Curve, tolerance: float) -> list[Parameters]:
    """Return the parameter pairs at which a segment crosses a curve, from a ray that begins well before the segment."""
    direction = unit(minus(line.b, line.a))
    if isinstance(other, Segment) and abs(cross(direction, unit(minus(other.b, other.a)))) < 1e-12:
        return []
    back = 0.1 * line.length_mm + 1.0
    origin = along(line.a, direction, -back)
    points = [along(line.a, direction, t - back) for t in other.hits(origin, direction)]
    return _parameters_on_both(line, other, points, tolerance)


def _of_circles(a: Arc, b: Arc) -> list[Point]:
    distance = math.dist(a.center, b.center)
    if distance <= 1e-9 * (a.radius_mm + b.radius_mm):
        return []
    along_axis = 0.5 * (distance + (a.radius_mm - b.radius_mm) * (a.radius_mm + b.radius_mm) / distance)
    square = (a.radius_mm - along_axis) * (a.radius_mm + along_axis)
    if square < 0.0:
        return []
    direction = unit(minus(b.center, a.center))
    foot, height = along(a.center, direction, along_axis), math.sqrt(square)
    return [along(foot, (-direction[1], direction[0]), side * height) for side in (1.0, -1.0)]


def _parameters_on_both(a: Curve, b: Curve, points: Iterable[Point], tolerance: float) -> list[Parameters]:
    parameters = [(parameter_of(a, point, tolerance), parameter_of(b, point, tolerance)) for point in points]
    return [(u, v) for u, v in parameters if u is not None and v is not None]


def _refined(a: Curve, b: Curve, tolerance: float) -> list[Parameters]:
    distinct: list[Parameters] = []
    for start in _of_polylines(a, b):
        u, v = _newton(a, b, *start)
        point = a.point_at(u)
        if math.dist(point, b.point_at(v)) > tolerance:
            continue
        if all(math.dist(point, a.point_at(other)) > tolerance for other, _ in distinct):
            distinct.append((u, v))
    return distinct


def _of_polylines(a: Curve, b: Curve) -> list[Parameters]:
    """Return the parameter pairs at which fine polylines along two curves cross."""
    u, v = samples(a), samples(b)
    p, q = a.points(u), b.points(v)
    low, high = np.maximum(p.min(axis=0), q.min(axis=0)), np.minimum(p.max(axis=0), q.max(axis=0))
    if np.any(low > high):
        return []
    s, t, sine = chords_meet(p, q)
    i, j = np.nonzero((np.abs(sine) > PARALLEL) & (s >= -0.1) & (s <= 1.1) & (t >= -0.1) & (t <= 1.1))
    pairs = zip(u[i] + s[i, j] * np.diff(u)[i], v[j] + t[i, j] * np.diff(v)[j], strict=True)
    return [(float(x), float(y)) for x, y in pairs]


def _newton(a: Curve, b: Curve, u: float, v: float) -> Parameters:
    for _ in range(STEPS):
        u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
        gap = minus(b.point_at(v), a.point_at(u))
        along_a, along_b = (curve.velocity_at(w) for curve, w in ((a, u), (b, v)))
        slant = cross(along_a, along_b)
        if slant == 0.0:
            break
        du, dv = cross(gap, along_b) / slant, cross(gap, along_a) / slant
        u, v = u + du, v + dv
        if abs(du) + abs(dv) < 1e-15:
            break
    return (min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0))


def without_loops(curve: Curve) -> list[Curve]:
    """Divide a curve into parts that cannot intersect themselves."""
    turns = turning_deg(curve)
    if isinstance(curve, Segment | Arc) or turns < 175.0:
        return [curve]
    ends = np.linspace(0.0, 1.0, math.ceil(turns / 150.0) + 1).tolist()
    return [piece for low, high in pairwise(ends) for piece in without_loops(part(curve, low, high))]

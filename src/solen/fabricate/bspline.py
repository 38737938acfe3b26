"""Curves as represented in drawings and CAD programs: lines, arcs and B-splines.

Lines and arcs remain unchanged. A parabola becomes a B-spline of degree 2, and a chain of cubic segments becomes one of
degree 3; both conversions are exact. A smooth chain becomes a single B-spline, with knots spaced so that the derivative
is continuous; a chain with corners is divided at the corners.

Any other curve (the Cartesian oval, a conic) is interpolated to within `FIT_TOLERANCE_MM` by a cubic B-spline with
continuous curvature. The spline has the tangents of the curve at its ends, which keeps junctions smooth. Its parameter
is the mean of arc length, tangent angle and curve parameter, each relative to its total: CAD programs integrate over
the parameter with few nodes, which are then dense near the sharp vertex of a lens.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline

from solen.arrays import FloatArray
from solen.curve import Arc, CubicChain, Curve, Parabola, Segment
from solen.errors import DesignError
from solen.plane import Point, cross, dot, minus

FIT_TOLERANCE_MM = 1e-6
"""Maximum distance between a B-spline and the curve that it approximates: 1 nm."""
SMOOTH_RAD = 1e-9
"""Maximum angle between segments that are joined smoothly; the position error is below this angle times the length of a
Bézier handle.
"""
MIN_SPANS, MAX_SPANS = 8, 4096
CHECKS_PER_SPAN = 8
"""Number of points per span at which the distance from the curve is checked."""
PANELS = 4096
"""Number of equal steps of the curve parameter from which the spline parameter is computed."""

Control = tuple[Point, Point, Point, Point]


@dataclass(frozen=True)
class Bspline:
    """A non-rational B-spline, clamped at both ends.

    ``points`` are the control points in mm, ``knots`` are in ascending order from 0 to 1, and ``multiplicities`` are
    the numbers of their repetitions.
    """

    degree: int
    points: tuple[Point, ...]
    knots: tuple[float, ...]
    multiplicities: tuple[int, ...]

    @property
    def start(self) -> Point:
        """First point, mm."""
        return self.points[0]

    @property
    def end(self) -> Point:
        """Last point, mm."""
        return self.points[-1]

    @property
    def knot_vector(self) -> FloatArray:
        """Knot vector, (points + degree + 1,), with each knot repeated according to its multiplicity."""
        return np.repeat(self.knots, self.multiplicities)


Primitive = Segment | Arc | Bspline
"""A curve as represented in a drawing or a CAD program."""


def primitives(curve: Curve) -> tuple[Primitive, ...]:
    """Return the primitives of a curve in order; each starts at the end of the previous one.

    Raises
    ------
    DesignError
        If no B-spline of up to `MAX_SPANS` spans approximates the curve within the tolerance.
    """
    if isinstance(curve, Segment | Arc):
        return (curve,)
    if isinstance(curve, Parabola):
        return (Bspline(2, quadratic(curve), (0.0, 1.0), (3, 3)),)
    if isinstance(curve, CubicChain):
        return tuple(_smooth(run) for run in _runs(curve.controls))
    spline = _interpolated(curve)
    knots = np.unique(spline.t)
    counts = (4, *(1,) * (len(knots) - 2), 4)
    return (Bspline(3, _points(_with_ends(spline.c, curve)), tuple(knots.tolist()), counts),)


def cubics(curve: Curve) -> tuple[Control, ...]:
    """Return the curves that `primitives` returns, as cubic Bézier segments; raise the errors of `primitives`."""
    if isinstance(curve, CubicChain):
        return curve.controls
    spline = _interpolated(curve)
    knots = np.unique(spline.t)
    points = _with_ends(spline(knots), curve)
    thirds = np.diff(knots)[:, None] / 3.0
    tangents = spline.derivative()(knots)
    first, second = points[:-1] + thirds * tangents[:-1], points[1:] - thirds * tangents[1:]
    pieces = np.stack([points[:-1], first, second, points[1:]], axis=1)
    return tuple((a, b, c, d) for a, b, c, d in (_points(piece) for piece in pieces))


def quadratic(curve: Parabola) -> tuple[Point, Point, Point]:
    """Return the control points of a parabola, which is exactly one quadratic Bézier segment."""
    (x, z), (x_per_u, z_per_u) = curve.start, curve.velocities(np.zeros(1))[0].tolist()
    return curve.start, (x + 0.5 * x_per_u, z + 0.5 * z_per_u), curve.end


def _points(rows: FloatArray) -> tuple[Point, ...]:
    return tuple((x, z) for x, z in rows.tolist())


def _with_ends(rows: FloatArray, curve: Curve) -> FloatArray:
    """Return the rows with the first and the last replaced with the exact ends of the curve."""
    return np.vstack([[curve.start], rows[1:-1], [curve.end]])


def _interpolated(curve: Curve) -> BSpline:
    """Return a cubic spline through points of a curve, with as many spans as the tolerance requires."""
    parameter = _curve_parameter(curve)
    ends = np.array([0.0, 1.0])
    tangents = curve.velocities(parameter(ends)) * parameter(ends, 1)[:, None]
    spans = MIN_SPANS
    while spans <= MAX_SPANS:
        knots = np.linspace(0.0, 1.0, spans + 1)
        points: Any = curve.points(parameter(knots))
        end_tangents: Any = ([(1, tangents[0])], [(1, tangents[1])])
        spline = make_interp_spline(knots, points, k=3, bc_type=end_tangents)
        between = (np.arange(spans * CHECKS_PER_SPAN) + 0.5) / (spans * CHECKS_PER_SPAN)
        error = np.hypot(*(spline(between) - curve.points(parameter(between))).T)
        if error.max() <= 0.9 * FIT_TOLERANCE_MM:  # it is slightly larger between the checks
            return spline
        spans += spans // 2
    limit = f"cannot be approximated within {FIT_TOLERANCE_MM:g} mm by a B-spline of up to {MAX_SPANS} spans"
    raise DesignError(type(curve).__name__, limit=limit, remedy="divide the curve")


def _curve_parameter(curve: Curve) -> Callable[..., FloatArray]:
    """Return the curve parameter as a function of the spline parameter from 0 to 1; see the module docstring."""
    u = np.linspace(0.0, 1.0, 2 * PANELS + 1)
    velocities = curve.velocities(u)
    speed = np.hypot(*velocities.T)
    length = (speed[:-2:2] + 4.0 * speed[1::2] + speed[2::2]) / (6.0 * PANELS)  # Simpson's rule
    before, after = velocities[:-2:2], velocities[2::2]
    crosses = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turning = np.abs(np.arctan2(crosses, np.sum(before * after, axis=1)))
    uniform = np.full(PANELS, 1.0 / PANELS)
    steps = sum(part / part.sum() for part in (length, turning, uniform) if part.sum() > 0.0)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return CubicSpline(total / total[-1], u[::2])


def _runs(controls: tuple[Control, ...]) -> list[list[Control]]:
    """Group the segments into smooth runs; each corner begins a new run."""
    runs = [[controls[0]]]
    for control in controls[1:]:
        before, after = minus(runs[-1][-1][3], runs[-1][-1][2]), minus(control[1], control[0])
        if dot(before, after) > 0.0 and abs(math.atan2(cross(before, after), dot(before, after))) <= SMOOTH_RAD:
            runs[-1].append(control)
        else:
            runs.append([control])
    return runs


def _smooth(run: list[Control]) -> Bspline:
    """Join smooth segments into one B-spline whose spans make the derivative continuous, without points at the joints.

    On each side of a joint, the derivative with respect to the parameter is three times the Bézier handle divided by
    the span.
    """
    points, knots = list(run[0][:3]), [0.0, 1.0]
    for before, after in pairwise(run):
        ratio = math.dist(after[0], after[1]) / math.dist(before[2], before[3])
        knots.append(knots[-1] + ratio * (knots[-1] - knots[-2]))
        points += after[1:3]
    points.append(run[-1][3])
    inner = (2,) * (len(knots) - 2)
    return Bspline(3, tuple(points), tuple(knot / knots[-1] for knot in knots), (4, *inner, 4))

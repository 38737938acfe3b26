"""Curves in the form of drawings and CAD programs: lines, arcs and B-splines.

Lines and arcs are kept as they are. A parabola becomes a B-spline of degree 2 and a chain of cubics one of degree 3,
both exact. A smooth chain becomes one B-spline, with knots spaced so that the derivative is continuous; a chain with
corners is divided there.

Any other curve (the Cartesian oval, a conic) is interpolated to within `FIT_TOLERANCE_MM` by a cubic B-spline of
continuous curvature through points of the curve. It has the curve's tangents at the ends, which keeps junctions smooth.
Its parameter grows in equal parts with arc length, turning angle and the curve's own parameter, because CAD programs
integrate over it with few nodes, and these are needed at the sharp vertex of a lens.
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
"""Two pieces that meet at a smaller angle are treated as smooth: the error at the joint is below this times a
handle.
"""
FEWEST_SPANS, MOST_SPANS = 8, 4096
CHECKS_PER_SPAN = 8
"""Number of points per span at which its distance from the curve is measured."""
PANELS = 4096
"""Number of equal steps of a curve's own parameter from which the even parameter is computed."""

Control = tuple[Point, Point, Point, Point]


@dataclass(frozen=True)
class Bspline:
    """A B-spline without weights, clamped at both ends.

    ``points`` are its control points in mm; ``knots`` ascend from 0 to 1 and ``multiplicities`` states how often each
    is repeated.
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
        """Knot vector (points + degree + 1,), with each knot repeated by its multiplicity."""
        return np.repeat(self.knots, self.multiplicities)


Primitive = Segment | Arc | Bspline
"""A curve as stored in a drawing or a CAD program."""


def primitives(curve: Curve) -> tuple[Primitive, ...]:
    """Primitives of a curve in its direction, each starting where the one before ends.

    Raises
    ------
    DesignError
        If no B-spline of `MOST_SPANS` spans approximates the curve within the tolerance.
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
    """Cubic Bézier pieces of the same curve as its primitives; raises the same errors."""
    if isinstance(curve, CubicChain):
        return curve.controls
    spline = _interpolated(curve)
    knots = np.unique(spline.t)
    at = _with_ends(spline(knots), curve)
    handles = np.diff(knots)[:, None] / 3.0
    tangents = spline.derivative()(knots)
    pieces = np.stack([at[:-1], at[:-1] + handles * tangents[:-1], at[1:] - handles * tangents[1:], at[1:]], axis=1)
    return tuple((a, b, c, d) for a, b, c, d in (_points(piece) for piece in pieces))


def quadratic(curve: Parabola) -> tuple[Point, Point, Point]:
    """Control points of a parabola, which is exactly one quadratic Bézier piece."""
    (x, z), (per_u, rise) = curve.start, curve.velocities(np.zeros(1))[0].tolist()
    return curve.start, (x + 0.5 * per_u, z + 0.5 * rise), curve.end


def _points(rows: FloatArray) -> tuple[Point, ...]:
    return tuple((x, z) for x, z in rows.tolist())


def _with_ends(rows: FloatArray, curve: Curve) -> FloatArray:
    """Rows whose first and last are replaced by the exact ends of the curve."""
    return np.vstack([[curve.start], rows[1:-1], [curve.end]])


def _interpolated(curve: Curve) -> BSpline:
    """Cubic spline of a curve over a parameter from 0 to 1, with as many spans as the tolerance requires."""
    parameter = _even_parameter(curve)
    ends = np.array([0.0, 1.0])
    tangents = curve.velocities(parameter(ends)) * parameter(ends, 1)[:, None]
    spans = FEWEST_SPANS
    while spans <= MOST_SPANS:
        knots = np.linspace(0.0, 1.0, spans + 1)
        places: Any = curve.points(parameter(knots))
        at_ends: Any = ([(1, tangents[0])], [(1, tangents[1])])
        spline = make_interp_spline(knots, places, k=3, bc_type=at_ends)
        between = (np.arange(spans * CHECKS_PER_SPAN) + 0.5) / (spans * CHECKS_PER_SPAN)
        off = np.hypot(*(spline(between) - curve.points(parameter(between))).T)
        if off.max() <= FIT_TOLERANCE_MM:
            return spline
        spans += spans // 2
    limit = f"no B-spline of up to {MOST_SPANS} spans approximates it within {FIT_TOLERANCE_MM:g} mm"
    raise DesignError(type(curve).__name__, limit=limit, remedy="divide the curve")


def _even_parameter(curve: Curve) -> Callable[..., FloatArray]:
    """Map an even parameter (growing with length, turning and own parameter) to the own parameter of a curve."""
    u = np.linspace(0.0, 1.0, 2 * PANELS + 1)
    per_u = curve.velocities(u)
    speed = np.hypot(*per_u.T)
    length = (speed[:-2:2] + 4.0 * speed[1::2] + speed[2::2]) / (6.0 * PANELS)  # Simpson's rule
    before, after = per_u[:-2:2], per_u[2::2]
    crosses = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turning = np.abs(np.arctan2(crosses, np.sum(before * after, axis=1)))
    own = np.full(PANELS, 1.0 / PANELS)
    step = sum(part / part.sum() for part in (length, turning, own) if part.sum() > 0.0)
    grown = np.concatenate([[0.0], np.cumsum(step)])
    return CubicSpline(grown / grown[-1], u[::2])


def _runs(controls: tuple[Control, ...]) -> list[list[Control]]:
    """Group the pieces into smooth runs; each corner begins a new run."""
    runs = [[controls[0]]]
    for control in controls[1:]:
        before, after = minus(runs[-1][-1][3], runs[-1][-1][2]), minus(control[1], control[0])
        if dot(before, after) > 0.0 and abs(math.atan2(cross(before, after), dot(before, after))) <= SMOOTH_RAD:
            runs[-1].append(control)
        else:
            runs.append([control])
    return runs


def _smooth(run: list[Control]) -> Bspline:
    """Join smooth pieces into one B-spline; no control point is needed at joints with matched spans.

    At this joint, the derivative with respect to the parameter is three times a handle divided by its span, on both
    sides.
    """
    points, knots = list(run[0][:3]), [0.0, 1.0]
    for before, after in pairwise(run):
        ratio = math.dist(after[0], after[1]) / math.dist(before[2], before[3])
        knots.append(knots[-1] + ratio * (knots[-1] - knots[-2]))
        points += after[1:3]
    points.append(run[-1][3])
    whole = knots[-1]
    inner = (2,) * (len(knots) - 2)
    return Bspline(3, tuple(points), tuple(knot / whole for knot in knots), (4, *inner, 4))

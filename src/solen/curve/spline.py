"""Free-form curves: one cubic Bézier piece, and chains of them, such as the smooth curve through given points."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.curve.base import check_points
from solen.curve.chain import CubicChain
from solen.curve.cubic import Control
from solen.errors import DesignError
from solen.plane import Point, Rigid


@dataclass(frozen=True)
class Bezier(CubicChain):
    """One cubic Bézier piece from ``a`` to ``b``; it leaves ``a`` towards ``control_a`` and arrives from ``control_b``.

    Raise `DesignError` if it has no length, a cusp, or an end that coincides with its control point.
    """

    a: Point
    control_a: Point
    control_b: Point
    b: Point

    def __post_init__(self) -> None:
        check_points("bezier", *self.controls[0])
        _ = self.pieces  # raises DesignError if a cubic cannot be split

    @property
    def controls(self) -> tuple[Control, ...]:
        """Control points of every cubic, in order."""
        return ((self.a, self.control_a, self.control_b, self.b),)

    def name_of(self, index: int) -> str:  # noqa: ARG002  there is only one cubic
        """Return the name of a cubic in error messages."""
        return "bezier"

    def part(self, u_from: float, u_to: float) -> "Bezier":
        """Return the part of the curve from one parameter to a larger one."""
        return Bezier(*self.parts(u_from, u_to)[0])

    def moved(self, motion: Rigid) -> "Bezier":
        """Return the curve after a rigid motion."""
        return Bezier(*(motion.point(point) for point in self.controls[0]))

    def reversed(self) -> "Bezier":
        """Return the same curve traversed from end to start."""
        return Bezier(*reversed(self.controls[0]))


@dataclass(frozen=True)
class Spline(CubicChain):
    """Chain of N cubic Bézier pieces: 3 N + 1 ``control_points``, a start and for each piece two handles and an end.

    Joints need not be smooth. If the last point equals the first, the outline is closed and has no ends to extend.
    Raise `DesignError` if a piece has no length, a cusp, or a handle that coincides with its end.
    """

    control_points: tuple[Point, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.control_points, tuple):
            raise DesignError("spline control_points", value=self.control_points, limit="must be a tuple of points")
        check_points("spline control_points", *self.control_points)
        count = len(self.control_points)
        if count < 4 or count % 3 != 1:
            raise DesignError(
                "spline control_points",
                value=count,
                limit="must be 3 N + 1 points: a start, then two handles and an end for each of N segments",
                remedy="use Spline.through for a spline through given points",
            )
        _ = self.pieces  # raises DesignError if a cubic cannot be split

    @classmethod
    def through(cls, points: ArrayLike, *, closed: bool = False) -> "Spline":
        """Return the natural cubic spline through points (N, 2) in mm; its parameter is the chord length.

        The curvature is continuous, and 0 at both ends; with ``closed`` the outline continues from the last point to
        the first, as smooth there as elsewhere. Raise `DesignError` if two neighbouring points coincide, or if there
        are fewer than 2 points, or 3 for a closed outline.
        """
        knots = _point_array(points, closed)
        starts = knots if closed else knots[:-1]
        ends = np.roll(knots, -1, axis=0) if closed else knots[1:]
        chord = ends - starts
        length = np.hypot(*chord.T)
        if not np.all(length > 0.0):
            i = int(np.argmin(length))
            raise DesignError(
                "spline points",
                value=tuple(map(float, starts[i])),
                limit="must differ from its neighbour",
                remedy="omit one of them; a closed outline does not repeat its first point",
            )
        tangent = _tangents(chord, length, closed)
        start_tangent = tangent if closed else tangent[:-1]
        end_tangent = np.roll(tangent, -1, axis=0) if closed else tangent[1:]
        third = length[:, None] / 3.0
        pieces = np.stack([starts + third * start_tangent, ends - third * end_tangent, ends], axis=1).reshape(-1, 2)
        return cls(tuple((float(x), float(z)) for x, z in (knots[0], *pieces)))

    @classmethod
    def chained(cls, curves: Sequence[CubicChain]) -> "Spline":
        """Join several chains, each of which starts where the previous one ends, to one spline."""
        return cls.of([control for curve in curves for control in curve.controls])

    @classmethod
    def of(cls, controls: Sequence[Control]) -> "Spline":
        """Return the spline of cubic pieces, each of which starts where the previous one ends."""
        return cls((controls[0][0], *(point for control in controls for point in control[1:])))

    @property
    def controls(self) -> tuple[Control, ...]:
        """Control points of every cubic, in order."""
        p = self.control_points
        return tuple((p[i], p[i + 1], p[i + 2], p[i + 3]) for i in range(0, len(p) - 1, 3))

    def name_of(self, index: int) -> str:
        """Return the name of a cubic in error messages."""
        return f"spline control_points[{3 * index}:{3 * index + 4}]"

    def part(self, u_from: float, u_to: float) -> "Spline":
        """Return the part of the curve from one parameter to a larger one.

        Each of its cubics, cut or not, spans an equal part of its parameter range.
        """
        return Spline.of(self.parts(u_from, u_to))

    def moved(self, motion: Rigid) -> "Spline":
        """Return the curve after a rigid motion."""
        return Spline(tuple(motion.point(point) for point in self.control_points))

    def reversed(self) -> "Spline":
        """Return the same curve traversed from end to start."""
        return Spline(self.control_points[::-1])


def _point_array(points: ArrayLike, closed: bool) -> FloatArray:
    """Return the points as an array (N, 2); raise `DesignError` if they are too few or not finite numbers."""
    try:
        array = np.array(points, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.ndim != 2 or array.shape[1] != 2 or not np.all(np.isfinite(array)):
        raise DesignError("spline points", limit="must be a list of pairs (x, z) of finite numbers")
    min_count = 3 if closed else 2
    if len(array) < min_count:
        raise DesignError("spline points", value=len(array), limit=f"must be at least {min_count} points")
    return array


def _tangents(chord: FloatArray, length: FloatArray, closed: bool) -> FloatArray:
    """Return derivatives (N, 2) with respect to the chord length for which the spline's curvature is continuous.

    At a point between chords of lengths h₁ and h₂ and slopes s₁ and s₂, h₂ t₋ + 2 (h₁ + h₂) t + h₁ t₊ = 3 (h₂ s₁ +
    h₁ s₂), where t₋ and t₊ are the derivatives at its neighbours; here divided by h₁ + h₂. At a free end 2 t + t₊ =
    3 s.
    """
    slope = chord / length[:, None]
    h1, s1 = (np.roll(length, 1), np.roll(slope, 1, axis=0)) if closed else (length[:-1], slope[:-1])
    h2, s2 = (length, slope) if closed else (length[1:], slope[1:])
    below = h2 / (h1 + h2)
    above = 1.0 - below
    right = 3.0 * (below[:, None] * s1 + above[:, None] * s2)
    if closed:
        return _cyclic(below, above, right)
    right = np.vstack([3.0 * slope[:1], right, 3.0 * slope[-1:]])
    return _tridiagonal(np.append(below, 1.0), np.append(1.0, above), np.full(len(right), 2.0), right)


def _tridiagonal(below: FloatArray, above: FloatArray, diagonal: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a diagonally dominant tridiagonal system, off-diagonals (N − 1,) each, for right-hand sides (N, M)."""
    pivot, solution = diagonal.copy(), right.copy()
    for i in range(1, len(pivot)):
        factor = below[i - 1] / pivot[i - 1]
        pivot[i] -= factor * above[i - 1]
        solution[i] -= factor * solution[i - 1]
    solution[-1] /= pivot[-1]
    for i in range(len(pivot) - 2, -1, -1):
        solution[i] = (solution[i] - above[i] * solution[i + 1]) / pivot[i]
    return solution


def _cyclic(below: FloatArray, above: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a cyclic tridiagonal system with 2 on the diagonal, by the Sherman-Morrison formula.

    The matrix is a tridiagonal one plus u vᵀ, a matrix of rank one that supplies the two corner elements.
    """
    corner_up, corner_down = below[0], above[-1]
    diagonal = np.full(len(right), 2.0)
    u = np.zeros((len(right), 1))
    u[0], u[-1] = -diagonal[0], corner_down
    v_last = -corner_up / diagonal[0]
    diagonal[0] += 2.0
    diagonal[-1] -= corner_down * v_last
    solution = _tridiagonal(below[1:], above[:-1], diagonal, np.hstack([right, u]))
    y, z = solution[:, :-1], solution[:, -1:]
    return np.asarray(y - z * (y[0] + v_last * y[-1]) / (1.0 + z[0] + v_last * z[-1]))

"""Free forms: one cubic Bézier piece, and the smooth curve through given points."""

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
    """One cubic Bézier piece from ``a`` to ``b``; it leaves ``a`` towards ``control_a`` and comes from ``control_b``.

    `DesignError` where it has no length, a cusp, or an end that is its own control point.
    """

    a: Point
    control_a: Point
    control_b: Point
    b: Point

    def __post_init__(self) -> None:
        check_points("bezier", *self.controls[0])
        _ = self.pieces  # refuses what cannot be split

    @property
    def controls(self) -> tuple[Control, ...]:
        """See :attr:`CubicChain.controls`."""
        return ((self.a, self.control_a, self.control_b, self.b),)

    def name_of(self, number: int) -> str:  # noqa: ARG002  there is only one
        """See :meth:`CubicChain.name_of`."""
        return "bezier"

    def part(self, u_from: float, u_to: float) -> "Bezier":
        """See :meth:`Curve.part`."""
        return Bezier(*self.parts(u_from, u_to)[0])

    def moved(self, motion: Rigid) -> "Bezier":
        """See :meth:`Curve.moved`."""
        return Bezier(*(motion.point(point) for point in self.controls[0]))

    def reversed(self) -> "Bezier":
        """See :meth:`Curve.reversed`."""
        return Bezier(*reversed(self.controls[0]))


@dataclass(frozen=True)
class Spline(CubicChain):
    """Chain of N cubic Bézier pieces: 3 N + 1 ``control_points``, a start and for each piece two handles and an end.

    Joints need not be smooth. Where the last point is the first the outline is closed, and has no ends to reach beyond.
    `DesignError` where a piece has no length, a cusp, or a handle that lies on its end.
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
                limit="must be 3 N + 1 points: a start, then two handles and an end for each of N pieces",
                remedy="Spline.through makes one from points that it shall pass",
            )
        _ = self.pieces  # refuses what cannot be split

    @classmethod
    def through(cls, points: ArrayLike, *, closed: bool = False) -> "Spline":
        """Natural cubic spline through points (N, 2) in mm, its parameter the length of the chords between them.

        Curvature is continuous, and 0 at both ends; with ``closed`` the outline runs on from the last point to the
        first, as smooth there as elsewhere. `DesignError` where two neighbours are one point, or for too few points:
        2, for an outline 3.
        """
        from scipy.interpolate import CubicSpline  # it takes long to import, and few curves need it

        given = _checked(points, closed)
        through = np.vstack([given, given[:1]]) if closed else given
        length = np.hypot(*np.diff(through, axis=0).T)
        if not np.all(length > 0.0):
            raise DesignError(
                "spline points",
                value=f"{tuple(map(float, through[int(np.argmin(length))]))} twice in a row",
                limit="neighbours must differ",
                remedy="leave one of them out; a closed outline does not repeat its first point",
            )
        at = np.concatenate([[0.0], np.cumsum(length)])
        tangent = CubicSpline(at, through, bc_type="periodic" if closed else "natural")(at, 1)
        third = length[:, None] / 3.0
        handles = (through[:-1] + third * tangent[:-1], through[1:] - third * tangent[1:])
        pieces = np.stack([*handles, through[1:]], axis=1).reshape(-1, 2)
        return cls(tuple((float(x), float(z)) for x, z in (given[0], *pieces)))

    @classmethod
    def chained(cls, curves: Sequence[CubicChain]) -> "Spline":
        """One spline of several chains, each of which starts where the one before ends."""
        return cls.of([control for curve in curves for control in curve.controls])

    @classmethod
    def of(cls, controls: Sequence[Control]) -> "Spline":
        """Spline of cubic pieces, each of which starts where the one before ends."""
        return cls((controls[0][0], *(point for control in controls for point in control[1:])))

    @property
    def controls(self) -> tuple[Control, ...]:
        """See :attr:`CubicChain.controls`."""
        p = self.control_points
        return tuple((p[i], p[i + 1], p[i + 2], p[i + 3]) for i in range(0, len(p) - 1, 3))

    def name_of(self, number: int) -> str:
        """See :meth:`CubicChain.name_of`."""
        return f"spline control_points[{3 * number}:{3 * number + 4}]"

    def part(self, u_from: float, u_to: float) -> "Spline":
        """See :meth:`Curve.part`; its pieces have equal shares of its own parameter, the cut ones too."""
        return Spline.of(self.parts(u_from, u_to))

    def moved(self, motion: Rigid) -> "Spline":
        """See :meth:`Curve.moved`."""
        return Spline(tuple(motion.point(point) for point in self.control_points))

    def reversed(self) -> "Spline":
        """See :meth:`Curve.reversed`."""
        return Spline(self.control_points[::-1])


def _checked(points: ArrayLike, closed: bool) -> FloatArray:
    """Points as an array (N, 2) of finite numbers, enough of them."""
    try:
        given = np.array(points, dtype=float)
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.ndim != 2 or given.shape[1] != 2 or not np.all(np.isfinite(given)):
        raise DesignError("spline points", limit="must be a list of pairs (x, z) of finite numbers")
    least = 3 if closed else 2
    if len(given) < least:
        raise DesignError("spline points", value=len(given), limit=f"must be at least {least} points")
    return given

"""Interfaces must be apart: no two may share a stretch, and none may cross another with a wrong medium behind it.

Where two coincide a ray meets first what rounding says. Where two cross, at least one of them has, on one side of the
crossing, a region beside it that is not there; only walls and mirrors within one medium may cross.
"""

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from solen.arrays import FloatArray
from solen.curve import CubicChain, Curve, Segment
from solen.errors import DesignError
from solen.plane import Point, cross, dot, minus, unit
from solen.scene.closed_media import ENDS, SAMPLES, holds, place_text, tolerance_of

if TYPE_CHECKING:  # the model calls this module
    from solen.scene.model import Interface

REMEMBERED = 4096
"""Curves and pairs of them that are remembered: from one scene of a sweep to the next most stay as they are."""
INSIDE = 1.0 / 64.0
"""How far from its end a curve is looked at for whether it runs along another, as a share of its parameter."""
ON_IT_MM = 1e-9
"""How near to another a straight line lies on it."""


def check_apart(interfaces: Sequence["Interface"]) -> None:
    """`DesignError` with the place where two interfaces coincide along a stretch, or cross."""
    if len(interfaces) < 2:
        return
    lines = [_polyline(interface.curve) for interface in interfaces]
    tolerance_mm = tolerance_of(interfaces, np.vstack([line[[0, -1]] for line in lines]))
    for i, j in _neighbours(lines, tolerance_mm):
        first, second = interfaces[i], interfaces[j]
        at = _common(first.curve, second.curve, tolerance_mm)
        if at is not None:
            raise _error(
                first, second, f"lie on one another at {place_text(at)}", "a ray would meet either by rounding"
            )
        at = None if _may_cross(first, second) else _crossing(first.curve, second.curve, tolerance_mm)
        if at is not None:
            limit = "beyond the crossing one of them borders the wrong medium"
            raise _error(first, second, f"cross at {place_text(at)}", limit)


@lru_cache(maxsize=REMEMBERED)
def _polyline(curve: Curve) -> FloatArray:
    return curve.points(ENDS if isinstance(curve, Segment) else SAMPLES)


def overlap_mm(a: Segment, b: Segment) -> float:
    """Length that two segments share on one line; 0 where they are not on one line."""
    low, high = _shared(a, b)
    return high - low


def _shared(a: Segment, b: Segment) -> tuple[float, float]:
    """Interval along the first segment, in mm, that the second covers; its end is before its start if there is none."""
    direction = unit(minus(a.b, a.a))
    starts = (minus(b.a, a.a), minus(b.b, a.a))
    if any(abs(cross(direction, start)) > ON_IT_MM for start in starts):
        return 0.0, 0.0
    low, high = sorted(dot(direction, start) for start in starts)
    return max(low, 0.0), min(high, a.length_mm)


def _may_cross(first: "Interface", second: "Interface") -> bool:
    return first.left == first.right == second.left == second.right


def _neighbours(lines: Sequence[FloatArray], tolerance_mm: float) -> Iterator[tuple[int, int]]:
    """Pairs of polylines whose boxes meet; no curve leaves its polyline by as much as the boxes are enlarged."""
    margin = np.array([tolerance_mm + (len(line) > 2) * np.hypot(*np.diff(line, axis=0).T).max() for line in lines])
    low = np.array([line.min(axis=0) for line in lines]) - margin[:, None]
    high = np.array([line.max(axis=0) for line in lines]) + margin[:, None]
    order = np.argsort(low[:, 0])
    begins = low[order, 0]
    for k, i in enumerate(order.tolist()):
        others = order[k + 1 : np.searchsorted(begins, high[i, 0], side="right")]
        meet = (low[others, 1] <= high[i, 1]) & (high[others, 1] >= low[i, 1])
        yield from ((min(i, j), max(i, j)) for j in others[meet].tolist())


@lru_cache(maxsize=REMEMBERED)
def _common(a: Curve, b: Curve, tolerance_mm: float) -> Point | None:
    """A point inside a stretch common to two curves; such a stretch begins at an end of either curve.

    Curves of different equations have none; cubics may be any other curve.
    """
    if isinstance(a, Segment) and isinstance(b, Segment):
        low, high = _shared(a, b)
        return a.point_at(0.5 * (low + high) / a.length_mm) if high - low > tolerance_mm else None
    if type(a) is not type(b) and not (isinstance(a, CubicChain) or isinstance(b, CubicChain)):
        return None
    for one, other in ((a, b), (b, a)):
        for end, inside in ((0.0, INSIDE), (1.0, 1.0 - INSIDE)):
            at = one.point_at(inside)
            if holds(other, at, tolerance_mm) and holds(other, one.point_at(end), tolerance_mm):
                return at
    return None


@lru_cache(maxsize=REMEMBERED)
def _crossing(a: Curve, b: Curve, tolerance_mm: float) -> Point | None:
    """A point where two curves cross, other than at their ends."""
    if isinstance(a, Segment) and isinstance(b, Segment):
        sides = [cross(minus(c.b, c.a), minus(end, c.a)) for c, d in ((a, b), (b, a)) for end in (d.a, d.b)]
        if not (sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0):
            return None
    elif not _lines_cross(_polyline(a), _polyline(b)):
        return None
    from solen.scene.rayoptics.intersections import crossings  # that package is made of scenes

    places = [a.point_at(u) for u, _ in crossings(a, b, tolerance_mm)]
    ends = (a.start, a.end, b.start, b.end)
    return next((at for at in places if min(math.dist(at, end) for end in ends) > tolerance_mm), None)


def _lines_cross(p: FloatArray, q: FloatArray) -> bool:
    """Whether two polylines cross."""
    s, t, _ = chords_meet(p, q)
    return bool(np.any((s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)))


def chords_meet(p: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the lines of the chords of two polylines (N + 1, 2), (M + 1, 2) meet, each (N, M).

    Share of the first polyline's chord, share of the second's, and the sine of the angle between them; parallel chords
    meet at infinity or nowhere (NaN).
    """
    dp, dq = np.diff(p, axis=0)[:, None, :], np.diff(q, axis=0)[None, :, :]
    between = q[None, :-1, :] - p[:-1, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        slant = dp[..., 0] * dq[..., 1] - dp[..., 1] * dq[..., 0]
        s = (between[..., 0] * dq[..., 1] - between[..., 1] * dq[..., 0]) / slant
        t = (between[..., 0] * dp[..., 1] - between[..., 1] * dp[..., 0]) / slant
        return s, t, slant / (np.hypot(*np.moveaxis(dp, 2, 0)) * np.hypot(*np.moveaxis(dq, 2, 0)))


def _error(first: "Interface", second: "Interface", value: str, limit: str) -> DesignError:
    remedy = "let bodies share a single interface between both media, or leave a gap"
    return DesignError(f"interfaces {first.name} and {second.name}", value=value, limit=limit, remedy=remedy)

"""The rule that interfaces are separate: no two may overlap, and they may cross only within one medium.

Where two interfaces coincide, rounding would determine which of them a ray meets first. Where two interfaces cross, at
least one of them borders the wrong region on one side of the crossing. Only walls and mirrors within one medium may
therefore cross.
"""

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from solen.arrays import FloatArray
from solen.curve import CubicChain, Curve, Segment
from solen.errors import DesignError
from solen.geometry.body import point_text
from solen.plane import Point, cross, dot, minus, unit
from solen.scene.closed_media import ENDS, SAMPLES, passes_through, tolerance_of

if TYPE_CHECKING:  # the model calls this module
    from solen.scene.model import Interface

CACHE_SIZE = 4096
"""Number of cached curves, and of cached pairs of curves; most of them do not change from one scene of a sweep to the
next.
"""
TEST_OFFSET = 1.0 / 64.0
"""Distance from the end of a curve, as a fraction of its parameter range, at which a point is tested for lying on
another curve.
"""
LINE_TOLERANCE_MM = 1e-9
"""A point within this distance of a straight line is taken to lie on the line."""


def check_overlaps(interfaces: Sequence["Interface"]) -> None:
    """Check that no two interfaces overlap or cross.

    Raises
    ------
    DesignError
        If two interfaces coincide along part of their length, or cross; the message gives the location.
    """
    if len(interfaces) < 2:
        return
    lines = [_polyline(interface.curve) for interface in interfaces]
    tolerance_mm = tolerance_of(interfaces, np.vstack([line[[0, -1]] for line in lines]))
    for i, j in _neighbours(lines, tolerance_mm):
        first, second = interfaces[i], interfaces[j]
        at = _common(first.curve, second.curve, tolerance_mm)
        if at is not None:
            limit = f"overlap at {point_text(at)}, so rounding would determine which of them a ray meets"
            raise _error(first, second, limit)
        at = None if _may_cross(first, second) else _crossing(first.curve, second.curve, tolerance_mm)
        if at is not None:
            limit = f"cross at {point_text(at)}, so one of them borders the wrong medium on one side of the crossing"
            raise _error(first, second, limit)


@lru_cache(maxsize=CACHE_SIZE)
def _polyline(curve: Curve) -> FloatArray:
    return curve.points(ENDS if isinstance(curve, Segment) else SAMPLES)


def overlap_mm(a: Segment, b: Segment) -> float:
    """Return the length over which two collinear segments overlap; 0 if they are not collinear."""
    low, high = _shared(a, b)
    return high - low


def _shared(a: Segment, b: Segment) -> tuple[float, float]:
    """Return the interval in mm along ``a`` that ``b`` covers; if it is empty, its end is not above its start."""
    direction = unit(minus(a.b, a.a))
    starts = (minus(b.a, a.a), minus(b.b, a.a))
    if any(abs(cross(direction, start)) > LINE_TOLERANCE_MM for start in starts):
        return 0.0, 0.0
    low, high = sorted(dot(direction, start) for start in starts)
    return max(low, 0.0), min(high, a.length_mm)


def _may_cross(first: "Interface", second: "Interface") -> bool:
    return first.left == first.right == second.left == second.right


def _neighbours(lines: Sequence[FloatArray], tolerance_mm: float) -> Iterator[tuple[int, int]]:
    """Yield index pairs of polylines whose bounding boxes overlap.

    The boxes are enlarged by more than any curve deviates from its polyline.
    """
    margin = np.array([tolerance_mm + (len(line) > 2) * np.hypot(*np.diff(line, axis=0).T).max() for line in lines])
    low = np.array([line.min(axis=0) for line in lines]) - margin[:, None]
    high = np.array([line.max(axis=0) for line in lines]) + margin[:, None]
    order = np.argsort(low[:, 0])
    begins = low[order, 0]
    for k, i in enumerate(order.tolist()):
        others = order[k + 1 : np.searchsorted(begins, high[i, 0], side="right")]
        meet = (low[others, 1] <= high[i, 1]) & (high[others, 1] >= low[i, 1])
        yield from ((min(i, j), max(i, j)) for j in others[meet].tolist())


@lru_cache(maxsize=CACHE_SIZE)
def _common(a: Curve, b: Curve, tolerance_mm: float) -> Point | None:
    """Return a point in the overlap of two curves, or None if they do not overlap.

    An overlap begins at an end of one of the curves. Curves of different kinds cannot overlap, except that a cubic can
    have the shape of any other curve.
    """
    if isinstance(a, Segment) and isinstance(b, Segment):
        low, high = _shared(a, b)
        return a.point_at(0.5 * (low + high) / a.length_mm) if high - low > tolerance_mm else None
    if type(a) is not type(b) and not (isinstance(a, CubicChain) or isinstance(b, CubicChain)):
        return None
    for curve, other in ((a, b), (b, a)):
        for end, inside in ((0.0, TEST_OFFSET), (1.0, 1.0 - TEST_OFFSET)):
            at = curve.point_at(inside)
            if passes_through(other, at, tolerance_mm) and passes_through(other, curve.point_at(end), tolerance_mm):
                return at
    return None


@lru_cache(maxsize=CACHE_SIZE)
def _crossing(a: Curve, b: Curve, tolerance_mm: float) -> Point | None:
    """Return a point away from their ends where two curves cross, or None."""
    if isinstance(a, Segment) and isinstance(b, Segment):
        sides = [cross(minus(c.b, c.a), minus(end, c.a)) for c, d in ((a, b), (b, a)) for end in (d.a, d.b)]
        if not (sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0):
            return None
    elif not _lines_cross(_polyline(a), _polyline(b)):
        return None
    from solen.scene.rayoptics.intersections import crossings  # that package imports scenes

    points = [a.point_at(u) for u, _ in crossings(a, b, tolerance_mm)]
    ends = (a.start, a.end, b.start, b.end)
    return next((at for at in points if min(math.dist(at, end) for end in ends) > tolerance_mm), None)


def _lines_cross(p: FloatArray, q: FloatArray) -> bool:
    """Whether two polylines cross."""
    s, t, _ = chords_meet(p, q)
    return bool(np.any((s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)))


def chords_meet(p: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Intersect the lines through the chords of two polylines (N + 1, 2) and (M + 1, 2).

    Return three arrays (N, M): the position along the chord of the first polyline (0 to 1 within the chord), the
    position along the chord of the second, and the sine of the angle between the chords. For parallel chords the
    positions are infinite or NaN.
    """
    dp, dq = np.diff(p, axis=0)[:, None, :], np.diff(q, axis=0)[None, :, :]
    between = q[None, :-1, :] - p[:-1, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        slant = dp[..., 0] * dq[..., 1] - dp[..., 1] * dq[..., 0]
        s = (between[..., 0] * dq[..., 1] - between[..., 1] * dq[..., 0]) / slant
        t = (between[..., 0] * dp[..., 1] - between[..., 1] * dp[..., 0]) / slant
        return s, t, slant / (np.hypot(*np.moveaxis(dp, 2, 0)) * np.hypot(*np.moveaxis(dq, 2, 0)))


def _error(first: "Interface", second: "Interface", limit: str) -> DesignError:
    remedy = "let both media share a single interface, or leave a gap between the bodies"
    return DesignError(f"interfaces {first.name} and {second.name}", limit=limit, remedy=remedy)

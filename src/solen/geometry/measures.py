"""Areas within exact curves, by Green's theorem: half the integral of x dz − z dx along the outline."""

from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.curve import ArcLength, CubicChain, Curve, Segment
from solen.geometry.body import Face

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
ACCURACY = 1e-13
"""Tolerated change of an area when a panel is halved, relative to the square of the size of the curve."""
MAX_ROUNDS = 30


def area_mm2(outlines: Sequence[Sequence[Face]]) -> float:
    """Return the area in mm² enclosed by outlines, accurate to about 1e-12; clockwise outlines (holes) are negative."""
    return sum(_enclosed_mm2(outline) for outline in outlines)


def perimeter_mm(outlines: Sequence[Sequence[Face]]) -> float:
    """Return the length of outlines in mm."""
    return sum(ArcLength(face.curve).length_mm for outline in outlines for face in outline)


def _enclosed_mm2(outline: Sequence[Face]) -> float:
    """Return the area of one outline, integrated about its first point to avoid cancellation far from the origin."""
    origin = np.asarray(outline[0].curve.start)
    return sum(_swept_mm2(face.curve, origin) for face in outline)


def _swept_mm2(curve: Curve, origin: FloatArray) -> float:
    """Return the area swept by the line from the origin to a point that moves along the curve."""
    if isinstance(curve, Segment):
        return _cross(np.array([curve.a]) - origin, np.array([curve.b]) - origin).item() / 2
    ends = np.linspace(0.0, 1.0, (len(curve.controls) if isinstance(curve, CubicChain) else 1) + 1)
    size = np.abs(curve.points(np.linspace(0.0, 1.0, 9)) - origin).max()
    for _ in range(MAX_ROUNDS):
        middles = 0.5 * (ends[:-1] + ends[1:])
        coarse = _panels(curve, origin, ends[:-1], ends[1:])
        fine = _panels(curve, origin, ends[:-1], middles) + _panels(curve, origin, middles, ends[1:])
        inaccurate = np.abs(fine - coarse) > ACCURACY * size * size
        if not inaccurate.any():
            break
        ends = np.sort(np.concatenate([ends, middles[inaccurate]]))
    return float(fine.sum())


def _panels(curve: Curve, origin: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return swept areas (N,) between parameters (N,)."""
    half = 0.5 * (high - low)
    u = ((0.5 * (low + high))[:, None] + half[:, None] * NODES).ravel()
    rate = _cross(curve.points(u) - origin, curve.velocities(u)).reshape(len(low), -1)
    return np.asarray(0.5 * half * (rate @ WEIGHTS))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])

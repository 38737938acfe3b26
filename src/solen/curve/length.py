"""Lengths along a curve, by Gauss-Legendre quadrature of its speed over panels that are halved until they agree."""

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import Curve
from solen.curve.chain import CubicChain

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
ACCURACY = 1e-13
"""Maximum change caused by halving a panel, relative to the total length."""
MAX_ROUNDS = 30
NEWTON_STEPS = 50


class Measure:
    """Arc length of a curve, and the parameter at a specified length; both to about 1e-12 of the total length."""

    def __init__(self, curve: Curve) -> None:
        self._curve = curve
        joints = len(curve.controls) if isinstance(curve, CubicChain) else 1
        ends = np.linspace(0.0, 1.0, joints + 1)
        for _ in range(MAX_ROUNDS):
            middles = 0.5 * (ends[:-1] + ends[1:])
            whole = self._lengths(ends[:-1], ends[1:])
            halves = self._lengths(ends[:-1], middles) + self._lengths(middles, ends[1:])
            rough = np.abs(halves - whole) > ACCURACY * halves.sum()
            if not rough.any():
                break
            ends = np.sort(np.concatenate([ends, middles[rough]]))
        self._ends = ends
        self._reached = np.concatenate([[0.0], np.cumsum(self._lengths(ends[:-1], ends[1:]))])

    @property
    def length_mm(self) -> float:
        """Total length of the curve."""
        return float(self._reached[-1])

    def u_at(self, length_mm: float) -> float:
        """Return the parameter at a length from the start; 0 and 1 for lengths outside the curve."""
        if length_mm <= 0.0:
            return 0.0
        if length_mm >= self.length_mm:
            return 1.0
        panel = int(np.searchsorted(self._reached, length_mm, side="right")) - 1
        start, low, high = self._ends[panel], self._ends[panel], self._ends[panel + 1]
        wanted = length_mm - self._reached[panel]
        u = low + (high - low) * wanted / (self._reached[panel + 1] - self._reached[panel])
        for _ in range(NEWTON_STEPS):
            error = float(self._lengths(np.array([start]), np.array([u]))[0]) - wanted
            low, high = (low, u) if error > 0.0 else (u, high)
            step = error / float(np.hypot(*self._curve.velocities(np.array([u]))[0]))
            following = u - step if low <= u - step <= high else 0.5 * (low + high)
            if abs(following - u) <= 1e-15:
                break
            u = following
        return float(u)

    def lengths_at(self, u: FloatArray) -> FloatArray:
        """Return lengths (N,) from the start to parameters (N,)."""
        panel = np.clip(np.searchsorted(self._ends, u, side="right") - 1, 0, len(self._ends) - 2)
        return np.asarray(self._reached[panel] + self._lengths(self._ends[panel], u))

    def _lengths(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return lengths (N,) between parameters (N,)."""
        half = 0.5 * (high - low)
        u = (0.5 * (low + high))[:, None] + half[:, None] * NODES
        speed = np.hypot(*self._curve.velocities(u.ravel()).T).reshape(u.shape)
        return np.asarray(half * (speed @ WEIGHTS))

"""Arc length, by Gauss-Legendre quadrature of the curve's speed over panels that are halved until it converges."""

import numpy as np

from solen.arrays import FloatArray
from solen.curve.base import Curve
from solen.curve.chain import CubicChain

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
ACCURACY = 1e-13
"""Maximum change caused by halving a panel, relative to the total length."""
MAX_ROUNDS = 30
NEWTON_STEPS = 50


class ArcLength:
    """Arc length of a curve, and the parameter at a given arc length; both to about 1e-12 of the total length."""

    def __init__(self, curve: Curve) -> None:
        self._curve = curve
        joints = len(curve.controls) if isinstance(curve, CubicChain) else 1
        ends = np.linspace(0.0, 1.0, joints + 1)
        for _ in range(MAX_ROUNDS):
            middles = 0.5 * (ends[:-1] + ends[1:])
            coarse = self._lengths(ends[:-1], ends[1:])
            fine = self._lengths(ends[:-1], middles) + self._lengths(middles, ends[1:])
            rough = np.abs(fine - coarse) > ACCURACY * fine.sum()
            if not rough.any():
                break
            ends = np.sort(np.concatenate([ends, middles[rough]]))
        self._panel_ends = ends
        self._lengths_to = np.concatenate([[0.0], np.cumsum(self._lengths(ends[:-1], ends[1:]))])

    @property
    def length_mm(self) -> float:
        """Total length of the curve."""
        return float(self._lengths_to[-1])

    def u_at(self, length_mm: float) -> float:
        """Return the parameter at an arc length from the start; 0 for a negative length, 1 above the total."""
        if length_mm <= 0.0:
            return 0.0
        if length_mm >= self.length_mm:
            return 1.0
        panel = int(np.searchsorted(self._lengths_to, length_mm, side="right")) - 1
        start, low, high = self._panel_ends[panel], self._panel_ends[panel], self._panel_ends[panel + 1]
        remaining = length_mm - self._lengths_to[panel]
        u = low + (high - low) * remaining / (self._lengths_to[panel + 1] - self._lengths_to[panel])
        for _ in range(NEWTON_STEPS):
            error = float(self._lengths(np.array([start]), np.array([u]))[0]) - remaining
            low, high = (low, u) if error > 0.0 else (u, high)
            step = error / float(np.hypot(*self._curve.velocities(np.array([u]))[0]))
            next_u = u - step if low <= u - step <= high else 0.5 * (low + high)
            if abs(next_u - u) <= 1e-15:
                break
            u = next_u
        return float(u)

    def lengths_at(self, u: FloatArray) -> FloatArray:
        """Return arc lengths (N,) from the start to parameters (N,)."""
        panel = np.clip(np.searchsorted(self._panel_ends, u, side="right") - 1, 0, len(self._panel_ends) - 2)
        return np.asarray(self._lengths_to[panel] + self._lengths(self._panel_ends[panel], u))

    def _lengths(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return arc lengths (N,) from parameters ``low`` (N,) to ``high`` (N,)."""
        half = 0.5 * (high - low)
        u = (0.5 * (low + high))[:, None] + half[:, None] * NODES
        speed = np.hypot(*self._curve.velocities(u.ravel()).T).reshape(u.shape)
        return np.asarray(half * (speed @ WEIGHTS))

"""Interpolation of values on a grid of several motions by tensor-product cubic splines.

Public name: `Surface`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solen.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Surface:
    """K values as functions of M motions.

    Attributes
    ----------
    low, high
        Limits of each motion's range, (M,); positions outside the range are clamped to the nearest limit.
    """

    low: FloatArray
    high: FloatArray
    _varied: tuple[int, ...]
    _spline: Any
    _constant: FloatArray

    @classmethod
    def through(cls, nodes: Sequence[FloatArray], values: FloatArray) -> "Surface":
        """Interpolate values on a grid.

        Parameters
        ----------
        nodes
            Positions of each motion, ascending; the values do not depend on a motion with a single position.
        values
            Values at the grid points, (n_1, ..., n_M, K).
        """
        from scipy.interpolate import NdBSpline, make_interp_spline

        limits = np.array([[node[0], node[-1]] for node in nodes]).reshape(-1, 2)
        varied = tuple(motion for motion, node in enumerate(nodes) if len(node) > 1)
        coefficients = values.reshape([len(nodes[motion]) for motion in varied] + [values.shape[-1]])
        knots, degrees = [], []
        for axis, motion in enumerate(varied):
            degree = min(3, len(nodes[motion]) - 1)
            spline = make_interp_spline(nodes[motion], coefficients, k=degree, axis=axis)
            knots.append(spline.t)
            degrees.append(degree)
            coefficients = np.moveaxis(spline.c, 0, axis)
        surface = NdBSpline(tuple(knots), np.ascontiguousarray(coefficients), tuple(degrees)) if varied else None
        return cls(limits[:, 0], limits[:, 1], varied, surface, coefficients)

    def at(self, positions: FloatArray) -> FloatArray:
        """Return the values (N, K) at positions (N, M)."""
        return self._derivative(positions, None)

    def slopes(self, positions: FloatArray) -> FloatArray:
        """Return the derivatives (N, K, M) at positions (N, M) with respect to each motion."""
        zeros = np.zeros((len(positions), self._constant.shape[-1]))
        motions = range(len(self.low))
        rows = [self._derivative(positions, motion) if motion in self._varied else zeros for motion in motions]
        return np.stack(rows, axis=-1)

    def _derivative(self, positions: FloatArray, by: int | None) -> FloatArray:
        """Return the first derivatives with respect to the motion ``by``, or the values if it is None."""
        if self._spline is None:
            return np.broadcast_to(self._constant, (len(positions), self._constant.shape[-1]))
        inside = np.ascontiguousarray(np.clip(positions, self.low, self.high)[:, list(self._varied)])
        orders = None if by is None else np.array([int(motion == by) for motion in self._varied])
        return np.asarray(self._spline(inside, nu=orders))

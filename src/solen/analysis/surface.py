"""Smooth surfaces through values on a grid of several motions: tensor products of cubic splines.

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
        Limits of each motion's range, (M,); positions beyond them are clamped to the nearest limit.
    """

    low: FloatArray
    high: FloatArray
    _moved: tuple[int, ...]
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

        ends = np.array([[node[0], node[-1]] for node in nodes]).reshape(-1, 2)
        moved = tuple(place for place, node in enumerate(nodes) if len(node) > 1)
        coefficients = values.reshape([len(nodes[place]) for place in moved] + [values.shape[-1]])
        knots, degrees = [], []
        for axis, place in enumerate(moved):
            degree = min(3, len(nodes[place]) - 1)
            spline = make_interp_spline(nodes[place], coefficients, k=degree, axis=axis)
            knots.append(spline.t)
            degrees.append(degree)
            coefficients = np.moveaxis(spline.c, 0, axis)
        surface = NdBSpline(tuple(knots), np.ascontiguousarray(coefficients), tuple(degrees)) if moved else None
        return cls(ends[:, 0], ends[:, 1], moved, surface, coefficients)

    def at(self, places: FloatArray) -> FloatArray:
        """Values (N, K) at positions (N, M)."""
        return self._derivative(places, None)

    def slopes(self, places: FloatArray) -> FloatArray:
        """Derivatives (N, K, M) at positions (N, M) with respect to each motion."""
        nothing = np.zeros((len(places), self._constant.shape[-1]))
        rows = [self._derivative(places, one) if one in self._moved else nothing for one in range(len(self.low))]
        return np.stack(rows, axis=-1)

    def _derivative(self, places: FloatArray, by: int | None) -> FloatArray:
        if self._spline is None:
            return np.broadcast_to(self._constant, (len(places), self._constant.shape[-1]))
        inside = np.ascontiguousarray(np.clip(places, self.low, self.high)[:, list(self._moved)])
        orders = None if by is None else np.array([int(one == by) for one in self._moved])
        return np.asarray(self._spline(inside, nu=orders))

"""The forward map of a network: its readings as smooth functions of its motions, through the states of a recording.

Each reading is a Gaussian process (Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006) about a
least-squares plane, with a Matérn covariance of smoothness 5/2. The correlation length along each motion and the
scatter of a state about the map minimise the error of each state predicted from all others, which has a closed form
(ibid., eq. 5.12); the same errors determine the scale. The variance of the map is therefore small at recorded states,
larger between them, largest beyond them, and larger where the readings change sharply.

Public name: `ForwardMap`.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from solen.arrays import FloatArray

REACHES = (0.1, 0.2, 0.35, 0.6, 1.0, 2.0, 5.0)
"""Correlation lengths tried, as a fraction of a motion's range."""
FEWER = (0.2, 0.5, 1.2, 4.0)
SCATTERS = (1e-6, 1e-4, 1e-3, 1e-2, 0.1)
"""Variances of a state about the map that are tried, relative to the map variance."""
AT_ONCE = 2048


@dataclass(frozen=True, eq=False)
class _Process:
    """Readings with a common covariance: indices, correlation lengths and scatter, and precomputed matrices."""

    places: tuple[int, ...]
    reach: FloatArray
    scatter: float
    inverse: FloatArray
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class ForwardMap:
    """Readings as functions of motions.

    Attributes
    ----------
    low, high
        Lower and upper limit of each motion, (M,).
    reach
        Correlation length of each reading along each motion, as a fraction of the motion's range, (K, M).
    scatter, scale
        Variance of a state of each reading relative to the map variance, and map variance, (K,).
    """

    low: FloatArray
    high: FloatArray
    reach: FloatArray
    scatter: FloatArray
    scale: FloatArray
    _states: FloatArray
    _plane: FloatArray
    _processes: tuple[_Process, ...]

    @classmethod
    def through(
        cls,
        angle_deg: FloatArray,
        signal: FloatArray,
        *,
        ends_deg: FloatArray | None = None,
        reach: FloatArray | None = None,
        scatter: FloatArray | None = None,
    ) -> "ForwardMap":
        """Fit a map through states.

        Parameters
        ----------
        angle_deg
            Distinct states, (n, M), n > M + 2.
        signal
            Readings in these states, (n, K).
        ends_deg
            Limits of the ranges (2, M); default: the extremes of the states.
        reach, scatter
            As in the attributes; default: chosen from the states.
        """
        low, high = (angle_deg.min(axis=0), angle_deg.max(axis=0)) if ends_deg is None else ends_deg
        states = (angle_deg - low) / np.maximum(high - low, 1e-12)
        design = np.column_stack([np.ones(len(states)), states])
        plane = np.linalg.lstsq(design, signal, rcond=None)[0]
        beside = signal - design @ plane
        if reach is None or scatter is None:
            reach, scatter = _chosen(states, beside)
        scale, processes = np.zeros(signal.shape[1]), []
        rows = np.column_stack([reach, scatter])
        for row in np.unique(rows, axis=0):
            places = np.flatnonzero((rows == row).all(axis=1))
            inverse = np.linalg.inv(_covariance(states, states, row[:-1]) + row[-1] * np.eye(len(states)))
            weights = inverse @ beside[:, places]
            scale[places] = (weights**2 / np.diag(inverse)[:, None]).mean(axis=0)
            processes.append(_Process(tuple(places.tolist()), row[:-1], float(row[-1]), inverse, weights))
        return cls(low, high, reach, scatter, scale, states, plane, tuple(processes))

    def at(self, angle_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the means and variances (N, K) of the expected readings at states (N, M)."""
        places = (angle_deg - self.low) / np.maximum(self.high - self.low, 1e-12)
        mean = np.column_stack([np.ones(len(places)), places]) @ self._plane
        variance = np.zeros_like(mean)
        for process in self._processes:
            columns = list(process.places)
            for begin in range(0, len(places), AT_ONCE):
                rows = slice(begin, begin + AT_ONCE)
                near = _covariance(places[rows], self._states, process.reach)
                left = 1.0 + process.scatter - np.einsum("ij,jk,ik->i", near, process.inverse, near, optimize=True)
                mean[rows, columns] += near @ process.weights
                variance[rows, columns] = np.maximum(left, process.scatter)[:, None] * self.scale[columns]
        return mean, variance


def _chosen(states: FloatArray, beside: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the correlation lengths (K, M) and scatter (K,) that best predict each state of a reading from the other states."""
    motions = states.shape[1]
    each = REACHES if motions <= 2 else FEWER
    best = np.full(beside.shape[1], np.inf)
    reach, scatter = np.ones((beside.shape[1], motions)), np.full(beside.shape[1], SCATTERS[0])
    for reaches in product(each, repeat=motions) if motions <= 3 else ((one,) * motions for one in REACHES):
        values, vectors = np.linalg.eigh(_covariance(states, states, np.array(reaches)))
        turned = vectors.T @ beside
        for one in SCATTERS:
            shares = 1.0 / (np.maximum(values, 0.0) + one)
            diagonal = (vectors**2 @ shares)[:, None]
            missed = vectors @ (shares[:, None] * turned) / diagonal
            scale = np.maximum((missed**2 * diagonal).mean(axis=0), 1e-300)
            score = len(states) * np.log(scale) - np.log(diagonal).sum()
            better = score < best
            best[better], reach[better], scatter[better] = score[better], reaches, one
    return reach, scatter


def _covariance(a: FloatArray, b: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the Matérn covariance of smoothness 5/2 between positions (n, M) and (m, M)."""
    apart = (a[:, None, :] - b[None, :, :]) / reach
    far = np.sqrt(5.0 * np.einsum("ijk,ijk->ij", apart, apart))
    return np.asarray((1.0 + far + far**2 / 3.0) * np.exp(-far))

"""The forward map of a network: its readings as smooth functions of its motions, through the states of a recording.

Each reading is a Gaussian process (Rasmussen & Williams, Gaussian Processes for Machine Learning, 2006) about a
least-squares plane, with a Matérn covariance of smoothness 5/2. The correlation length along each motion and the
scatter of a state about the map minimise the error with which each state is predicted from all others, for which there
is a closed form (ibid., eq. 5.12); the same errors determine the scale. The variance of the map is therefore small at
recorded states, larger between them, largest outside their range, and larger for readings that change sharply.

Public name: `ForwardMap`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from solen.arrays import FloatArray

LENGTHS = (0.1, 0.2, 0.35, 0.6, 1.0, 2.0, 5.0)
"""Correlation lengths that are tried, as fractions of a motion's range."""
FEWER_LENGTHS = (0.2, 0.5, 1.2, 4.0)
"""Correlation lengths that are tried with three motions."""
SCATTERS = (1e-6, 1e-4, 1e-3, 1e-2, 0.1)
"""Variances of a state about the map that are tried, relative to the map variance."""
BATCH = 2048
"""Number of states evaluated together."""


@dataclass(frozen=True, eq=False)
class _Process:
    """Readings with a common covariance: indices, correlation lengths and scatter, and precomputed matrices."""

    readings: tuple[int, ...]
    length: FloatArray
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
    length
        Correlation length of each reading along each motion, as a fraction of the motion's range, (K, M).
    scatter, scale
        Variance of a state of each reading relative to the map variance, and map variance, (K,).
    """

    low: FloatArray
    high: FloatArray
    length: FloatArray
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
        length: FloatArray | None = None,
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
        length, scatter
            Correlation lengths (K, M) and variances (K,) as in the attributes; by default those that best
            predict each state from the others.
        """
        low, high = (angle_deg.min(axis=0), angle_deg.max(axis=0)) if ends_deg is None else ends_deg
        states = (angle_deg - low) / np.maximum(high - low, 1e-12)
        design = np.column_stack([np.ones(len(states)), states])
        plane = np.linalg.lstsq(design, signal, rcond=None)[0]
        residual = signal - design @ plane
        if length is None or scatter is None:
            length, scatter = _best_parameters(states, residual)
        scale, processes = np.zeros(signal.shape[1]), []
        rows = np.column_stack([length, scatter])
        for row in np.unique(rows, axis=0):
            readings = np.flatnonzero((rows == row).all(axis=1))
            inverse = np.linalg.inv(_covariance(states, states, row[:-1]) + row[-1] * np.eye(len(states)))
            weights = inverse @ residual[:, readings]
            scale[readings] = (weights**2 / np.diag(inverse)[:, None]).mean(axis=0)
            processes.append(_Process(tuple(readings.tolist()), row[:-1], float(row[-1]), inverse, weights))
        return cls(low, high, length, scatter, scale, states, plane, tuple(processes))

    def at(self, angle_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the means and variances (N, K) of the expected readings at states (N, M)."""
        states = (angle_deg - self.low) / np.maximum(self.high - self.low, 1e-12)
        mean = np.column_stack([np.ones(len(states)), states]) @ self._plane
        variance = np.zeros_like(mean)
        for process in self._processes:
            columns = list(process.readings)
            for begin in range(0, len(states), BATCH):
                rows = slice(begin, begin + BATCH)
                covariance = _covariance(states[rows], self._states, process.length)
                known = np.einsum("ij,jk,ik->i", covariance, process.inverse, covariance, optimize=True)
                mean[rows, columns] += covariance @ process.weights
                unknown = np.maximum(1.0 + process.scatter - known, process.scatter)
                variance[rows, columns] = unknown[:, None] * self.scale[columns]
        return mean, variance


def _best_parameters(states: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the correlation lengths (K, M) and scatter (K,) that best predict each state from the others."""
    readings, motions = residual.shape[1], states.shape[1]
    best = np.full(readings, np.inf)
    length, scatter = np.ones((readings, motions)), np.full(readings, SCATTERS[0])
    for lengths in _lengths(motions):
        values, vectors = np.linalg.eigh(_covariance(states, states, np.array(lengths)))
        components = vectors.T @ residual
        for variance in SCATTERS:
            inverse = 1.0 / (np.maximum(values, 0.0) + variance)
            diagonal = (vectors**2 @ inverse)[:, None]
            error = vectors @ (inverse[:, None] * components) / diagonal
            scale = np.maximum((error**2 * diagonal).mean(axis=0), 1e-300)
            score = len(states) * np.log(scale) - np.log(diagonal).sum()
            better = score < best
            best[better], length[better], scatter[better] = score[better], lengths, variance
    return length, scatter


def _lengths(motions: int) -> Iterable[tuple[float, ...]]:
    """Return the combinations of correlation lengths that are tried: equal lengths for more than three motions."""
    if motions > 3:
        return ((length,) * motions for length in LENGTHS)
    return product(LENGTHS if motions <= 2 else FEWER_LENGTHS, repeat=motions)


def _covariance(a: FloatArray, b: FloatArray, length: FloatArray) -> FloatArray:
    """Return the Matérn covariance of smoothness 5/2 between positions (n, M) and (m, M)."""
    difference = (a[:, None, :] - b[None, :, :]) / length
    distance = np.sqrt(5.0 * np.einsum("ijk,ijk->ij", difference, difference))
    return np.asarray((1.0 + distance + distance**2 / 3.0) * np.exp(-distance))

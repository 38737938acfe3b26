"""Decoding of network readings into motions: weighted least squares on the forward map, with credible bands.

The means and standard deviations of the forward map are tabulated as smooth surfaces. For a reading y, the motions θ
minimise (y − f(θ))ᵀ S(θ)⁻¹ (y − f(θ)) + ln det S(θ), where S is the covariance of the reading noise plus the variances
of the map. The minimum is searched for in the entire table and refined by Gauss–Newton steps from the lowest nodes, so
that other motions that match a reading are also found. The covariance of θ is (Jᵀ S⁻¹ J)⁻¹; its bands are limited to
the calibrated range. A reading that is too far from every f(θ) is outside the map.

Public names: `NetworkDecoder` and `NetworkDecoded`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from solen.analysis.calibration.decoder import LEVELS, MIN_TAIL_PROBABILITY
from solen.analysis.network.forward import ForwardMap
from solen.analysis.surface import Surface
from solen.arrays import BoolArray, FloatArray

NODES, MAX_NODES = 4096, 49
"""Maximum number of table nodes for all motions together, and for one motion."""
STARTS, STEPS = 4, 8
"""Number of table nodes from which a reading is refined, and number of steps from each node."""
MIN_PROBABILITY = 0.05
"""Smallest probability of another state that makes a reading ambiguous."""
MIN_DIFFERENCE = 3.0
"""Two states are distinct if they differ by more than this many standard deviations."""
BATCH = 256
"""Number of readings decoded together."""


@dataclass(frozen=True, eq=False)
class NetworkDecoded:
    """Decoded motions of readings.

    Attributes
    ----------
    angle_deg, sd_deg
        Angles and their standard deviations, (n, motions); NaN if a reading is missing.
    low_deg, high_deg
        Limits of the 68 and 95 % bands, (n, motions, 2), within the calibrated range.
    distance
        Squared distance of the readings from the map, in units of their covariance, (n,).
    other_deg, probability
        Another state that matches the readings (n, motions), NaN if there is none, and the probability of the first
        state.
    outside, ambiguous, at_end, missing
        Whether the readings match no state of the map, match several states, have a band that reaches an end of a
        calibrated range, or are incomplete, (n,).
    """

    angle_deg: FloatArray
    sd_deg: FloatArray
    low_deg: FloatArray
    high_deg: FloatArray
    distance: FloatArray
    other_deg: FloatArray
    probability: FloatArray
    outside: BoolArray
    ambiguous: BoolArray
    at_end: BoolArray
    missing: BoolArray

    def holds(self, angle_deg: FloatArray, level: int) -> BoolArray:
        """Return whether the bands at a level (0 for 68 %, 1 for 95 %) contain the true angles (n, motions)."""
        return np.asarray((self.low_deg[..., level] <= angle_deg) & (angle_deg <= self.high_deg[..., level]))


@dataclass(frozen=True, eq=False)
class _Fit:
    """States (n, M) at which the minimised sum is smallest, with distance, sum and covariance at these states."""

    angle_deg: FloatArray
    distance: FloatArray
    total: FloatArray
    covariance: FloatArray


class NetworkDecoder:
    """Decoder of readings, prepared from a forward map.

    Parameters
    ----------
    forward
        The map.
    noise
        Covariance of a reading, (K, K).
    freedom
        Degrees of freedom of the map variances.
    outside
        Squared distance above which a reading is outside the map; the value from the map's t distribution is used if it
        is larger.
    """

    def __init__(self, forward: ForwardMap, noise: FloatArray, freedom: int, outside: float = 0.0) -> None:
        self.low_deg, self.high_deg = forward.low, forward.high
        motions = len(forward.low)
        count = max(3, min(MAX_NODES, int(NODES ** (1.0 / motions) + 1e-9)))
        nodes = [np.linspace(low, high, count) for low, high in zip(forward.low, forward.high, strict=True)]
        grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, motions)
        self._shape, self._grid, self._noise, self._freedom = (count,) * motions, grid, noise, freedom
        mean, variance = forward.at(grid)
        self._readings = mean.shape[1]
        redundant = max(self._readings - motions, 1)
        self._limit = max(outside, redundant * float(stats.f.isf(MIN_TAIL_PROBABILITY, redundant, freedom)))
        self._surface = Surface.through(nodes, np.hstack([mean, np.sqrt(variance)]).reshape(*self._shape, -1))
        self._centre = mean.mean(axis=0)
        covariance = noise + variance[:, :, None] * np.eye(self._readings)
        self._weights = np.linalg.inv(covariance)
        centred = mean - self._centre
        self._weighted = np.einsum("gij,gj->gi", self._weights, centred)
        self._constant = np.einsum("gi,gi->g", self._weighted, centred) + np.linalg.slogdet(covariance)[1]

    @property
    def nodes_deg(self) -> FloatArray:
        """States at the table nodes, (G, M)."""
        return self._grid

    def covariance(self, angle_deg: FloatArray) -> FloatArray:
        """Return the covariance (N, K, K) of readings about the map at states (N, M)."""
        scatter = self._surface.at(angle_deg)[:, self._readings :]
        return np.asarray(self._noise + (scatter**2)[:, :, None] * np.eye(self._readings))

    def slopes(self, angle_deg: FloatArray) -> FloatArray:
        """Return the derivatives (N, K, M) of the readings with respect to the motions."""
        return self._surface.slopes(angle_deg)[:, : self._readings]

    def decode(self, signal: FloatArray) -> NetworkDecoded:
        """Decode readings (n, K), or (n, emitters, receivers) in the order of the calibration, into motions."""
        flat = np.asarray(signal, dtype=float).reshape(len(signal), -1)
        complete = np.isfinite(flat).all(axis=1)
        readings = flat[complete]
        parts = [self._decode_batch(readings[begin : begin + BATCH]) for begin in range(0, len(readings), BATCH)]
        return _with_missing(parts, complete, len(self.low_deg))

    def _decode_batch(self, flat: FloatArray) -> NetworkDecoded:
        starts = self._lowest(flat)
        return self._best([self._refined(flat, self._grid[nodes], self._weights[nodes]) for nodes in starts.T])

    def _lowest(self, flat: FloatArray) -> FloatArray:
        """Return the indices (n, STARTS) of nodes that match the readings better than their neighbours, best first."""
        centred = flat - self._centre
        squares = (centred[:, :, None] * centred[:, None, :]).reshape(len(flat), -1)
        weights = self._weights.reshape(len(self._grid), -1)
        total = squares @ weights.T - 2.0 * centred @ self._weighted.T + self._constant
        grid = total.reshape(-1, *self._shape)
        lowest = np.ones(grid.shape, bool)
        for axis in range(1, grid.ndim):
            ends = [(0, 0)] * grid.ndim
            ends[axis] = (1, 1)
            padded = np.pad(grid, ends, constant_values=np.inf)
            before, after = (np.take(padded, np.arange(grid.shape[axis]) + step, axis=axis) for step in (0, 2))
            lowest &= (grid <= before) & (grid <= after)
        ranked = np.where(lowest.reshape(total.shape), total, total + 1e12)
        first = np.argpartition(ranked, STARTS - 1, axis=1)[:, :STARTS]
        order = np.argsort(np.take_along_axis(ranked, first, axis=1), axis=1)
        return np.asarray(np.take_along_axis(first, order, axis=1))

    def _refined(self, flat: FloatArray, angle_deg: FloatArray, weights: FloatArray) -> _Fit:
        """Refine states by damped Gauss–Newton steps within the range."""
        span = np.maximum(self.high_deg - self.low_deg, 1e-12)
        damping = np.full(len(flat), 1e-3)
        residual = flat - self._surface.at(angle_deg)[:, : self._readings]
        best = np.einsum("ni,nij,nj->n", residual, weights, residual)
        for _ in range(STEPS):
            jacobian = self.slopes(angle_deg)
            weighted = np.einsum("nij,njm->nim", weights, jacobian)
            normal = np.einsum("nim,nil->nml", jacobian, weighted)
            diagonal = np.einsum("nmm->nm", normal)
            tiny = 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12 / span**2
            damped = normal + (damping[:, None] * diagonal + tiny)[:, :, None] * np.eye(len(span))
            step = np.linalg.solve(damped, np.einsum("nim,ni->nm", weighted, residual)[..., None])[..., 0]
            new_deg = np.clip(angle_deg + step, self.low_deg, self.high_deg)
            new_residual = flat - self._surface.at(new_deg)[:, : self._readings]
            total = np.einsum("ni,nij,nj->n", new_residual, weights, new_residual)
            better = total < best
            angle_deg = np.where(better[:, None], new_deg, angle_deg)
            residual = np.where(better[:, None], new_residual, residual)
            best = np.where(better, total, best)
            damping = np.where(better, 0.1 * damping, 10.0 * damping)
        return self._fit_at(flat, angle_deg)

    def _fit_at(self, flat: FloatArray, angle_deg: FloatArray) -> _Fit:
        """Evaluate how well readings match the specified states."""
        covariance, jacobian = self.covariance(angle_deg), self.slopes(angle_deg)
        residual = flat - self._surface.at(angle_deg)[:, : self._readings]
        weights = np.linalg.inv(covariance)
        distance = np.einsum("ni,nij,nj->n", residual, weights, residual)
        span = np.maximum(self.high_deg - self.low_deg, 1e-12)
        normal = np.einsum("nim,nij,njl->nml", jacobian, weights, jacobian) + np.eye(len(span)) * 1e-6 / span**2
        return _Fit(angle_deg, distance, distance + np.linalg.slogdet(covariance)[1], np.linalg.inv(normal))

    def _best(self, fits: Sequence[_Fit]) -> NetworkDecoded:
        """Return the best of several fits of each reading, with the most probable of the other states."""
        totals = np.stack([fit.total for fit in fits])
        volumes = np.stack([0.5 * np.linalg.slogdet(fit.covariance)[1] for fit in fits])
        best = np.argmin(totals, axis=0)
        rows = np.arange(totals.shape[1])
        angles, covariances, distances = (
            np.stack([getattr(fit, name) for fit in fits]) for name in ("angle_deg", "covariance", "distance")
        )
        angle, covariance, distance = angles[best, rows], covariances[best, rows], distances[best, rows]
        sd = np.sqrt(np.einsum("nmm->nm", covariance))
        difference = np.abs(angles - angle) / np.hypot(sd, np.sqrt(np.einsum("snmm->snm", covariances)))
        distinct = (difference > MIN_DIFFERENCE).any(axis=2)
        with np.errstate(over="ignore"):
            ratios = np.exp(np.minimum(-0.5 * (totals - totals[best, rows]) + volumes - volumes[best, rows], 50.0))
        rivals = np.where(distinct, ratios, 0.0)
        rival = np.argmax(rivals, axis=0)
        probability = 1.0 / (1.0 + rivals[rival, rows])
        ambiguous = 1.0 - probability > MIN_PROBABILITY
        factor = stats.t.ppf(0.5 + 0.5 * np.array(LEVELS), self._freedom)
        low = np.maximum(angle[..., None] - sd[..., None] * factor, self.low_deg[:, None])
        high = np.minimum(angle[..., None] + sd[..., None] * factor, self.high_deg[:, None])
        ends = (low[..., 1] <= self.low_deg) | (high[..., 1] >= self.high_deg)
        return NetworkDecoded(
            angle_deg=angle,
            sd_deg=sd,
            low_deg=low,
            high_deg=high,
            distance=distance,
            other_deg=np.where(ambiguous[:, None], angles[rival, rows], np.nan),
            probability=probability,
            outside=distance > self._limit,
            ambiguous=ambiguous,
            at_end=ends.any(axis=1),
            missing=np.zeros(len(angle), bool),
        )


def _with_missing(parts: Sequence[NetworkDecoded], complete: BoolArray, motions: int) -> NetworkDecoded:
    """Join decoded parts, with NaN for incomplete readings."""
    shapes = {"low_deg": (motions, 2), "high_deg": (motions, 2), "distance": (), "probability": ()}
    columns = {}
    for name in NetworkDecoded.__dataclass_fields__:
        flag = name in {"outside", "ambiguous", "at_end", "missing"}
        column = np.full((len(complete), *(() if flag else shapes.get(name, (motions,)))), False if flag else np.nan)
        if parts:
            column[complete] = np.concatenate([getattr(part, name) for part in parts])
        columns[name] = column
    columns["missing"] = ~complete
    return NetworkDecoded(**columns)

"""Decoding of network readings into motions: weighted least squares on the forward map, with credible bands.

The forward map is tabulated as a smooth surface of means and of variances. For a reading y, the motions θ minimise (y −
f(θ))ᵀ S(θ)⁻¹ (y − f(θ)) + ln det S(θ), where S is the covariance of the reading noise plus the variances of the map.
The minimum is searched for over the entire table and refined by Gauss–Newton steps from the lowest nodes, so other
motions that match a reading are also found. The covariance of θ is (Jᵀ S⁻¹ J)⁻¹; its bands are limited to the
calibrated range. A reading that is too far from every f(θ) is outside the map.

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
STARTS, ROUNDS = 4, 8
"""Number of table nodes from which a reading is refined, and number of steps from each node."""
COUNTS = 0.05
"""Another state that matches a reading counts if its probability is at least this value."""
APART = 3.0
"""Two states are distinct if they differ by at least this many standard deviations."""
AT_ONCE = 256


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
        Whether the readings match no point of the map, match several points, have a band that reaches an end of a
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
        found = (self.low_deg[..., level] <= angle_deg) & (angle_deg <= self.high_deg[..., level])
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class _Fit:
    """States (n, M) at which the sum has a minimum, with the distance, the sum and the covariance at these states."""

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
        Squared distance above which a reading is outside the map, if larger than the value from the map's t
        distribution.
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
        left = max(self._readings - motions, 1)
        self._limit = max(outside, left * float(stats.f.isf(MIN_TAIL_PROBABILITY, left, freedom)))
        self._surface = Surface.through(nodes, np.hstack([mean, np.sqrt(variance)]).reshape(*self._shape, -1))
        self._middle = mean.mean(axis=0)
        covariance = noise + variance[:, :, None] * np.eye(self._readings)
        self._weights = np.linalg.inv(covariance)
        self._offset = np.linalg.slogdet(covariance)[1]
        beside = mean - self._middle
        self._pulled = np.einsum("gij,gj->gi", self._weights, beside)
        self._own = np.einsum("gi,gi->g", self._pulled, beside) + self._offset

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
        good = np.isfinite(flat).all(axis=1)
        parts = [self._part(flat[good][begin : begin + AT_ONCE]) for begin in range(0, int(good.sum()), AT_ONCE)]
        return _spread(parts, good, len(self.low_deg))

    def _part(self, flat: FloatArray) -> NetworkDecoded:
        starts = self._lowest(flat)
        fits = [self._refined(flat, self._grid[places], self._weights[places]) for places in starts.T]
        return self._judged(fits)

    def _lowest(self, flat: FloatArray) -> FloatArray:
        """Return the indices (n, STARTS) of table nodes that match the readings better than their neighbours, best first."""
        beside = flat - self._middle
        squares = (beside[:, :, None] * beside[:, None, :]).reshape(len(flat), -1)
        total = squares @ self._weights.reshape(len(self._grid), -1).T - 2.0 * beside @ self._pulled.T + self._own
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

    def _refined(self, flat: FloatArray, places: FloatArray, weights: FloatArray) -> _Fit:
        """Refine the states by damped Gauss–Newton steps within the range."""
        span = np.maximum(self.high_deg - self.low_deg, 1e-12)
        damping = np.full(len(flat), 1e-3)
        residual = flat - self._surface.at(places)[:, : self._readings]
        best = np.einsum("ni,nij,nj->n", residual, weights, residual)
        for _ in range(ROUNDS):
            jacobian = self.slopes(places)
            pulled = np.einsum("nij,njm->nim", weights, jacobian)
            normal = np.einsum("nim,nil->nml", jacobian, pulled)
            diagonal = np.einsum("nmm->nm", normal)
            tiny = 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12 / span**2
            damped = normal + (damping[:, None] * diagonal + tiny)[:, :, None] * np.eye(len(span))
            step = np.linalg.solve(damped, np.einsum("nim,ni->nm", pulled, residual)[..., None])[..., 0]
            tried = np.clip(places + step, self.low_deg, self.high_deg)
            left = flat - self._surface.at(tried)[:, : self._readings]
            total = np.einsum("ni,nij,nj->n", left, weights, left)
            better = total < best
            places = np.where(better[:, None], tried, places)
            residual = np.where(better[:, None], left, residual)
            best = np.where(better, total, best)
            damping = np.where(better, 0.1 * damping, 10.0 * damping)
        return self._at(flat, places)

    def _at(self, flat: FloatArray, places: FloatArray) -> _Fit:
        """Evaluate how well readings match the specified states."""
        covariance, jacobian = self.covariance(places), self.slopes(places)
        residual = flat - self._surface.at(places)[:, : self._readings]
        weights = np.linalg.inv(covariance)
        distance = np.einsum("ni,nij,nj->n", residual, weights, residual)
        span = np.maximum(self.high_deg - self.low_deg, 1e-12)
        normal = np.einsum("nim,nij,njl->nml", jacobian, weights, jacobian) + np.eye(len(span)) * 1e-6 / span**2
        return _Fit(places, distance, distance + np.linalg.slogdet(covariance)[1], np.linalg.inv(normal))

    def _judged(self, fits: Sequence[_Fit]) -> NetworkDecoded:
        totals = np.stack([fit.total for fit in fits])
        volumes = np.stack([0.5 * np.linalg.slogdet(fit.covariance)[1] for fit in fits])
        best = np.argmin(totals, axis=0)
        rows = np.arange(totals.shape[1])
        places, covariances, distances = (
            np.stack([getattr(fit, name) for fit in fits]) for name in ("angle_deg", "covariance", "distance")
        )
        angle, covariance, distance = places[best, rows], covariances[best, rows], distances[best, rows]
        sd = np.sqrt(np.einsum("nmm->nm", covariance))
        far = (np.abs(places - angle) > APART * np.hypot(sd, np.sqrt(np.einsum("snmm->snm", covariances)))).any(axis=2)
        with np.errstate(over="ignore"):
            shares = np.exp(np.minimum(-0.5 * (totals - totals[best, rows]) + volumes - volumes[best, rows], 50.0))
        rivals = np.where(far, shares, 0.0)
        rival = np.argmax(rivals, axis=0)
        other = rivals[rival, rows]
        probability = 1.0 / (1.0 + other)
        ambiguous = 1.0 - probability > COUNTS
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
            other_deg=np.where(ambiguous[:, None], places[rival, rows], np.nan),
            probability=probability,
            outside=distance > self._limit,
            ambiguous=ambiguous,
            at_end=ends.any(axis=1),
            missing=np.zeros(len(angle), bool),
        )


def _spread(parts: Sequence[NetworkDecoded], good: BoolArray, motions: int) -> NetworkDecoded:
    """Join parts, with NaN for incomplete readings."""
    shapes = {"low_deg": (motions, 2), "high_deg": (motions, 2), "distance": (), "probability": ()}
    found = {}
    for name in NetworkDecoded.__dataclass_fields__:
        flag = name in {"outside", "ambiguous", "at_end", "missing"}
        whole = np.full((len(good), *(() if flag else shapes.get(name, (motions,)))), False if flag else np.nan)
        if parts:
            whole[good] = np.concatenate([getattr(part, name) for part in parts])
        found[name] = whole
    found["missing"] = ~good
    return NetworkDecoded(**found)

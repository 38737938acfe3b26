"""Conversion of powers by emitter position into powers for any chip, with their errors.

The power for a chip of any width and decentre is a mean over positions: a weighted sum over position bins, whose
weights depend only on width and decentre. For few chips, bin edges coincide with all chip ends, and the sum is exact.
For many chips, the bin width is adapted to the narrowest chip at each position, and the cumulative power is
interpolated between bin edges with cubics; the difference from linear interpolation gives an error estimate.

Each bin has two lattices of rays and each point has eight, all with independent random shifts. The differences between
lattices give the standard deviation for each bin, and the weights combine these into one for each chip.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.errors import DesignError
from solen.trace.kernel.designs import Bins

MIN_BINS, MAX_BINS = 16, 128
BINS_PER_CHIP = 16
"""Number of bins across the narrowest chip at each position, up to a total of `MAX_BINS`."""
MAX_ENDS = 32
"""Maximum number of chip ends for which every end coincides with a bin edge."""
MIN_DISTANCE_MM = 1e-9
"""Chip ends closer together than this are merged."""
CUBIC_ERROR = 0.3
"""Estimated error of cubic interpolation, as a fraction of its difference from linear interpolation."""
SHIFTS, POINT_SHIFTS = 2, 8
"""Number of lattices per bin, and per point."""
STUDENT = 1.35
"""The 97.5 % quantile of Student's t distribution is approximately that of the normal distribution times
1 + 1.35/(degrees of freedom).
"""
MIN_VARIANCE = 1e-300


class Chips(NamedTuple):
    """Chips of a design: width and decentre in mm (K,). Either all chips are points or none is."""

    width: FloatArray
    offset: FloatArray

    @property
    def are_points(self) -> bool:
        """Whether all chips have zero width."""
        return not np.any(self.width > 0.0)


def lattices_for(width: FloatArray, offset: FloatArray, both: bool) -> int:
    """Return the number of lattices needed for chips (D, K), with mirror images about the axis if ``both``."""
    is_point = width == 0.0
    if is_point.all():
        return int(width.shape[1] * POINT_SHIFTS * (1 + both))
    if is_point.any():
        limit = "must be 0 for all chips of a call, or for none"
        raise DesignError("widths_mm", value=0.0, limit=limit, remedy="compute points in a separate call")
    low, high = (offset - 0.5 * width).min(axis=1), (offset + 0.5 * width).max(axis=1)
    span = 2.0 * np.maximum(np.abs(low), np.abs(high)) if both else high - low
    ends = 2 * width.shape[1] * (1 + both) + both
    if ends > MAX_ENDS:
        rows = np.unique(np.stack([width, offset], axis=1), axis=0)
        bins = max(cumulative_bins(Chips(*row), ends_of(Chips(*row), both), both)[-1] for row in rows)
    else:
        bins = (BINS_PER_CHIP * span / width.min(axis=1)).max()
    bins = math.ceil(bins - MIN_DISTANCE_MM)
    min_bins = max(MIN_BINS, ends if ends <= MAX_ENDS else 0)
    return 2 * SHIFTS * math.ceil(float(np.clip(bins, min_bins, MAX_BINS)) / 2)


def ends_of(chips: Chips, both: bool) -> FloatArray:
    """Return the ends of the chips in ascending order; if ``both``, also their mirror images, and the axis."""
    ends = np.concatenate([chips.offset - 0.5 * chips.width, chips.offset + 0.5 * chips.width])
    ends = np.sort(np.concatenate([ends, [0.0], -ends]) if both else ends)
    return np.asarray(ends[np.append(True, np.diff(ends) > MIN_DISTANCE_MM)])


def cumulative_bins(chips: Chips, ends: FloatArray, both: bool) -> FloatArray:
    """Return the number of bins required from the first chip end up to each chip end.

    There are `BINS_PER_CHIP` bins per width of the narrowest chip (or mirror image) that covers a position; if none
    covers it, the width of the widest chip is used.
    """
    offset = np.concatenate([chips.offset, -chips.offset]) if both else chips.offset
    width = np.concatenate([chips.width, chips.width]) if both else chips.width
    middle = 0.5 * (ends[1:] + ends[:-1])
    is_covered = np.abs(middle[:, None] - offset) < 0.5 * width
    narrowest = np.where(is_covered, width, width.max()).min(axis=1)
    return np.append(0.0, np.cumsum(BINS_PER_CHIP * np.diff(ends) / narrowest))


def bins_per_interval(lengths: FloatArray, bins: int) -> IntArray:
    """Distribute bins among intervals, at least one each, in approximate proportion to their lengths."""
    counts = np.ones(len(lengths), np.int64)
    for _ in range(bins - len(lengths)):
        counts[np.argmax(lengths / counts)] += 1
    return counts


class PositionBins(NamedTuple):
    """Position bins, repeated for each lattice, and weights (K, B) that combine the bin powers into chip powers.

    ``interpolation_error`` (K, B) contains the weights that give the estimated interpolation error.
    """

    bins: Bins
    weights: FloatArray
    interpolation_error: FloatArray
    shifts: int

    @classmethod
    def of(cls, chips: Chips, lattices: int, both: bool) -> "PositionBins":
        """Choose bins for the chips; if ``both``, bins are symmetric about the axis and serve for both sides."""
        if chips.are_points:
            points = np.concatenate([chips.offset, -chips.offset[::-1]]) if both else chips.offset
            weights = np.eye(len(chips.offset), len(points))
            return cls._repeated(Bins(points, points), weights, np.zeros_like(weights), POINT_SHIFTS)
        bins, ends = lattices // SHIFTS, ends_of(chips, both)
        if len(ends) > min(bins + 1, MAX_ENDS):
            return cls._interpolated(chips, bins, ends, both)
        counts = bins_per_interval(np.diff(ends[len(ends) // 2 :] if both else ends), bins // 2 if both else bins)
        counts = np.concatenate([counts[::-1], counts]) if both else counts
        pieces = [np.linspace(ends[i], ends[i + 1], n, endpoint=False) for i, n in enumerate(counts.tolist())]
        edges = np.append(np.concatenate(pieces), ends[-1])
        low, high = (chips.offset + side * 0.5 * chips.width for side in (-1.0, 1.0))
        middle = 0.5 * (edges[1:] + edges[:-1])
        is_covered = (middle > low[:, None]) & (middle < high[:, None])
        weights = is_covered * np.diff(edges)
        weights /= weights.sum(axis=1, keepdims=True)
        return cls._repeated(Bins(edges[:-1], edges[1:]), weights, np.zeros_like(weights), SHIFTS)

    @classmethod
    def _interpolated(cls, chips: Chips, bins: int, ends: FloatArray, both: bool) -> "PositionBins":
        cumulative = cumulative_bins(chips, ends, both)
        edges = np.interp(np.linspace(0.0, cumulative[-1], bins + 1), cumulative, ends)
        first, last = (chips.offset + side * 0.5 * chips.width for side in (-1.0, 1.0))
        cubic, linear = (
            (weights(last, edges) - weights(first, edges)) / chips.width[:, None]
            for weights in (integral_weights, linear_integral_weights)
        )
        return cls._repeated(Bins(edges[:-1], edges[1:]), cubic, CUBIC_ERROR * (cubic - linear), SHIFTS)

    @classmethod
    def _repeated(cls, bins: Bins, weights: FloatArray, interpolation_error: FloatArray, shifts: int) -> "PositionBins":
        weights, errors = (np.repeat(rows, shifts, axis=1) / shifts for rows in (weights, interpolation_error))
        return cls(Bins(*(np.repeat(ends, shifts) for ends in bins)), weights, errors, shifts)

    def powers(self, lattice_powers: FloatArray) -> FloatArray:
        """Return chip powers (..., K) from powers by lattice (..., B)."""
        return np.asarray(lattice_powers @ self.weights.T)

    def u_powers(self, lattice_powers: FloatArray) -> FloatArray:
        """Return standard errors (..., K) of `powers` from the differences between the lattices of each bin.

        They are increased to allow for the few degrees of freedom (Welch–Satterthwaite), so that ±2 standard errors
        cover 95 %.
        """
        freedom = self.shifts - 1
        lattices = [lattice_powers[..., i :: self.shifts] for i in range(self.shifts)]
        mean = sum(lattices) / self.shifts
        bin_variance = sum((lattice - mean) ** 2 for lattice in lattices) / freedom
        squares = self.shifts * self.weights[:, :: self.shifts].T ** 2
        variance = bin_variance @ squares
        inverse_freedom = (bin_variance**2 @ squares**2) / np.maximum(freedom * variance**2, MIN_VARIANCE)
        u_sampling = np.sqrt(variance) * (1.0 + STUDENT * inverse_freedom)
        return np.asarray(np.hypot(u_sampling, lattice_powers @ self.interpolation_error.T))


def integral_weights(position: FloatArray, edges: FloatArray) -> FloatArray:
    """Return weights (K, B) that turn mean bin powers into the integral from the first bin edge up to positions (K,).

    The integral is interpolated between bin edges with cubics, whose slopes are estimated from neighbouring bins and
    exact for powers that are cubic in position.
    """
    step = np.diff(edges)
    index = np.clip(np.searchsorted(edges, position, "right") - 1, 0, len(step) - 1)
    s = np.clip((position - edges[index]) / step[index], 0.0, 1.0)
    slopes = _slopes(edges)
    sums = (np.arange(len(step)) < index[:, None]).astype(float)
    sums[np.arange(len(position)), index] += s * s * (3.0 - 2.0 * s)
    before, after = (s * (1.0 - s) ** 2 * step[index], s * s * (1.0 - s) * step[index])
    return np.asarray(sums * step + before[:, None] * slopes[index] - after[:, None] * slopes[index + 1])


def linear_integral_weights(position: FloatArray, edges: FloatArray) -> FloatArray:
    """As `integral_weights`, with linear interpolation."""
    return np.asarray(np.clip(position[:, None] - edges[:-1], 0.0, np.diff(edges)))


def _slopes(edges: FloatArray) -> FloatArray:
    """Return weights (B + 1, B) for the power at bin edges: the slope of the quartic through five integrals."""
    bins = len(edges) - 1
    first = np.clip(np.arange(bins + 1) - 2, 0, bins - 4)
    nearest = first[:, None] + np.arange(5)
    size = edges[nearest[:, -1]] - edges[nearest[:, 0]]
    powers = ((edges[nearest] - edges[:, None]) / size[:, None])[:, None, :] ** np.arange(5)[:, None]
    of_integrals = np.linalg.solve(powers, np.broadcast_to(np.eye(5)[1][:, None], (bins + 1, 5, 1)))[..., 0]
    after = np.cumsum(of_integrals[:, ::-1], axis=1)[:, ::-1] / size[:, None]
    weights = np.zeros((bins + 1, bins))
    rows = np.arange(bins + 1)[:, None]
    weights[rows, nearest[:, :4]] = after[:, 1:] * np.diff(edges)[nearest[:, :4]]
    return weights


def mirrored(powers: FloatArray) -> FloatArray:
    """Return powers (..., B, 2) of a symmetric sensor at the opposite angle, from symmetric bins."""
    return np.asarray(powers[..., ::-1, ::-1])


def follows_by_symmetry(angle_deg: FloatArray) -> BoolArray:
    """Return whether the opposite of each angle (A,) occurs earlier in the list, so that it need not be traced."""
    return np.array([-angle in angle_deg[:i] for i, angle in enumerate(angle_deg.tolist())], dtype=bool)

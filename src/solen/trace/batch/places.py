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
BINS_OF_A_CHIP = 16
"""Number of bins across the narrowest chip at each position, up to a total of `MAX_BINS`."""
MAX_ENDS = 32
"""Maximum number of chip ends for which every end coincides with a bin edge."""
SAME_MM = 1e-9
"""Chip ends closer together than this are merged."""
NOT_STRAIGHT = 0.3
"""Estimated error of cubic interpolation, as a fraction of its difference from linear interpolation."""
SHIFTS, SHIFTS_OF_A_POINT = 2, 8
"""Number of lattices per bin, and per point."""
STUDENT = 1.35
"""The 97.5 % quantile of Student's distribution is that of the normal distribution times 1 + 1.35/(degrees of
freedom).
"""
TINY = 1e-300


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
    points = width == 0.0
    if points.all():
        return int(width.shape[1] * SHIFTS_OF_A_POINT * (1 + both))
    if points.any():
        limit = "must be 0 for all chips of a call, or for none"
        raise DesignError("widths_mm", value=0.0, limit=limit, remedy="compute points in a separate call")
    low, high = (offset - 0.5 * width).min(axis=1), (offset + 0.5 * width).max(axis=1)
    whole = 2.0 * np.maximum(np.abs(low), np.abs(high)) if both else high - low
    ends = 2 * width.shape[1] * (1 + both) + both
    if ends > MAX_ENDS:
        rows = np.unique(np.stack([width, offset], axis=1), axis=0)
        needed = max(bins_upto(Chips(*row), ends_of(Chips(*row), both), both)[-1] for row in rows)
    else:
        needed = (BINS_OF_A_CHIP * whole / width.min(axis=1)).max()
    needed = math.ceil(needed - SAME_MM)
    least = max(MIN_BINS, ends if ends <= MAX_ENDS else 0)
    return 2 * SHIFTS * math.ceil(float(np.clip(needed, least, MAX_BINS)) / 2)


def ends_of(chips: Chips, both: bool) -> FloatArray:
    """Positions where chips begin or end, ascending; if ``both``, also their mirror images and the axis."""
    ends = np.concatenate([chips.offset - 0.5 * chips.width, chips.offset + 0.5 * chips.width])
    ends = np.sort(np.concatenate([ends, [0.0], -ends]) if both else ends)
    return np.asarray(ends[np.append(True, np.diff(ends) > SAME_MM)])


def bins_upto(chips: Chips, ends: FloatArray, both: bool) -> FloatArray:
    """Number of bins required from the first chip end up to each chip end.

    There are `BINS_OF_A_CHIP` bins per width of the narrowest chip (or mirror image) that covers a position; if none
    covers it, the width of the widest chip is used.
    """
    offset = np.concatenate([chips.offset, -chips.offset]) if both else chips.offset
    width = np.concatenate([chips.width, chips.width]) if both else chips.width
    middle = 0.5 * (ends[1:] + ends[:-1])
    reached = np.abs(middle[:, None] - offset) < 0.5 * width
    narrowest = np.where(reached, width, width.max()).min(axis=1)
    return np.append(0.0, np.cumsum(BINS_OF_A_CHIP * np.diff(ends) / narrowest))


def distributed(lengths: FloatArray, many: int) -> IntArray:
    """Distribute ``many`` bins among intervals, at least one each, in approximate proportion to their lengths."""
    shares = np.ones(len(lengths), np.int64)
    for _ in range(many - len(lengths)):
        shares[np.argmax(lengths / shares)] += 1
    return shares


class Places(NamedTuple):
    """Position bins, repeated for each lattice, and weights (K, B) that combine the bin powers into chip powers.

    ``interpolation_error`` (K, B) contains the weights that give the estimated interpolation error.
    """

    bins: Bins
    weights: FloatArray
    interpolation_error: FloatArray
    shifts: int

    @classmethod
    def of(cls, chips: Chips, lattices: int, both: bool) -> "Places":
        """Choose bins for the chips; if ``both``, bins are symmetric about the axis and serve for both sides."""
        if chips.are_points:
            at = np.concatenate([chips.offset, -chips.offset[::-1]]) if both else chips.offset
            own = np.eye(len(chips.offset), len(at))
            return cls._repeated(Bins(at, at), own, np.zeros_like(own), SHIFTS_OF_A_POINT)
        many, ends = lattices // SHIFTS, ends_of(chips, both)
        if len(ends) > min(many + 1, MAX_ENDS):
            return cls._interpolated(chips, many, ends, both)
        shares = distributed(np.diff(ends[len(ends) // 2 :] if both else ends), many // 2 if both else many)
        shares = np.concatenate([shares[::-1], shares]) if both else shares
        pieces = [np.linspace(ends[i], ends[i + 1], n, endpoint=False) for i, n in enumerate(shares.tolist())]
        edges = np.append(np.concatenate(pieces), ends[-1])
        low, high = (chips.offset + side * 0.5 * chips.width for side in (-1.0, 1.0))
        middle = 0.5 * (edges[1:] + edges[:-1])
        within = (middle > low[:, None]) & (middle < high[:, None])
        weights = within * np.diff(edges)
        weights /= weights.sum(axis=1, keepdims=True)
        return cls._repeated(Bins(edges[:-1], edges[1:]), weights, np.zeros_like(weights), SHIFTS)

    @classmethod
    def _interpolated(cls, chips: Chips, many: int, ends: FloatArray, both: bool) -> "Places":
        wanted = bins_upto(chips, ends, both)
        edges = np.interp(np.linspace(0.0, wanted[-1], many + 1), wanted, ends)
        first, last = (chips.offset + side * 0.5 * chips.width for side in (-1.0, 1.0))
        cubic, straight = (
            (upto(last, edges) - upto(first, edges)) / chips.width[:, None] for upto in (cumulative, cumulative_linear)
        )
        return cls._repeated(Bins(edges[:-1], edges[1:]), cubic, NOT_STRAIGHT * (cubic - straight), SHIFTS)

    @classmethod
    def _repeated(cls, bins: Bins, weights: FloatArray, interpolation_error: FloatArray, shifts: int) -> "Places":
        each, errors = (np.repeat(rows, shifts, axis=1) / shifts for rows in (weights, interpolation_error))
        return cls(Bins(*(np.repeat(ends, shifts) for ends in bins)), each, errors, shifts)

    def powers(self, found: FloatArray) -> FloatArray:
        """Return chip powers (..., K) from powers by lattice (..., B)."""
        return np.asarray(found @ self.weights.T)

    def u_powers(self, found: FloatArray) -> FloatArray:
        """Return standard errors (..., K) of `powers` from the differences between the lattices of each bin.

        They are enlarged to allow for the few degrees of freedom (Welch–Satterthwaite), so that ±2 standard errors
        cover 95 %.
        """
        freedom = self.shifts - 1
        lattices = [found[..., i :: self.shifts] for i in range(self.shifts)]
        mean = sum(lattices) / self.shifts
        of_bin = sum((lattice - mean) ** 2 for lattice in lattices) / freedom
        squares = self.shifts * self.weights[:, :: self.shifts].T ** 2
        variance = of_bin @ squares
        lacking = (of_bin**2 @ squares**2) / np.maximum(freedom * variance**2, TINY)
        return np.asarray(np.hypot(np.sqrt(variance) * (1.0 + STUDENT * lacking), found @ self.interpolation_error.T))


def cumulative(at: FloatArray, edges: FloatArray) -> FloatArray:
    """Return weights (K, B) that turn mean bin powers into the integral from the first bin edge up to positions (K,).

    The integral is interpolated between bin edges with cubics, whose slopes are estimated from neighbouring bins and
    exact for powers that are cubic in position.
    """
    step = np.diff(edges)
    which = np.clip(np.searchsorted(edges, at, "right") - 1, 0, len(step) - 1)
    s = np.clip((at - edges[which]) / step[which], 0.0, 1.0)
    slopes = _slopes(edges)
    sums = (np.arange(len(step)) < which[:, None]).astype(float)
    sums[np.arange(len(at)), which] += s * s * (3.0 - 2.0 * s)
    before, after = (s * (1.0 - s) ** 2 * step[which], s * s * (1.0 - s) * step[which])
    return np.asarray(sums * step + before[:, None] * slopes[which] - after[:, None] * slopes[which + 1])


def cumulative_linear(at: FloatArray, edges: FloatArray) -> FloatArray:
    """As `cumulative`, with linear interpolation."""
    return np.asarray(np.clip(at[:, None] - edges[:-1], 0.0, np.diff(edges)))


def _slopes(edges: FloatArray) -> FloatArray:
    """Return weights (B + 1, B) for the power at bin edges: the slope of the quartic through five integrals."""
    many = len(edges) - 1
    first = np.clip(np.arange(many + 1) - 2, 0, many - 4)
    near = first[:, None] + np.arange(5)
    size = edges[near[:, -1]] - edges[near[:, 0]]
    powers = ((edges[near] - edges[:, None]) / size[:, None])[:, None, :] ** np.arange(5)[:, None]
    of_integrals = np.linalg.solve(powers, np.broadcast_to(np.eye(5)[1][:, None], (many + 1, 5, 1)))[..., 0]
    after = np.cumsum(of_integrals[:, ::-1], axis=1)[:, ::-1] / size[:, None]
    weights = np.zeros((many + 1, many))
    rows = np.arange(many + 1)[:, None]
    weights[rows, near[:, :4]] = after[:, 1:] * np.diff(edges)[near[:, :4]]
    return weights


def mirrored(found: FloatArray) -> FloatArray:
    """Return powers (..., B, 2) of a symmetric sensor at the opposite angle, from symmetric bins."""
    return np.asarray(found[..., ::-1, ::-1])


def are_symmetric(angle_deg: FloatArray) -> BoolArray:
    """Whether the opposite of each angle (A,) occurs earlier in the list, so that the angle need not be traced."""
    return np.array([-angle in angle_deg[:i] for i, angle in enumerate(angle_deg.tolist())], dtype=bool)

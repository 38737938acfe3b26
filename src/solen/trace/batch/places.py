"""From powers by emitter position to those of any chip: weights, and their errors.

A chip of any width and decentre is a mean over positions: a sum over bins of positions, with weights that depend only
on width and decentre. For few chips, the bins begin and end where chips do, and the sum is exact. For many, the bins
are as narrow as the narrowest chip that covers them requires, and the cumulative power is interpolated with cubics
between their edges; its difference from linear interpolation gives an estimate of the error.

A bin has two lattices of rays and a point has eight, each with its own random shift: their differences give the
standard deviation, and with the weights that of a chip.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.errors import DesignError
from solen.trace.kernel.designs import Bins

FEWEST_BINS, MOST_BINS = 16, 128
BINS_OF_A_CHIP = 16
"""Number of bins for the narrowest chip at a position, up to `MOST_BINS` in total."""
MOST_ENDS = 32
"""Largest number of chip ends for which bins begin and end at all of them."""
SAME_MM = 1e-9
"""Ends closer than this are merged."""
NOT_STRAIGHT = 0.3
"""Estimated error of cubic interpolation, as a fraction of its difference from linear interpolation."""
SHIFTS, SHIFTS_OF_A_POINT = 2, 8
"""Number of lattices of a bin, and of a point."""
STUDENT = 1.35
"""Student's quantile of 97.5 % is that of the normal distribution times 1 + 1.35 over the degrees of freedom."""
TINY = 1e-300


class Chips(NamedTuple):
    """Chips of a design: width and decentre in mm (K,); either all are points or none is."""

    width: FloatArray
    offset: FloatArray

    @property
    def are_points(self) -> bool:
        """Whether the chips have no width."""
        return not np.any(self.width > 0.0)


def lattices_for(width: FloatArray, offset: FloatArray, both: bool) -> int:
    """Return the number of lattices that chips (D, K) of designs need; ``both``: mirrored about the axis, too."""
    points = width == 0.0
    if points.all():
        return int(width.shape[1] * SHIFTS_OF_A_POINT * (1 + both))
    if points.any():
        limit = "must be 0 for all chips of a call, or for none"
        raise DesignError("widths_mm", value=0.0, limit=limit, remedy="compute points in a separate call")
    low, high = (offset - 0.5 * width).min(axis=1), (offset + 0.5 * width).max(axis=1)
    whole = 2.0 * np.maximum(np.abs(low), np.abs(high)) if both else high - low
    ends = 2 * width.shape[1] * (1 + both) + both
    if ends > MOST_ENDS:
        rows = np.unique(np.stack([width, offset], axis=1), axis=0)
        needed = max(bins_upto(Chips(*row), ends_of(Chips(*row), both), both)[-1] for row in rows)
    else:
        needed = (BINS_OF_A_CHIP * whole / width.min(axis=1)).max()
    needed = math.ceil(needed - SAME_MM)
    least = max(FEWEST_BINS, ends if ends <= MOST_ENDS else 0)
    return 2 * SHIFTS * math.ceil(float(np.clip(needed, least, MOST_BINS)) / 2)


def ends_of(chips: Chips, both: bool) -> FloatArray:
    """Positions, ascending, where chips begin or end; with ``both`` also their mirror images, and the axis."""
    ends = np.concatenate([chips.offset - 0.5 * chips.width, chips.offset + 0.5 * chips.width])
    ends = np.sort(np.concatenate([ends, [0.0], -ends]) if both else ends)
    return np.asarray(ends[np.append(True, np.diff(ends) > SAME_MM)])


def bins_upto(chips: Chips, ends: FloatArray, both: bool) -> FloatArray:
    """Number of bins required from the first chip end up to each end.

    There are `BINS_OF_A_CHIP` bins for each width of the narrowest chip, or mirror image of one, that covers a
    position; if none does, as few as the widest chip needs.
    """
    offset = np.concatenate([chips.offset, -chips.offset]) if both else chips.offset
    width = np.concatenate([chips.width, chips.width]) if both else chips.width
    middle = 0.5 * (ends[1:] + ends[:-1])
    reached = np.abs(middle[:, None] - offset) < 0.5 * width
    narrowest = np.where(reached, width, width.max()).min(axis=1)
    return np.append(0.0, np.cumsum(BINS_OF_A_CHIP * np.diff(ends) / narrowest))


def distributed(lengths: FloatArray, many: int) -> IntArray:
    """Distribute ``many`` bins among intervals: at least one each, and approximately in proportion to their lengths."""
    shares = np.ones(len(lengths), np.int64)
    for _ in range(many - len(lengths)):
        shares[np.argmax(lengths / shares)] += 1
    return shares


class Places(NamedTuple):
    """Bins of positions, repeated for each lattice, and the weights (K, B) that combine them into chips.

    ``interpolation_error`` (K, B) are the weights for the estimated error of the interpolation.
    """

    bins: Bins
    weights: FloatArray
    interpolation_error: FloatArray
    shifts: int

    @classmethod
    def of(cls, chips: Chips, lattices: int, both: bool) -> "Places":
        """Choose positions for chips; ``both``: symmetric about the axis, so they also serve for the mirror image."""
        if chips.are_points:
            at = np.concatenate([chips.offset, -chips.offset[::-1]]) if both else chips.offset
            own = np.eye(len(chips.offset), len(at))
            return cls._repeated(Bins(at, at), own, np.zeros_like(own), SHIFTS_OF_A_POINT)
        many, ends = lattices // SHIFTS, ends_of(chips, both)
        if len(ends) > min(many + 1, MOST_ENDS):
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
        """Return powers (..., K) of the chips from those by lattice (..., B)."""
        return np.asarray(found @ self.weights.T)

    def u_powers(self, found: FloatArray) -> FloatArray:
        """Return standard errors (..., K) of `powers`, from the differences of the lattices of each bin.

        They are enlarged for their few degrees of freedom (Welch and Satterthwaite's), such that ±2 of them cover 95 %.
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
    """Weights (K, B) of the bins' mean powers for the integral from the first edge up to positions (K,).

    The interpolation is a cubic between edges, with slopes from the neighbouring bins that are exact for cubic powers.
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
    """The same as `cumulative`, with linear interpolation."""
    return np.asarray(np.clip(at[:, None] - edges[:-1], 0.0, np.diff(edges)))


def _slopes(edges: FloatArray) -> FloatArray:
    """Weights (B + 1, B) for the power at each edge: the slope of the quartic through the integrals to five edges."""
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
    """For each angle (A,), whether its opposite is earlier in the list, in which case it need not be traced."""
    return np.array([-angle in angle_deg[:i] for i, angle in enumerate(angle_deg.tolist())], dtype=bool)

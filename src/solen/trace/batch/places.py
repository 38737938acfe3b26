"""From powers by place of an emitter to those of any chip: weights, and how large their error is.

A chip of any width and decentre is a mean over places: a sum over bins of places, with weights that depend on width and
decentre alone. Where chips are few, bins begin and end where chips do, and the sum is exact. Where they are many, the
power up to a place is interpolated between the edges of even bins by cubics; by how much that differs from straight
lines says how far it may be off.

A bin has two lattices of rays, a point eight, each shifted by chance, by itself: how far they are apart is their
standard deviation, and that of a chip follows by its weights.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.arrays import BoolArray, FloatArray, IntArray
from solen.errors import DesignError
from solen.trace.kernel.lots import Bins

FEWEST_BINS, MOST_BINS = 16, 128
BINS_OF_A_CHIP = 16
"""Even bins of the narrowest chip of a call, as far as `MOST_BINS` allow."""
MOST_ENDS = 32
"""Ends of a sensor's chips up to which bins begin and end at all of them."""
SAME_MM = 1e-9
"""Ends nearer than this are one."""
NOT_STRAIGHT = 0.3
"""What cubics may be off by, as a share of how far they are from straight lines."""
SHIFTS, SHIFTS_OF_A_POINT = 2, 8
"""Lattices of a bin, and of a point."""
STUDENT = 1.35
"""Student's quantile of 97.5 % is that of the normal distribution times 1 + 1.35 over the degrees of freedom."""
TINY = 1e-300


class Chips(NamedTuple):
    """Chips of a design: width and decentre in mm (K,); all are points, or none is."""

    width: FloatArray
    offset: FloatArray

    @property
    def are_points(self) -> bool:
        """Whether they have no width."""
        return not np.any(self.width > 0.0)


def lattices_for(width: FloatArray, offset: FloatArray, both: bool) -> int:
    """How many lattices chips (D, K) of designs need; ``both``: they are symmetric about the axis."""
    points = width == 0.0
    if points.all():
        return int(width.shape[1] * SHIFTS_OF_A_POINT * (1 + both))
    if points.any():
        limit = "must be 0 for all chips of a call, or for none"
        raise DesignError("widths_mm", value=0.0, limit=limit, remedy="respond to points in a call of their own")
    low, high = (offset - 0.5 * width).min(axis=1), (offset + 0.5 * width).max(axis=1)
    whole = 2.0 * np.maximum(np.abs(low), np.abs(high)) if both else high - low
    needed = np.ceil(BINS_OF_A_CHIP * whole / width.min(axis=1)).max()
    ends = 2 * width.shape[1] * (1 + both) + both
    least = max(FEWEST_BINS, ends if ends <= MOST_ENDS else 0)
    return 2 * SHIFTS * math.ceil(float(np.clip(needed, least, MOST_BINS)) / 2)


def ends_of(chips: Chips, both: bool) -> FloatArray:
    """Places, ascending, where chips begin or end; with ``both`` their mirror images too, and the axis."""
    ends = np.concatenate([chips.offset - 0.5 * chips.width, chips.offset + 0.5 * chips.width])
    ends = np.sort(np.concatenate([ends, [0.0], -ends]) if both else ends)
    return np.asarray(ends[np.append(True, np.diff(ends) > SAME_MM)])


def shared_out(lengths: FloatArray, many: int) -> IntArray:
    """How many of so many bins each of some stretches gets: at least one, and about as many as it is long."""
    shares = np.ones(len(lengths), np.int64)
    for _ in range(many - len(lengths)):
        shares[np.argmax(lengths / shares)] += 1
    return shares


class Places(NamedTuple):
    """Bins of places, as many times as they have lattices, and the weights (K, B) that make chips of them.

    ``doubt`` (K, B) are the weights of what an interpolation may be off by.
    """

    bins: Bins
    weights: FloatArray
    doubt: FloatArray
    shifts: int

    @classmethod
    def of(cls, chips: Chips, lattices: int, both: bool) -> "Places":
        """Places for chips; ``both``: symmetric about the axis, so that they serve a mirror image too."""
        if chips.are_points:
            at = np.concatenate([chips.offset, -chips.offset[::-1]]) if both else chips.offset
            own = np.eye(len(chips.offset), len(at))
            return cls._repeated(Bins(at, at), own, np.zeros_like(own), SHIFTS_OF_A_POINT)
        many, ends = lattices // SHIFTS, ends_of(chips, both)
        if len(ends) > min(many + 1, MOST_ENDS):
            return cls._interpolated(chips, many, ends)
        shares = shared_out(np.diff(ends[len(ends) // 2 :] if both else ends), many // 2 if both else many)
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
    def _interpolated(cls, chips: Chips, many: int, ends: FloatArray) -> "Places":
        edges = np.linspace(ends[0], ends[-1], many + 1)
        step = edges[1] - edges[0]
        first, last = ((chips.offset + side * 0.5 * chips.width - edges[0]) / step for side in (-1.0, 1.0))
        cubic, straight = (
            (upto(last, many) - upto(first, many)) * (step / chips.width)[:, None] for upto in (cumulative, straightly)
        )
        return cls._repeated(Bins(edges[:-1], edges[1:]), cubic, NOT_STRAIGHT * (cubic - straight), SHIFTS)

    @classmethod
    def _repeated(cls, bins: Bins, weights: FloatArray, doubt: FloatArray, shifts: int) -> "Places":
        each, doubts = (np.repeat(rows, shifts, axis=1) / shifts for rows in (weights, doubt))
        return cls(Bins(*(np.repeat(ends, shifts) for ends in bins)), each, doubts, shifts)

    def powers(self, found: FloatArray) -> FloatArray:
        """Powers (..., K) of the chips from those by lattice (..., B)."""
        return np.asarray(found @ self.weights.T)

    def u_powers(self, found: FloatArray) -> FloatArray:
        """Standard errors (..., K) of `powers`: how far the lattices of a bin are apart.

        They are widened for their few degrees of freedom (Welch and Satterthwaite's), so that two of them hold 95 %.
        """
        freedom = self.shifts - 1
        lattices = [found[..., i :: self.shifts] for i in range(self.shifts)]
        mean = sum(lattices) / self.shifts
        of_bin = sum((lattice - mean) ** 2 for lattice in lattices) / freedom
        squares = self.shifts * self.weights[:, :: self.shifts].T ** 2
        variance = of_bin @ squares
        lacking = (of_bin**2 @ squares**2) / np.maximum(freedom * variance**2, TINY)
        return np.asarray(np.hypot(np.sqrt(variance) * (1.0 + STUDENT * lacking), found @ self.doubt.T))


def cumulative(at: FloatArray, many: int) -> FloatArray:
    """Weights (K, B) that give the cumulative sum over bins up to places (K,), in bins from the first one's edge.

    Between edges a cubic with the slopes that the neighbouring bins give: exact for cubic powers.
    """
    which = np.clip(np.floor(at), 0, many - 1).astype(int)
    s = at - which
    rows = np.arange(len(at))
    sums = (np.arange(many) < which[:, None]).astype(float)
    slopes = _slopes(many)
    sums[rows, which] += s * s * (3.0 - 2.0 * s)
    sums += (s * (1.0 - s) ** 2)[:, None] * slopes[which] - (s * s * (1.0 - s))[:, None] * slopes[which + 1]
    return sums


def straightly(at: FloatArray, many: int) -> FloatArray:
    """As `cumulative`, by straight lines."""
    return np.asarray(np.clip(at[:, None] - np.arange(many), 0.0, 1.0))


def _slopes(many: int) -> FloatArray:
    """Weights (B + 1, B) that give the power at each edge: of four bins about it, at the ends of the nearest four."""
    weights = np.zeros((many + 1, many))
    inner = np.array([-1.0, 7.0, 7.0, -1.0]) / 12.0
    for edge in range(2, many - 1):
        weights[edge, edge - 2 : edge + 2] = inner
    ends = np.array([[25.0, -23.0, 13.0, -3.0], [3.0, 13.0, -5.0, 1.0]]) / 12.0
    for edge in range(2):
        weights[edge, :4] = ends[edge]
        weights[many - edge, many - 4 :] = ends[edge][::-1]
    return weights


def mirrored(found: FloatArray) -> FloatArray:
    """Powers (..., B, 2) of a symmetric sensor at the opposite angle, from symmetric bins."""
    return np.asarray(found[..., ::-1, ::-1])


def are_symmetric(angle_deg: FloatArray) -> BoolArray:
    """Of each angle (A,) whether its opposite is there before it, so that it need not be traced."""
    return np.array([-angle in angle_deg[:i] for i, angle in enumerate(angle_deg.tolist())], dtype=bool)

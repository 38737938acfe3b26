"""One point of a source, whose rays form a one-parameter family, integrated over the launch angle.

The power at a receiver is a function of the launch angle alone. It is smooth wherever neighbouring rays meet the same
interfaces, with jumps in between. The cone is therefore divided into *pieces*, within which all rays have the same tree
of hits, and each piece is integrated by Gauss–Kronrod quadrature, weighted by the intensity. If the emission pattern
has corners, the cone is first divided at these.

Equal trees at both ends of an interval are not sufficient, because a narrow bundle of other rays may lie in between.
Whatever separates two neighbouring rays must begin somewhere: at an end of a curve, or on a curve that lies entirely
between them. An interval is therefore *resolved* only if no curve end lies inside the beam spanned by its two rays, on
any of their segments, or next to a curved face between the points where they meet it. Beyond a caustic two rays need
not span the beam between them, so this is not a proof, and the uncertainty is an estimate. An interval that is not
resolved is halved until its parts are resolved or too narrow to matter; the total width of these gaps, times the full
power of a ray, contributes to the uncertainty. A piece is divided again if a quadrature node turns out to have another
tree.

The quadrature is the (7, 15) pair of Kronrod (1965) as tabulated in QUADPACK, which is also the source of the error
estimate (Piessens et al., 1983). All of this is compiled: see `solen.trace.kernel.tree` and
`solen.trace.kernel.adapt`.
"""

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solen.trace.kernel import adapt
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.tree import SEGMENT_COLUMNS, STACK, Family
from solen.trace.kernel.tree import WIDTH as STACK_WIDTH
from solen.trace.tables import Tables

FIRST_INTERVALS, MIN_INTERVALS = 64, 4
"""Initial number of intervals for a complete cone, and minimum number for the part between two corners of an emission
pattern.
"""
MIN_WIDTH_DEG = 1e-11
"""Width of the narrowest interval that is divided: over a few mm, it corresponds to `solen.curve.END_TOLERANCE_MM`, by
which curves extend beyond their ends.
"""
GAP_FRACTION = 0.01
"""Width below which a gap is initially not divided further, as a fraction of the tolerance times the cone."""
MAX_SEGMENTS = 200_000
MAX_MOVED_SEGMENTS = 20_000_000
"""Number of ray segments after which the search for moved pieces is abandoned; the bisection of an edge takes about
eighty rays.
"""
MIN_PIECE = 1e-10
"""Fraction of the cone below which pieces are ignored: they result from the extension of curves beyond their ends."""
MAX_NEW_GAPS = 1e-11
"""Increase of the gaps between moved pieces, as a fraction of the cone, up to which all pieces count as located."""

# Nodes in [−1, 1] and weights of the Kronrod rule; the Gauss rule uses every second node.
_HALF_NODES = (
    0.991455371120812639206854697526329,
    0.949107912342758524526189684047851,
    0.864864423359769072789712788640926,
    0.741531185599394439863864773280788,
    0.586087235467691130294144838258730,
    0.405845151377397166906606412076961,
    0.207784955007898467600689403773245,
)
_HALF_KRONROD = (
    0.022935322010529224963732008058970,
    0.063092092629978553290700663189204,
    0.104790010322250183839876322541518,
    0.140653259715525918745189590510238,
    0.169004726639267902826583426598550,
    0.190350578064785409913256402421014,
    0.204432940075298892414161999234649,
)
_HALF_GAUSS = (
    0.129484966168869693270611432679082,
    0.279705391489276667901467771423780,
    0.381830050505118944950369775488975,
)
NODES = np.array([-n for n in _HALF_NODES] + [0.0] + list(reversed(_HALF_NODES)))
KRONROD = np.array([*_HALF_KRONROD, 0.209482141084727828012999174891714, *reversed(_HALF_KRONROD)])
GAUSS = np.zeros(15)
GAUSS[1::2] = [*_HALF_GAUSS, 0.417959183673469387755102040816327, *reversed(_HALF_GAUSS)]


RULE = adapt.Rule(NODES, KRONROD, GAUSS)

# The 7-node Kronrod rule, with the 3-node Gauss rule.
_NODES = (0.96049126870802028342, 0.77459666924148337704, 0.43424374934680255800)
_KRONROD = (0.10465622602646726519, 0.26848808986833344073, 0.40139741477596222291)
COARSE = adapt.Rule(
    np.array([*(-node for node in _NODES), 0.0, *reversed(_NODES)]),
    np.array([*_KRONROD, 0.45091653865847414235, *reversed(_KRONROD)]),
    np.array([0.0, 5.0 / 9.0, 0.0, 8.0 / 9.0, 0.0, 5.0 / 9.0, 0.0]),
)
COARSE_TOLERANCE = 1e-5
"""Tolerance at or above which the smaller rule is used for positions and angles: it needs fewer points near kinks."""
DOUBLE = Precision.of(np.float64)
MAX_SAMPLES, MAX_STORED_SEGMENTS, MAX_PENDING = 1 << 15, 1 << 22, 256


class Parts(NamedTuple):
    """Pieces and parts of a cone after integration: the angles of their ends in radians from the axis, and trees."""

    low: np.ndarray
    high: np.ndarray
    tree: np.ndarray
    part_low: np.ndarray
    part_high: np.ndarray
    part_of: np.ndarray

    @classmethod
    def of(cls, pieces: adapt.Pieces, count: int, parts: int, min_width: float) -> "Parts":
        """Return copies of ``count`` pieces and ``parts`` parts, without pieces narrower than ``min_width``."""
        wide = pieces.high[:count] - pieces.low[:count] > min_width
        of_wide = wide[pieces.part_of[:parts]]
        index = np.cumsum(wide) - 1
        low, high, tree = (column[:count][wide] for column in (pieces.low, pieces.high, pieces.tree))
        part_low, part_high = (column[:parts][of_wide] for column in (pieces.part_low, pieces.part_high))
        return cls(low, high, tree, part_low, part_high, index[pieces.part_of[:parts][of_wide]])


class Integral(NamedTuple):
    """Result of an integration.

    ``powers`` (D + 2,) are those at each receiver, followed by the escaped and the absorbed power. ``missed`` and
    ``leaked`` are the parts of the escaped power that, in space, passed above or below the bodies or left through their
    top or bottom. ``error`` is the quadrature error and ``gaps`` the omitted power. All are fractions of the source
    power. ``counts`` contains the numbers of rays, ray segments, undefined rays and pieces.
    """

    powers: np.ndarray
    error: float
    gaps: float
    counts: np.ndarray
    missed: float = 0.0
    leaked: float = 0.0

    @property
    def missing(self) -> float:
        """Power that was not detected, was not absorbed, and did not escape."""
        return max(1.0 - math.fsum(self.powers.tolist()), 0.0)

    @property
    def unfinished(self) -> float:
        """Power of branches that were not followed to their ends."""
        return max(self.missing - self.gaps, 0.0)

    @property
    def u(self) -> float:
        """Uncertainty of each power: the quadrature error, plus the gaps or all missing power, whichever is larger."""
        return min(self.error + max(self.gaps, self.missing), 1.0)


def weighted_sum(integrals: Sequence[Integral], weights: Sequence[float]) -> Integral:
    """Return the weighted sum of integrals."""
    pairs = list(zip(integrals, weights, strict=True))
    return Integral(
        powers=np.sum([weight * part.powers for part, weight in pairs], axis=0),
        error=math.fsum(weight * part.error for part, weight in pairs),
        gaps=math.fsum(weight * part.gaps for part, weight in pairs),
        counts=np.sum([part.counts for part in integrals], axis=0),
        missed=math.fsum(weight * part.missed for part, weight in pairs),
        leaked=math.fsum(weight * part.leaked for part, weight in pairs),
    )


@dataclass(frozen=True, eq=False)
class Cone:
    """One point of a source at one wavelength: its rays, in angle intervals over which their intensity is smooth.

    ``total`` is the integral of the intensity, ``columns`` the number of values per ray.
    """

    tables: Tables
    ends: np.ndarray
    columns: int
    families: tuple[Family, ...]
    total: float

    def integral(self, tolerance: float, max_segments: int, parts: list[Parts] | None = None) -> Integral:
        """Divide the cone into pieces and integrate them; append the pieces to ``parts``, if given."""
        width = math.fsum(family.high - family.low for family in self.families)
        integrals = [self._interval(family, width, tolerance, max_segments, parts) for family in self.families]
        return integrals[0] if len(integrals) == 1 else weighted_sum(integrals, [1.0] * len(integrals))

    def _interval(
        self, family: Family, width: float, tolerance: float, max_segments: int, stored_parts: list[Parts] | None
    ) -> Integral:
        """Return the integral over one interval of angles, as a fraction of the source power."""
        samples, pieces = buffers_of(max_segments, self.columns)
        sums, narrowest = np.zeros(self.columns), math.radians(MIN_WIDTH_DEG)
        interval = family.high - family.low
        max_intensity = max(abs(family.base + family.slope * family.low), abs(family.base + family.slope * family.high))
        density, fraction = 0.25 * tolerance * (self.total / width), interval / width
        error, gaps, parts = adapt.integrate_cone(
            DOUBLE, self.tables, family, samples, pieces, self.ends, RULE, density,
            max(GAP_FRACTION * tolerance * self.total / max_intensity, narrowest), narrowest,
            0.5 * tolerance * self.total * fraction / max_intensity,
            max(math.ceil(FIRST_INTERVALS * fraction), MIN_INTERVALS), max_segments,
            np.zeros((len(NODES) + 1, self.columns)), sums,
        )  # fmt: skip
        if stored_parts is not None:
            stored_parts.append(Parts.of(pieces, int(samples.counts[adapt.PIECES]), parts, MIN_PIECE * interval))
        counts = samples.counts[[adapt.RAYS, adapt.ALL_SEGMENTS, adapt.UNDEFINED, adapt.PIECES]]
        return Integral(sums / self.total, error / self.total, gaps * max_intensity / self.total, counts)

    def moved(self, parts_of_families: Sequence[Parts]) -> np.ndarray | None:
        """Return the powers (D + 2,) of a slightly changed point over the same pieces; None if a piece is not found."""
        sums = np.zeros(self.columns)
        for family, parts in zip(self.families, parts_of_families, strict=True):
            powers = self._moved_interval(family, parts)
            if powers is None:
                return None
            sums += powers
        return sums / self.total

    def _moved_interval(self, family: Family, parts: Parts) -> np.ndarray | None:
        samples, pieces = buffers_of(MAX_SEGMENTS, self.columns)
        samples.counts[:] = 0
        for name in Parts._fields:
            getattr(pieces, name)[: len(getattr(parts, name))] = getattr(parts, name)
        sums, interval = np.zeros(self.columns), family.high - family.low
        gaps, located = adapt.reintegrate(
            DOUBLE, self.tables, family, samples, pieces, len(parts.low), len(parts.part_low), RULE, MAX_MOVED_SEGMENTS,
            np.zeros((len(NODES) + 1, self.columns)), sums,
        )  # fmt: skip
        widths_before = interval - float(np.sum(parts.high - parts.low))
        return sums if located and gaps <= widths_before + MAX_NEW_GAPS * interval else None


class _Buffers(threading.local):
    """Working memory of each thread, keyed by size."""

    def __init__(self) -> None:
        self.by_size: dict[tuple[int, int], tuple[adapt.Samples, adapt.Pieces]] = {}


_BUFFERS = _Buffers()


def buffers_of(max_segments: int, columns: int) -> tuple[adapt.Samples, adapt.Pieces]:
    """Return the working memory of this thread, which each call reuses."""
    by_size = _BUFFERS.by_size
    if (max_segments, columns) not in by_size:
        by_size.clear()
        by_size[max_segments, columns] = _new_buffers(max_segments, columns)
    return by_size[max_segments, columns]


def _new_buffers(max_segments: int, columns: int) -> tuple[adapt.Samples, adapt.Pieces]:
    """Allocate working memory; unused pages do not occupy physical memory."""
    n = MAX_SAMPLES

    def ints() -> np.ndarray:
        return np.empty(n, np.int64)

    def floats() -> np.ndarray:
        return np.empty(n)

    samples = adapt.Samples(
        angle=floats(),
        tree=np.empty(n, np.uint64),
        first_segment=ints(),
        segment_count=ints(),
        following=ints(),
        resolved=np.empty(n, np.bool_),
        segments=np.empty((min(max_segments, MAX_STORED_SEGMENTS), SEGMENT_COLUMNS)),
        pending=ints(),
        value=np.empty(columns),
        stack=np.empty((STACK, STACK_WIDTH)),
        counts=np.zeros(6, np.int64),
    )
    pieces = adapt.Pieces(
        low=floats(),
        high=floats(),
        tree=np.empty(n, np.uint64),
        first=ints(),
        part_low=floats(),
        part_high=floats(),
        part_of=ints(),
        waiting=np.empty((MAX_PENDING, 2)),
    )
    return samples, pieces

"""One point of a source: its rays are a one-parameter family, to be integrated over the launch angle.

What a receiver gets is a function of the launch angle alone, smooth wherever neighbouring rays meet the same
interfaces, with jumps in between. So the cone is cut into *pieces* of one and the same tree of hits, and each piece is
integrated by Gauss–Kronrod quadrature, weighted by the intensity. A pattern with corners is cut at them first.

Equal trees at both ends of a stretch prove nothing: a sliver of other rays may lie between. What could separate two
neighbouring rays must start somewhere, at an end of a curve or on a curve that is wholly between them; so a stretch is
whole only if no end of any curve lies inside the beam its two rays span, at any of their straight legs, nor next to a
curved face between their ends. Past a caustic two rays need not span the beam between them: this is not a proof, and
the uncertainty is an estimate. A stretch that is not whole is halved, until it is or is too narrow to matter; the
width of all such gaps, times all that a ray carries, goes into the uncertainty. Nodes of the quadrature that turn out
to have another tree send the piece back.

The idea of bisecting the jumps is that of any adaptive integrator; the quadrature is the (7, 15) pair of Kronrod (1965)
as tabulated in QUADPACK, and so is the estimate of its error (Piessens et al., 1983). All of it is compiled: see
`solen.trace.kernel.tree` and `solen.trace.kernel.adapt`.
"""

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solen.trace.kernel import adapt
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.tree import LEG_COLUMNS, STACK, Family
from solen.trace.kernel.tree import WIDTH as STACK_WIDTH
from solen.trace.tables import Tables

FIRST_STRETCHES, LEAST_STRETCHES = 64, 4
"""Stretches that a whole cone is divided into at first, and at least a part of it between two corners of a pattern."""
NARROWEST_DEG = 1e-11
"""Where cutting ends at the latest: over a few mm, what `solen.curve.END_TOLERANCE_MM` leaves undecided at a corner."""
GAP_SHARE = 0.01
"""How wide, as a share of the tolerance times the cone, a gap may be that is not cut on at first."""
MOST_LEGS = 200_000
MOST_LEGS_AGAIN = 20_000_000
"""Straight stretches after which pieces count as lost: each edge is bisected, which takes some eighty rays."""
SLIVER = 1e-10
"""Share of the cone below which a piece comes from how far curves reach beyond their ends, and is not followed."""
NEW_GAPS = 1e-11
"""Share of the cone that may be left between pieces found again, beyond what was left between them before."""

# Nodes in [−1, 1] and weights of the Kronrod rule, and of the Gauss rule on every second node.
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

# Kronrod's rule of 7 nodes, with the Gauss rule of 3.
_NODES = (0.96049126870802028342, 0.77459666924148337704, 0.43424374934680255800)
_KRONROD = (0.10465622602646726519, 0.26848808986833344073, 0.40139741477596222291)
COARSE = adapt.Rule(
    np.array([*(-node for node in _NODES), 0.0, *reversed(_NODES)]),
    np.array([*_KRONROD, 0.45091653865847414235, *reversed(_KRONROD)]),
    np.array([0.0, 5.0 / 9.0, 0.0, 8.0 / 9.0, 0.0, 5.0 / 9.0, 0.0]),
)
COARSE_TOLERANCE = 1e-5
"""Tolerance from which on the smaller rule serves for places and angles: bends are found with fewer points."""
DOUBLE = Precision.of(np.float64)
MOST_SAMPLES, MOST_KEPT_LEGS, MOST_WAITING = 1 << 15, 1 << 22, 256


class Parts(NamedTuple):
    """How a stretch of angles was cut and integrated: the angles (radians from the axis) that it was cut at."""

    low: np.ndarray
    high: np.ndarray
    tree: np.ndarray
    part_low: np.ndarray
    part_high: np.ndarray
    part_of: np.ndarray

    @classmethod
    def of(cls, pieces: adapt.Pieces, many: int, parts: int, sliver: float) -> "Parts":
        """Copies of what was found, without pieces narrower than a sliver."""
        wide = pieces.high[:many] - pieces.low[:many] > sliver
        kept = wide[pieces.part_of[:parts]]
        number = np.cumsum(wide) - 1
        low, high, tree = (column[:many][wide] for column in (pieces.low, pieces.high, pieces.tree))
        part_low, part_high = (column[:parts][kept] for column in (pieces.part_low, pieces.part_high))
        return cls(low, high, tree, part_low, part_high, number[pieces.part_of[:parts][kept]])


class Integral(NamedTuple):
    """Result of an integration.

    ``share`` (D + 2,) is the power by receiver, escaped and absorbed; ``missed`` and ``leaked`` are of what escaped in
    space, above and below the bodies and from them; ``error`` what the quadrature may be off by and
    ``gaps`` what was left out, all as fractions of the power of the source; ``counts`` are rays, straight stretches,
    undefined rays and pieces.
    """

    share: np.ndarray
    error: float
    gaps: float
    counts: np.ndarray
    missed: float = 0.0
    leaked: float = 0.0

    @property
    def missing(self) -> float:
        """Power that is at no receiver, did not escape and was not absorbed."""
        return max(1.0 - math.fsum(self.share.tolist()), 0.0)

    @property
    def unfinished(self) -> float:
        """Power of branches that were not followed to their ends."""
        return max(self.missing - self.gaps, 0.0)

    @property
    def u(self) -> float:
        """Uncertainty of every power: errors, and gaps or anything else that was not followed."""
        return min(self.error + max(self.gaps, self.missing), 1.0)


def weighted_sum(integrals: Sequence[Integral], weights: Sequence[float]) -> Integral:
    """Weighted sum of what was found."""
    pairs = list(zip(integrals, weights, strict=True))
    return Integral(
        share=np.sum([weight * part.share for part, weight in pairs], axis=0),
        error=math.fsum(weight * part.error for part, weight in pairs),
        gaps=math.fsum(weight * part.gaps for part, weight in pairs),
        counts=np.sum([part.counts for part in integrals], axis=0),
        missed=math.fsum(weight * part.missed for part, weight in pairs),
        leaked=math.fsum(weight * part.leaked for part, weight in pairs),
    )


@dataclass(frozen=True, eq=False)
class Cone:
    """One point of a source in one colour: its rays, in stretches of angles over which their intensity is smooth.

    ``whole`` is the integral of the intensity, ``columns`` how many numbers a ray gives.
    """

    tables: Tables
    ends: np.ndarray
    columns: int
    families: tuple[Family, ...]
    whole: float

    def integral(self, tolerance: float, most_legs: int, parts: list[Parts] | None = None) -> Integral:
        """Cut and integrate; ``parts`` takes how it was cut, if given."""
        width = math.fsum(family.high - family.low for family in self.families)
        found = [self._stretch(family, width, tolerance, most_legs, parts) for family in self.families]
        return found[0] if len(found) == 1 else weighted_sum(found, [1.0] * len(found))

    def _stretch(
        self, family: Family, width: float, tolerance: float, most_legs: int, kept: list[Parts] | None
    ) -> Integral:
        """One stretch: its part of the source's power."""
        samples, pieces = room(most_legs, self.columns)
        total, narrowest = np.zeros(self.columns), math.radians(NARROWEST_DEG)
        here = family.high - family.low
        most = max(abs(family.base + family.slope * family.low), abs(family.base + family.slope * family.high))
        density, share = 0.25 * tolerance * (self.whole / width), here / width
        error, gaps, parts = adapt.integrate_cone(
            DOUBLE, self.tables, family, samples, pieces, self.ends, RULE, density,
            max(GAP_SHARE * tolerance * self.whole / most, narrowest), narrowest,
            0.5 * tolerance * self.whole * share / most, max(math.ceil(FIRST_STRETCHES * share), LEAST_STRETCHES),
            most_legs, np.zeros((len(NODES) + 1, self.columns)), total,
        )  # fmt: skip
        if kept is not None:
            kept.append(Parts.of(pieces, int(samples.counts[adapt.PIECES]), parts, SLIVER * here))
        counts = samples.counts[[adapt.RAYS, adapt.ALL_LEGS, adapt.UNDEFINED, adapt.PIECES]]
        return Integral(total / self.whole, error / self.whole, gaps * most / self.whole, counts)

    def again(self, before: Sequence[Parts]) -> np.ndarray | None:
        """Powers (D + 2,) of this point over the pieces of another one that differs a little; None if they are lost."""
        total = np.zeros(self.columns)
        for family, parts in zip(self.families, before, strict=True):
            found = self._stretch_again(family, parts)
            if found is None:
                return None
            total += found
        return total / self.whole

    def _stretch_again(self, family: Family, parts: Parts) -> np.ndarray | None:
        samples, pieces = room(MOST_LEGS, self.columns)
        samples.counts[:] = 0
        for name in Parts._fields:
            getattr(pieces, name)[: len(getattr(parts, name))] = getattr(parts, name)
        total, here = np.zeros(self.columns), family.high - family.low
        gaps, found = adapt.integrate_again(
            DOUBLE, self.tables, family, samples, pieces, len(parts.low), len(parts.part_low), RULE, MOST_LEGS_AGAIN,
            np.zeros((len(NODES) + 1, self.columns)), total,
        )  # fmt: skip
        widths_before = here - float(np.sum(parts.high - parts.low))
        return total if found and gaps <= widths_before + NEW_GAPS * here else None


class _Rooms(threading.local):
    """Working memory of each thread, by its size."""

    def __init__(self) -> None:
        self.rooms: dict[tuple[int, int], tuple[adapt.Samples, adapt.Pieces]] = {}


_ROOMS = _Rooms()


def room(most_legs: int, columns: int) -> tuple[adapt.Samples, adapt.Pieces]:
    """Room to integrate in, the same for every call of a thread: what is in it does not outlive the next one."""
    rooms = _ROOMS.rooms
    if (most_legs, columns) not in rooms:
        rooms.clear()
        rooms[most_legs, columns] = _room(most_legs, columns)
    return rooms[most_legs, columns]


def _room(most_legs: int, columns: int) -> tuple[adapt.Samples, adapt.Pieces]:
    """New room; untouched memory costs nothing."""
    n = MOST_SAMPLES

    def whole() -> np.ndarray:
        return np.empty(n, np.int64)

    def real() -> np.ndarray:
        return np.empty(n)

    samples = adapt.Samples(
        angle=real(),
        tree=np.empty(n, np.uint64),
        first=whole(),
        many=whole(),
        after=whole(),
        whole=np.empty(n, np.bool_),
        legs=np.empty((min(most_legs, MOST_KEPT_LEGS), LEG_COLUMNS)),
        open=whole(),
        value=np.empty(columns),
        stack=np.empty((STACK, STACK_WIDTH)),
        counts=np.zeros(6, np.int64),
    )
    pieces = adapt.Pieces(
        low=real(),
        high=real(),
        tree=np.empty(n, np.uint64),
        first=whole(),
        part_low=real(),
        part_high=real(),
        part_of=whole(),
        waiting=np.empty((MOST_WAITING, 2)),
    )
    return samples, pieces

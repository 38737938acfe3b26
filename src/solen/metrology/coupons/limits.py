"""What a coupon shows of a printer and a resin: the smallest features that it resolves, as the Methods define them.

The paper's fidelity parts are "used to extract: (i) the minimum resolvable XY feature size for raised elements, (ii)
the minimum XY separation required to avoid feature merging, (iii) the minimum resolvable diameter variation for
recessed features, and (iv) the minimum reproducible Z step". Here each becomes a rule that needs no judgement:

- (i) the smallest nominal diameter at which a pillar stands, all larger ones standing too. The printed diameter of that
  pillar is beside it: it is what the paper calls the resolvable size, and no nominal one.
- (ii) the smallest nominal gap that is open, all larger ones being open too; and so for holes.
- (iii) the smallest nominal difference of diameter at which any two holes so far or farther apart come out in their
  order, each by more than chance lets equal holes differ: the scatter of the printed diameters about a straight line of
  the nominal ones, or the uncertainty of measuring where that is more, by Student's t, 5 % shared among the pairs
  (Bonferroni). Two holes of one nominal size belong to the scatter.
- (iv) the smallest nominal step at which every step of that size, and of all larger ones, is a rise that is not chance,
  one-sided by Welch's t, 5 % shared among the steps of that size.

A limit is a bound where the coupon's smallest feature is resolved, and is none where its largest is not. The next
smaller feature, which is not resolved, stands beside: the truth lies between.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.stats import t as student

LEVEL = 0.05
SAME_MM = 1e-6
FEWEST_HOLES = 4


@dataclass(frozen=True)
class Measured:
    """A feature, a gap or a step: what was asked for and what came out.

    Attributes
    ----------
    name, kind
        Of the layout; ``kind`` is ``pillar``, ``hole``, ``gap``, ``step`` or ``mark``.
    nominal_mm
        Diameter, width of the gap, or rise of the step.
    measured_mm, u_mm
        The same as it was found, and its standard uncertainty; None where there is nothing to measure.
    resolved
        Whether it stands, is open, or is a rise; None where the picture cannot tell.
    reason
        Why it is not resolved, or cannot be told.
    """

    name: str
    kind: str
    nominal_mm: float
    measured_mm: float | None
    u_mm: float | None
    resolved: bool | None
    reason: str = ""


@dataclass(frozen=True)
class Limit:
    """The smallest of something that is resolved.

    Attributes
    ----------
    kind
        ``positive_diameter``, ``gap``, ``hole``, ``hole_variation`` or ``z_step``.
    nominal_mm
        The smallest resolved; None where not even the largest is.
    measured_mm, u_mm
        What came out at that nominal size, and its standard uncertainty.
    next_mm
        The next smaller one, which is not resolved or cannot be told; None where there is none.
    bound
        Whether the coupon holds none smaller that could fail, so that the limit may be smaller still.
    """

    kind: str
    nominal_mm: float | None
    measured_mm: float | None
    u_mm: float | None
    next_mm: float | None
    bound: bool


def smallest(kind: str, measured: Sequence[Measured]) -> Limit | None:
    """Limits (i), (ii) and of open holes: walk from the largest nominal size down to the first that is not resolved.

    None where there is nothing of the kind in the picture.
    """
    seen = [one for one in measured if one.resolved is not None or one.reason != OUTSIDE]
    if not seen:
        return None
    last: Measured | None = None
    sizes = sorted({one.nominal_mm for one in seen}, reverse=True)
    for size in sizes:
        some = [one for one in seen if one.nominal_mm == size]
        if not all(one.resolved for one in some):
            told = any(one.resolved is False for one in some)
            return _limit(kind, last, size, bound=last is not None and not told)
        last = some[0]
    return _limit(kind, last, None, bound=True)


OUTSIDE = "not in the picture"


def _limit(kind: str, last: Measured | None, after: float | None, *, bound: bool) -> Limit:
    if last is None:
        return Limit(kind, None, None, None, after, bound)
    return Limit(kind, last.nominal_mm, last.measured_mm, last.u_mm, after, bound)


def hole_variation(holes: Sequence[Measured]) -> Limit | None:
    """Limit (iii); None for fewer than four measured holes or of one size only."""
    some = [one for one in holes if one.resolved and one.measured_mm is not None and one.u_mm is not None]
    nominal = np.array([one.nominal_mm for one in some])
    if len(some) < FEWEST_HOLES or np.ptp(nominal) < SAME_MM:
        return None
    found = np.array([one.measured_mm for one in some], dtype=float)
    slope, offset = np.polyfit(nominal, found, 1)
    rest = found - slope * nominal - offset
    freedom = len(some) - 2
    scatter = math.sqrt(float(np.sum(rest**2)) / freedom)
    own = float(np.sqrt(np.mean(np.array([one.u_mm for one in some], dtype=float) ** 2)))
    u_pair = math.sqrt(2.0) * max(scatter, own)
    pairs = [(i, k) for i, k in combinations(range(len(some)), 2) if abs(nominal[i] - nominal[k]) > SAME_MM]
    needed = float(student.ppf(1.0 - LEVEL / len(pairs), freedom)) * u_pair
    by_size: dict[float, list[float]] = {}
    for i, k in pairs:
        low, high = (i, k) if nominal[i] < nominal[k] else (k, i)
        by_size.setdefault(round(float(nominal[high] - nominal[low]), 6), []).append(float(found[high] - found[low]))
    last: tuple[float, float] | None = None
    for size in sorted(by_size, reverse=True):
        if min(by_size[size]) <= needed:
            break
        last = (size, float(np.mean(by_size[size])))
    else:
        size = 0.0
    if last is None:
        return Limit("hole_variation", None, None, None, size, bound=False)
    return Limit("hole_variation", last[0], last[1], u_pair, size or None, bound=size == 0.0)


def z_step(steps: Sequence[Measured]) -> Limit | None:
    """Limit (iv), from steps that were each told a rise or none; None where none was measured."""
    seen = [one for one in steps if one.resolved is not None]
    if not seen:
        return None
    last: tuple[float, list[Measured]] | None = None
    for size in sorted({round(one.nominal_mm, 6) for one in seen}, reverse=True):
        some = [one for one in seen if abs(one.nominal_mm - size) < SAME_MM]
        if not all(one.resolved for one in some):
            return _step(last, size)
        last = (size, some)
    return _step(last, None)


def _step(last: tuple[float, list[Measured]] | None, after: float | None) -> Limit:
    """Limit with the mean of the steps of that size, and its standard uncertainty from their scatter or their own."""
    if last is None:
        return Limit("z_step", None, None, None, after, bound=False)
    rises = np.array([one.measured_mm for one in last[1]], dtype=float)
    own = np.array([one.u_mm for one in last[1]], dtype=float)
    count = len(rises)
    scatter = float(np.std(rises, ddof=1)) / math.sqrt(count) if count > 1 else 0.0
    u_mean = max(scatter, float(np.sqrt(np.sum(own**2))) / count)
    return Limit("z_step", last[0], float(rises.mean()), u_mean, after, bound=after is None)


def rise_by_chance(rise: float, u_low: float, u_high: float, freedom: float) -> float:
    """Probability of so large a rise of the mean where there is none: Welch's t, one-sided."""
    u = math.hypot(u_low, u_high)
    if u == 0.0:
        return 0.0 if rise > 0.0 else 1.0
    a, b = (u_low / u) ** 2, (u_high / u) ** 2
    return float(student.sf(rise / u, freedom / max(a * a + b * b, 1e-12)))

"""Limits of a printer and a resin from a coupon: the smallest resolved features, as defined in the paper's Methods.

The paper's fidelity parts are "used to extract: (i) the minimum resolvable XY feature size for raised elements, (ii)
the minimum XY separation required to avoid feature merging, (iii) the minimum resolvable diameter variation for
recessed features, and (iv) the minimum reproducible Z step". Here each becomes a rule that requires no judgement:

- (i) the smallest nominal diameter for which this pillar and all larger ones stand. The printed diameter of that
  pillar is reported with it: the paper's resolvable size is a printed diameter, not a nominal one.
- (ii) the smallest nominal gap for which this and every larger gap is open; the same rule applies to holes.
- (iii) the smallest nominal diameter difference for which any two holes that differ by this much or more are printed
  in the right order with statistical significance. The scatter of the printed diameters about a straight-line fit to
  the nominal ones, or the measurement uncertainty if that is larger, is compared by Student's t with 5 % shared among
  the pairs (Bonferroni). Two holes of the same nominal size contribute to the scatter.
- (iv) the smallest nominal step for which every step of this and of every larger size is a significant rise, by a
  one-sided Welch's t-test with 5 % shared among the steps of that size.

A limit is only an upper bound if the coupon's smallest feature is resolved, and does not exist if the largest is not.
The next smaller feature, which is not resolved, is reported too: the true limit is between the two.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.stats import t as student

SIGNIFICANCE = 0.05
"""Significance level of the tests."""
SAME_MM = 1e-6
"""Difference below which nominal sizes are equal."""
MIN_HOLES = 4
OUTSIDE = "not in the image"


@dataclass(frozen=True)
class MeasuredSize:
    """A feature, a gap or a step with its nominal and its measured size.

    Attributes
    ----------
    name, kind
        Name and kind in the layout; ``kind`` is ``pillar``, ``hole``, ``gap``, ``step`` or ``mark``.
    nominal_mm
        Diameter, width of the gap, or rise of the step.
    measured_mm, u_measured_mm
        The measured value and its standard uncertainty; None if there is nothing to measure.
    resolved
        Whether the pillar stands, the gap or hole is open, or the step is resolved; None if the image does not show it
        well enough.
    reason
        Reason why it is unresolved or undecided.
    diameter_mm
        Nominal diameter of the pillars of a gap.
    u_own_mm
        Standard uncertainty without that of the scale, which is common to all features of an image.
    """

    name: str
    kind: str
    nominal_mm: float
    measured_mm: float | None = None
    u_measured_mm: float | None = None
    resolved: bool | None = None
    reason: str = ""
    diameter_mm: float | None = None
    u_own_mm: float | None = None


@dataclass(frozen=True)
class Limit:
    """The smallest resolved size of a kind of feature.

    Attributes
    ----------
    kind
        ``positive_diameter``, ``gap``, ``hole``, ``hole_variation`` or ``z_step``.
    nominal_mm
        The smallest resolved nominal size; None if not even the largest is resolved.
    measured_mm, u_measured_mm
        Measured size at that nominal size, and its standard uncertainty.
    next_mm
        The next smaller nominal size, which is unresolved or undecided; None if there is none.
    bound
        Whether the coupon has no smaller feature that could fail, in which case the limit may be smaller.
    """

    kind: str
    nominal_mm: float | None = None
    measured_mm: float | None = None
    u_measured_mm: float | None = None
    next_mm: float | None = None
    bound: bool = False


def limits_of(measured: Sequence[MeasuredSize]) -> tuple[Limit, ...]:
    """Return the limits of all kinds that were measured."""
    by_kind = {
        kind: [feature for feature in measured if feature.kind == kind] for kind in ("pillar", "gap", "hole", "step")
    }
    sizes = {pillar.nominal_mm for pillar in by_kind["pillar"]}
    limits = [
        smallest("positive_diameter", by_kind["pillar"]) if len(sizes) > 1 else None,
        smallest("gap", by_kind["gap"]),
        smallest("hole", by_kind["hole"]),
        hole_variation(by_kind["hole"]),
        z_step(by_kind["step"]),
    ]
    return tuple(limit for limit in limits if limit is not None)


def smallest(kind: str, measured: Sequence[MeasuredSize]) -> Limit | None:
    """Return limit (i), (ii) or that of open holes: the smallest size at or above which all features are resolved.

    Return None if the image shows no feature of the kind.
    """
    visible = [feature for feature in measured if feature.resolved is not None or feature.reason != OUTSIDE]
    if not visible:
        return None
    limit = Limit(kind)
    for size in sorted({feature.nominal_mm for feature in visible}, reverse=True):
        group = [feature for feature in visible if feature.nominal_mm == size]
        if not all(feature.resolved for feature in group):
            failed = any(feature.resolved is False for feature in group)
            return replace(limit, next_mm=size, bound=limit.nominal_mm is not None and not failed)
        limit = Limit(kind, size, group[0].measured_mm, group[0].u_measured_mm)
    return replace(limit, bound=True)


def hole_variation(holes: Sequence[MeasuredSize]) -> Limit | None:
    """Return limit (iii), or None for fewer than four measured holes or for holes of a single size."""
    rows = [
        (hole.nominal_mm, hole.measured_mm, hole.u_measured_mm)
        for hole in holes
        if hole.resolved and hole.measured_mm is not None and hole.u_measured_mm is not None
    ]
    nominal, measured, u_each = np.array(rows, dtype=float).reshape(-1, 3).T
    if len(rows) < MIN_HOLES or np.ptp(nominal) < SAME_MM:
        return None
    slope, offset = np.polyfit(nominal, measured, 1)
    freedom = len(rows) - 2
    scatter = math.sqrt(float(np.sum((measured - slope * nominal - offset) ** 2)) / freedom)
    u_pair = math.sqrt(2.0) * max(scatter, float(np.sqrt(np.mean(u_each**2))))
    pairs = [(i, k) for i, k in permutations(range(len(rows)), 2) if nominal[k] - nominal[i] > SAME_MM]
    min_difference = float(student.ppf(1.0 - SIGNIFICANCE / len(pairs), freedom)) * u_pair
    by_size: dict[float, list[float]] = {}
    for low, high in pairs:
        by_size.setdefault(round(float(nominal[high] - nominal[low]), 6), []).append(measured[high] - measured[low])
    limit = Limit("hole_variation")
    for size in sorted(by_size, reverse=True):
        if min(by_size[size]) <= min_difference:
            return replace(limit, next_mm=size)
        limit = Limit("hole_variation", size, float(np.mean(by_size[size])), u_pair)
    return replace(limit, bound=True)


def z_step(steps: Sequence[MeasuredSize]) -> Limit | None:
    """Return limit (iv) from the significance of the steps, or None if no step was measured."""
    measured = [step for step in steps if step.resolved is not None]
    if not measured:
        return None
    limit = Limit("z_step")
    for size in sorted({round(step.nominal_mm, 6) for step in measured}, reverse=True):
        group = [step for step in measured if abs(step.nominal_mm - size) < SAME_MM]
        if not all(step.resolved for step in group):
            return replace(limit, next_mm=size)
        limit = _mean_step(size, group)
    return replace(limit, bound=True)


def _mean_step(size: float, group: Sequence[MeasuredSize]) -> Limit:
    """Return the limit for steps of one size, with their mean; u of the mean is at least that from the scatter."""
    rises = np.array([step.measured_mm for step in group], dtype=float)
    u_rises = np.array([step.u_measured_mm for step in group], dtype=float)
    count = len(rises)
    scatter = float(np.std(rises, ddof=1)) / math.sqrt(count) if count > 1 else 0.0
    return Limit("z_step", size, float(rises.mean()), max(scatter, float(np.sqrt(np.sum(u_rises**2))) / count))


def rise_by_chance(rise: float, u_low: float, u_high: float, freedom: float) -> float:
    """Return the probability that a mean rise of at least ``rise`` occurs by chance (one-sided Welch's t-test)."""
    u = math.hypot(u_low, u_high)
    if u == 0.0:
        return 0.0 if rise > 0.0 else 1.0
    a, b = (u_low / u) ** 2, (u_high / u) ** 2
    return float(student.sf(rise / u, freedom / max(a * a + b * b, 1e-12)))

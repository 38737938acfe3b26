"""Loading, unloading, and the energy loss in a cyclic test.

A test is a sequence of branches between turning points of the strain. A swing counts as a branch once it exceeds a
fraction of the strain range, so that noise does not. In each cycle, a loading and an unloading, the specimen absorbs
work, returns part of it, and retains a residual strain; rubbers lose most in the first cycle (Mullins softening; Diani,
Fayolle & Gilormini 2009), so the first and last cycles are compared. Cycles of the same specimen are not replicates:
they show how the specimen changes, not how specimens differ.

A fit should not depend on the sampling rate of the machine: a loading branch is averaged into steps of equal stretch,
and ends at its largest stress. A branch of a later cycle starts at the residual strain of the earlier cycles, at which
the specimen has a different length and area; stress and stretch are computed from these (incompressible, so the area
shrinks as the length grows).

`branches` and `loading_branch` divide a test, `cycles_of` returns its cycles with their energies, and `softening`
compares them; `loading_curve` prepares a model fit, and `rereferenced` counts a test from the end of its earlier
cycles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.stiffness.hyperelastic import Curve
from solen.material.stiffness.stress_strain import StressStrain
from solen.results import HIDDEN, reported

SWING = 0.1
"""Fraction of the strain range that a reversal must exceed."""
MAX_FIT_POINTS = 50
"""Largest number of points on a curve used for fitting."""
_UNLOADED = (0.01, 0.05)  # fractions of the first cycle's peak stress


@dataclass(frozen=True)
class Cycle:
    """A loading and the unloading after it.

    Attributes
    ----------
    number
        Number of the cycle, from 1.
    start, peak, end
        First row, turning point and last row of the cycle in the test.
    peak_strain, peak_stress_MPa
        Strain at the turning point and largest stress in the cycle, as magnitudes.
    stress_at_half_MPa
        Stress on loading at half of the first cycle's peak strain; None if the cycle does not reach it.
    work_in_mJ_per_mm3, work_out_mJ_per_mm3
        Work absorbed and returned per initial volume; None if not recorded (no unloading).
    residual_strain
        Strain at which a line through the end of the unloading, from 5 to 1 % of the first peak stress, reaches zero
        stress; None if unloading was not recorded down to 1 %.
    """

    number: int
    start: int = field(metadata=HIDDEN)
    peak: int = field(metadata=HIDDEN)
    end: int = field(metadata=HIDDEN)
    peak_strain: float
    peak_stress_MPa: float
    stress_at_half_MPa: float | None
    work_in_mJ_per_mm3: float
    work_out_mJ_per_mm3: float | None
    residual_strain: float | None

    @reported
    def dissipated_mJ_per_mm3(self) -> float | None:
        """Hysteresis: the work absorbed but not returned."""
        return None if self.work_out_mJ_per_mm3 is None else self.work_in_mJ_per_mm3 - self.work_out_mJ_per_mm3

    @reported
    def loss_fraction(self) -> float | None:
        """Ratio of the hysteresis to the work absorbed."""
        lost = self.dissipated_mJ_per_mm3
        return None if lost is None or self.work_in_mJ_per_mm3 <= 0 else lost / self.work_in_mJ_per_mm3


@dataclass(frozen=True)
class Softening:
    """Fractional decrease, first to last cycle, of the stress at peak and at half strain, and of the work."""

    cycles: int
    peak_stress: float
    stress_at_half: float | None
    work_in: float


def branches(strain: FloatArray, swing: float = SWING) -> list[tuple[int, int]]:
    """Return the rows (first, last) of the branches between turning points, in order.

    Parameters
    ----------
    strain
        Strains, shape (n,); only the reversals matter.
    swing
        Fraction of the strain's range that a reversal must exceed to count.
    """
    least = swing * float(np.ptp(strain))
    turns = np.flatnonzero(np.diff(np.sign(np.diff(strain))) != 0) + 1
    rows = np.unique(np.concatenate([[0], turns, [len(strain) - 1]]))
    kept, rising = [0], 0
    for row in rows[1:]:
        step = float(strain[row] - strain[kept[-1]])
        if rising == 0:
            if abs(step) > least:
                kept.append(int(row))
                rising = 1 if step > 0 else -1
        elif step * rising > 0:
            kept[-1] = int(row)
        elif abs(step) > least:
            kept.append(int(row))
            rising = -rising
    return list(pairwise(kept))


def loading_branch(test: StressStrain, cycle: str = "first") -> slice:
    """Return the rows of the loading in a test's first or last cycle; all rows for a test in both directions.

    Raises
    ------
    DataError
        If the specimen is never loaded: the strain only falls.
    """
    if test.loading == "both":
        return slice(0, len(test.strain))
    raised = test.sign * test.strain
    loadings = [(first, last) for first, last in branches(raised) if raised[last] > raised[first]]
    if not loadings:
        limit = f"falls from {raised[0]:.4g} to {raised[-1]:.4g} and never rises"
        remedy = "include the loading branch, in the order of recording, or specify --mode"
        raise DataError("strain", limit=limit, remedy=remedy)
    first, last = loadings[0] if cycle == "first" else loadings[-1]
    return slice(first, last + 1)


def cycles_of(test: StressStrain) -> tuple[Cycle, ...]:
    """Return the cycles of a test, each a loading and any unloading after it; none for a test in both directions."""
    if test.loading == "both":
        return ()
    strain, stress = test.sign * test.strain, test.sign * test.stress_MPa
    parts = branches(strain)
    cycles: list[Cycle] = []
    for at, (first, peak) in enumerate(parts):
        if strain[peak] <= strain[first]:
            continue
        unloading = parts[at + 1] if at + 1 < len(parts) else None
        cycles.append(_cycle(strain, stress, len(cycles) + 1, (first, peak), unloading, cycles[:1]))
    return tuple(cycles)


def softening(cycles: Sequence[Cycle]) -> Softening | None:
    """Return the change from the first to the last cycle; None for one cycle, or if the last has a smaller strain."""
    if len(cycles) < 2:
        return None
    first, last = cycles[0], cycles[-1]
    if last.peak_strain < 0.95 * first.peak_strain or min(first.peak_stress_MPa, first.work_in_mJ_per_mm3) <= 0:
        return None
    half = (first.stress_at_half_MPa, last.stress_at_half_MPa)
    return Softening(
        cycles=len(cycles),
        peak_stress=1 - last.peak_stress_MPa / first.peak_stress_MPa,
        stress_at_half=None if half[0] is None or half[1] is None or half[0] == 0 else 1 - half[1] / half[0],
        work_in=1 - last.work_in_mJ_per_mm3 / first.work_in_mJ_per_mm3,
    )


def _cycle(
    strain: FloatArray,
    stress: FloatArray,
    number: int,
    loading: tuple[int, int],
    unloading: tuple[int, int] | None,
    before: Sequence[Cycle],
) -> Cycle:
    """Return a cycle of strain and stress as magnitudes; ``before`` contains the first one, unless this is it."""
    start, peak = loading
    up = slice(start, peak + 1)
    largest = float(stress[up].max())
    first_strain = before[0].peak_strain if before else float(strain[peak])
    first_stress = before[0].peak_stress_MPa if before else largest
    down = slice(unloading[0], unloading[1] + 1) if unloading else None
    return Cycle(
        number=number,
        start=start,
        peak=peak,
        end=unloading[1] if unloading else peak,
        peak_strain=float(strain[peak]),
        peak_stress_MPa=largest,
        stress_at_half_MPa=crossing(strain[up], stress[up], first_strain / 2),
        work_in_mJ_per_mm3=float(np.trapezoid(stress[up], strain[up])),
        work_out_mJ_per_mm3=None if down is None else -float(np.trapezoid(stress[down], strain[down])),
        residual_strain=None if down is None else _residual(strain[down], stress[down], first_stress),
    )


def _residual(strain: FloatArray, stress: FloatArray, peak: float) -> float | None:
    """Return the strain at which a line through the end of an unloading reaches zero stress."""
    low, high = (share * peak for share in _UNLOADED)
    end = np.flatnonzero(stress <= low)
    if len(end) == 0:
        return None
    last = np.flatnonzero(stress[: end[0]] <= high)
    if len(last) < 3 or float(np.ptp(stress[last])) == 0:
        return crossing(-stress, strain, -low)
    slope, zero = np.polyfit(stress[last], strain[last], 1)
    return float(zero) if slope > 0 else crossing(-stress, strain, -low)


def crossing(rising: FloatArray, values: FloatArray, level: float) -> float | None:
    """Return the value at which ``rising`` first reaches a level from below, linear between rows; None if never."""
    reached = np.flatnonzero(rising >= level)
    if len(reached) == 0 or reached[0] == 0:
        return None
    at = int(reached[0])
    share = (level - rising[at - 1]) / (rising[at] - rising[at - 1])
    return float(values[at - 1] + share * (values[at] - values[at - 1]))


def loading_curve(test: StressStrain, cycle: str = "first", toe_end: float = 0.0) -> Curve:
    """Return the loading branch of a test, first or last, as a curve for fitting.

    Parameters
    ----------
    test
        Test with strains counted from the zero of the toe compensation, or as from `rereferenced`.
    cycle
        ``first`` or ``last``.
    toe_end
        Strain (magnitude) below which stresses belong to the toe and are omitted.
    """
    rows = loading_branch(test, cycle)
    stretch, stress = test.stretch[rows], test.stress_MPa[rows]
    if test.loading != "both":
        kept = test.sign * (stretch - 1) >= toe_end
        kept[int(np.argmax(test.sign * stress)) + 1 :] = False
        stretch, stress = stretch[kept], stress[kept]
    return Curve(test.mode, *_thinned(stretch, stress))


def rereferenced(test: StressStrain) -> StressStrain:
    """Return the test with stress and strain per area and length at the start of its last cycle's loading.

    The start is where the previous cycle reached zero stress; if it did not, or there is only one cycle, the test is
    returned unchanged.
    """
    cycles = cycles_of(test)
    if len(cycles) < 2 or cycles[-2].residual_strain is None:
        return test
    left = 1 + test.sign * cycles[-2].residual_strain
    return replace(test, strain=test.stretch / left - 1, stress_MPa=test.stress_MPa * left)


def _thinned(stretch: FloatArray, stress: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means over steps of equal stretch, by rising stretch; the points themselves if they are few."""
    if len(stretch) <= MAX_FIT_POINTS:
        order = np.argsort(stretch, kind="stable")
        return stretch[order], stress[order]
    edges = np.linspace(stretch.min(), stretch.max(), MAX_FIT_POINTS + 1)
    step = np.clip(np.searchsorted(edges, stretch, side="right") - 1, 0, MAX_FIT_POINTS - 1)
    count = np.bincount(step, minlength=MAX_FIT_POINTS)
    filled = count > 0
    means = [
        np.bincount(step, weights=values, minlength=MAX_FIT_POINTS)[filled] / count[filled]
        for values in (stretch, stress)
    ]
    return means[0], means[1]

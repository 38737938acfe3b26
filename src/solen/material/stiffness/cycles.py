"""Loading, unloading, and the energy loss in a cyclic test.

A test is a sequence of branches between turning points of the strain. A reversal starts a new branch only if it exceeds
a fraction of the strain range, so that noise does not. In each cycle, a loading and an unloading, the specimen absorbs
work, returns part of it, and retains a residual strain; rubbers lose most in the first cycle (Mullins softening; Diani,
Fayolle & Gilormini 2009), so the first and last cycles are compared. Cycles of one specimen are not replicates: they
show how this specimen changes, not how specimens differ.

A fit should not depend on the sampling rate of the machine: a loading branch is averaged over steps of equal stretch,
and ends at its largest stress. A later cycle starts at the residual strain of the earlier cycles, at which the specimen
has a different length and, because it is incompressible, a different area; stress and stretch are computed from these.

`branches` and `loading_branch` divide a test, `cycles_of` returns its cycles with their energies, and `softening`
compares them; `loading_curve` returns the curve for a model fit, and `relative_to_last_cycle` returns a test relative
to the state at the beginning of its last cycle.
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

MIN_REVERSAL = 0.1
"""Fraction of the strain range that a reversal must exceed."""
MAX_FIT_POINTS = 50
"""Maximum number of points of a curve to which a model is fitted."""
_UNLOADED = (0.01, 0.05)  # range of stress from which the residual strain follows, relative to the first peak stress


@dataclass(frozen=True)
class Cycle:
    """A loading and the unloading after it.

    Attributes
    ----------
    number
        Number of the cycle, counted from 1.
    start, peak, end
        First row, row of the turning point, and last row of the cycle.
    peak_strain, peak_stress_MPa
        Strain at the turning point, and largest stress during loading, as magnitudes.
    stress_at_half_MPa
        Stress during loading at half of the first cycle's peak strain; None if the cycle does not reach it.
    work_in_mJ_per_mm3, work_out_mJ_per_mm3
        Work absorbed and returned per initial volume; the work returned is None if no unloading was recorded.
    residual_strain
        Strain at which a line through the end of the unloading, from 5 to 1 % of the first peak stress, reaches zero
        stress; None if the unloading was not recorded down to 1 %.
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
        """Hysteresis loss: the work absorbed but not returned."""
        return None if self.work_out_mJ_per_mm3 is None else self.work_in_mJ_per_mm3 - self.work_out_mJ_per_mm3

    @reported
    def loss_fraction(self) -> float | None:
        """Ratio of the hysteresis loss to the work absorbed."""
        loss = self.dissipated_mJ_per_mm3
        return None if loss is None or self.work_in_mJ_per_mm3 <= 0 else loss / self.work_in_mJ_per_mm3


@dataclass(frozen=True)
class Softening:
    """Relative decrease of peak stress, stress at half strain and absorbed work from the first to the last cycle."""

    cycles: int
    peak_stress: float
    stress_at_half: float | None
    work_in: float


def branches(strain: FloatArray, min_reversal: float = MIN_REVERSAL) -> list[tuple[int, int]]:
    """Return the rows (first, last) of the branches between turning points, in order.

    Parameters
    ----------
    strain
        Strains, shape (n,).
    min_reversal
        Fraction of the strain range that a reversal must exceed.
    """
    min_step = min_reversal * float(np.ptp(strain))
    turns = np.flatnonzero(np.diff(np.sign(np.diff(strain))) != 0) + 1
    rows = np.unique(np.concatenate([[0], turns, [len(strain) - 1]]))
    ends, direction = [0], 0
    for row in rows[1:]:
        step = float(strain[row] - strain[ends[-1]])
        if direction == 0:
            if abs(step) > min_step:
                ends.append(int(row))
                direction = 1 if step > 0 else -1
        elif step * direction > 0:
            ends[-1] = int(row)
        elif abs(step) > min_step:
            ends.append(int(row))
            direction = -direction
    return list(pairwise(ends))


def loading_branch(test: StressStrain, cycle: str = "first") -> slice:
    """Return the rows of the loading in the first or last cycle; all rows for a test in both directions.

    Raises
    ------
    DataError
        If the specimen is never loaded.
    """
    if test.loading == "both":
        return slice(0, len(test.strain))
    strain = test.sign * test.strain
    loadings = [(first, last) for first, last in branches(strain) if strain[last] > strain[first]]
    if not loadings:
        limit = f"decreases from {strain[0]:.4g} to {strain[-1]:.4g}, so the specimen is never loaded"
        remedy = "include the loading branch, in the order of recording, or specify --mode"
        raise DataError("strain", limit=limit, remedy=remedy)
    first, last = loadings[0] if cycle == "first" else loadings[-1]
    return slice(first, last + 1)


def cycles_of(test: StressStrain) -> tuple[Cycle, ...]:
    """Return the cycles of a test; the last may have no unloading; none for a test in both directions."""
    if test.loading == "both":
        return ()
    strain, stress = test.sign * test.strain, test.sign * test.stress_MPa
    rows = branches(strain)
    cycles: list[Cycle] = []
    for number, (start, peak) in enumerate(rows):
        if strain[peak] <= strain[start]:
            continue
        unloading = rows[number + 1] if number + 1 < len(rows) else None
        cycles.append(_cycle(strain, stress, len(cycles) + 1, (start, peak), unloading, cycles[:1]))
    return tuple(cycles)


def softening(cycles: Sequence[Cycle]) -> Softening | None:
    """Return the change from the first to the last cycle; None for a single cycle or a lower last strain."""
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
    first: Sequence[Cycle],
) -> Cycle:
    """Return a cycle from magnitudes of strain and stress; ``first`` is empty, or contains the first cycle."""
    start, peak = loading
    up = slice(start, peak + 1)
    peak_stress = float(stress[up].max())
    first_strain = first[0].peak_strain if first else float(strain[peak])
    first_stress = first[0].peak_stress_MPa if first else peak_stress
    down = slice(unloading[0], unloading[1] + 1) if unloading else None
    return Cycle(
        number=number,
        start=start,
        peak=peak,
        end=unloading[1] if unloading else peak,
        peak_strain=float(strain[peak]),
        peak_stress_MPa=peak_stress,
        stress_at_half_MPa=crossing(strain[up], stress[up], first_strain / 2),
        work_in_mJ_per_mm3=float(np.trapezoid(stress[up], strain[up])),
        work_out_mJ_per_mm3=None if down is None else -float(np.trapezoid(stress[down], strain[down])),
        residual_strain=None if down is None else _residual(strain[down], stress[down], first_stress),
    )


def _residual(strain: FloatArray, stress: FloatArray, peak_stress: float) -> float | None:
    """Return the strain at which a line through the end of an unloading reaches zero stress."""
    low, high = (fraction * peak_stress for fraction in _UNLOADED)
    unloaded = np.flatnonzero(stress <= low)
    if len(unloaded) == 0:
        return None
    rows = np.flatnonzero(stress[: unloaded[0]] <= high)
    if len(rows) < 3 or float(np.ptp(stress[rows])) == 0:
        return crossing(-stress, strain, -low)
    slope, intercept = np.polyfit(stress[rows], strain[rows], 1)
    return float(intercept) if slope > 0 else crossing(-stress, strain, -low)


def crossing(rising: FloatArray, values: FloatArray, level: float) -> float | None:
    """Return the interpolated value where ``rising`` first reaches a level from below; None if it never does."""
    reached = np.flatnonzero(rising >= level)
    if len(reached) == 0 or reached[0] == 0:
        return None
    row = int(reached[0])
    fraction = (level - rising[row - 1]) / (rising[row] - rising[row - 1])
    return float(values[row - 1] + fraction * (values[row] - values[row - 1]))


def loading_curve(test: StressStrain, cycle: str = "first", toe_end: float = 0.0) -> Curve:
    """Return the loading of the first or last cycle of a test, as a curve to which a model is fitted.

    Parameters
    ----------
    test
        Test with strains relative to the zero of the toe compensation, or from `relative_to_last_cycle`.
    cycle
        ``first`` or ``last``.
    toe_end
        Strain (magnitude) below which stresses belong to the toe and are omitted.
    """
    rows = loading_branch(test, cycle)
    stretch, stress = test.stretch[rows], test.stress_MPa[rows]
    if test.loading != "both":
        keep = test.sign * (stretch - 1) >= toe_end
        keep[int(np.argmax(test.sign * stress)) + 1 :] = False
        stretch, stress = stretch[keep], stress[keep]
    return Curve(test.mode, *_thinned(stretch, stress))


def relative_to_last_cycle(test: StressStrain) -> StressStrain:
    """Return the test with stress and strain relative to the area and length at the beginning of the last cycle.

    This is the state in which the previous cycle reached zero stress; if it did not, or there is only one cycle, the
    test is returned unchanged.
    """
    cycles = cycles_of(test)
    if len(cycles) < 2 or cycles[-2].residual_strain is None:
        return test
    stretch = 1 + test.sign * cycles[-2].residual_strain
    return replace(test, strain=test.stretch / stretch - 1, stress_MPa=test.stress_MPa * stretch)


def _thinned(stretch: FloatArray, stress: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means over steps of equal stretch, in ascending order; the points themselves if there are few."""
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

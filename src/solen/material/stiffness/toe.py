"""Toe compensation: the strain at which a test really begins.

Before the platens touch, or while a strip's slack is removed, displacement grows and force hardly does. This part is
not a property of the material and shifts the zero of strain. The annexes of ASTM D695 and D638 extrapolate the tangent
to the first straight part, or to the steepest part after the toe, to zero stress and count strains from there.

A rubber has no straight part, so the tangent here is a neo-Hookean curve: stress is plotted over the neo-Hookean
measure g = P/E of the strain, which equals the strain if it is small, so that a plastic is treated as in the annexes.
The loading branch is divided into equal steps of stress; the toe ends at the first step from which the slope no longer
rises by more than 5 % per step. A line through that step and the next is extrapolated to zero stress. The shift is made
if it exceeds twice its uncertainty, which includes the scatter and the change when only the first of the two steps is
used; a backward shift is made only if the record begins under load.

A slope that keeps rising cannot be distinguished from a toe: then nothing is shifted, and the note reports this.

`find_toe` returns the toe of a test.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.material.stiffness.correlation import scatter
from solen.material.stiffness.cycles import loading_branch
from solen.material.stiffness.modes import Mode
from solen.material.stiffness.stress_strain import StressStrain

_STEPS = 40  # number of equal stress steps of the loading branch
_LOOKED = 20  # number of these steps that may belong to the toe
_RISE = 1.05
_MIN_STEP_ROWS = 4  # smallest number of rows of a step
_ROUNDS = 8
_MIN_SHIFT = 1e-5  # smallest shift of strain that is applied


@dataclass(frozen=True)
class Toe:
    """Toe of a test.

    Attributes
    ----------
    shift
        Strain, with the test's sign, from which strains are counted; 0 if nothing is shifted.
    u_shift
        Standard uncertainty of the shift; None if no line could be drawn.
    end
        Strain, counted from the shift, at which the toe ends; stresses below it are not the material's.
    note
        The correction made, in a sentence.
    """

    shift: float
    u_shift: float | None
    end: float
    note: str


def find_toe(test: StressStrain) -> Toe:
    """Return the toe of the first loading branch of a test in one direction."""
    if test.loading == "both":
        return Toe(0.0, None, 0.0, "no toe compensation: the file contains both directions")
    rows = loading_branch(test)
    strain, stress = test.sign * test.strain[rows], test.sign * test.stress_MPa[rows]
    steps = _steps(stress)
    if len(steps) < 4:
        return Toe(0.0, None, 0.0, "no toe compensation: too few points in the loading branch")
    return _shifted(test, strain, stress, steps)


def measure(mode: Mode, strain: FloatArray) -> FloatArray:
    """Return neo-Hookean engineering stress over Young's modulus; uniaxially, this is the strain to first order."""
    stretch = np.maximum(1 + strain, 1e-3)
    return np.asarray(sum(2 * c * stretch ** (2 * c - 1) for c in mode.powers) / (6 * mode.directions))


def _shifted(test: StressStrain, strain: FloatArray, stress: FloatArray, steps: list[slice]) -> Toe:
    """Return the toe from the line through the first step after it, iterated as the measure depends on the shift."""
    shift, u_shift, slope = 0.0, 0.0, 0.0
    at: int | None = None
    for _ in range(_ROUNDS):
        over = test.sign * measure(test.mode, test.sign * (strain - shift))
        at = _end_of_toe(over, stress, steps)
        if at is None:
            return Toe(0.0, None, 0.0, "no toe compensation: the slope keeps rising, because of a toe or the material")
        both = slice(steps[at].start, steps[at + 1].stop)
        zero, u_zero, slope = _zero(over[both], stress[both])
        curved = zero - _zero(over[steps[at]], stress[steps[at]])[0]  # result of another choice of points
        change, u_shift = zero / test.mode.slope_ratio, float(np.hypot(u_zero, curved)) / test.mode.slope_ratio
        shift += change
        if abs(change) < 1e-9:
            break
    assert at is not None  # noqa: S101  the loop has run
    at_zero = f"{100 * shift:.3g} ± {100 * u_shift:.1g} %"
    if abs(shift) <= max(2 * u_shift, _MIN_SHIFT) or stress[0] < -0.5 * shift * slope:
        return Toe(0.0, u_shift, 0.0, f"no toe: the first tangent meets zero stress at {at_zero} strain")
    end = max(float(strain[steps[at].start]) - shift, 0.0)
    note = f"strain is counted from {at_zero} in the file, where the tangent after the toe reaches zero stress"
    return Toe(test.sign * shift, u_shift, end, note)


def _steps(stress: FloatArray) -> list[slice]:
    """Return rows of equal steps of stress while loading, with a minimum number of rows each."""
    highest = np.maximum.accumulate(stress)
    edges = np.searchsorted(highest, np.linspace(0, float(highest[-1]), _STEPS + 1)[1 : _LOOKED + 4])
    steps, start = [], 0
    for edge in edges:
        if edge - start >= _MIN_STEP_ROWS:
            steps.append(slice(start, int(edge)))
            start = int(edge)
    return steps


def _end_of_toe(over: FloatArray, stress: FloatArray, steps: list[slice]) -> int | None:
    """Return the first step whose slope is not much exceeded in the next two; None if there is none."""
    slopes = [_slope(over[rows], stress[rows]) for rows in steps]
    for at, now in enumerate(slopes[:-2]):
        if now > 0 and slopes[at + 1] <= _RISE * now and slopes[at + 2] <= _RISE**2 * now:
            return at
    return None


def _slope(over: FloatArray, stress: FloatArray) -> float:
    centred = over - over.mean()
    spread = float(centred @ centred)
    return float(centred @ stress) / spread if spread > 0 else 0.0


def _zero(over: FloatArray, stress: FloatArray) -> tuple[float, float, float]:
    """Return the strain at which a line through points reaches zero stress, its standard uncertainty, and the slope."""
    rows = np.column_stack([np.ones_like(over), over])
    start, slope = np.linalg.lstsq(rows, stress, rcond=None)[0]
    residual = scatter([rows], [stress - rows @ np.array([start, slope])])
    zero = -start / slope
    if residual.covariance is None:
        return float(zero), float("inf"), float(slope)
    by = np.array([-1 / slope, start / slope**2])
    return float(zero), float(np.sqrt(max(by @ residual.covariance @ by, 0.0))), float(slope)

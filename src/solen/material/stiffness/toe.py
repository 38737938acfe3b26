"""Toe compensation: the strain at which the loading of the specimen begins.

Before the platens touch the specimen, or while the slack of a strip is taken up, displacement increases but force
hardly does. This toe is not a property of the material, and it shifts the zero of strain. The annexes of ASTM D695 and
D638 extrapolate the tangent to the first straight part, or to the steepest part after the toe, to zero stress, and
measure strains from there.

The curve of a rubber has no straight part, so the tangent here is a neo-Hookean curve: stress is plotted against the
neo-Hookean measure g = P/E of the strain, which is equal to the strain if it is small, so that a plastic is treated as
in the annexes. The loading branch is divided into equal steps of stress; the toe ends at the first step from which the
slope increases by no more than 5 % per step. A line through this step and the next is extrapolated to zero stress. The
zero is shifted if the shift exceeds twice its uncertainty, which includes the scatter, and the change if only the first
of the two steps is used; it is shifted backwards only if the record begins under load.

A slope that keeps increasing cannot be distinguished from a toe: the zero is then not shifted, and the note reports
this.

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
_MAX_TOE_STEPS = 20  # number of these steps that may belong to the toe
_MAX_INCREASE = 1.05  # largest ratio of the slopes of successive steps after the toe
_MIN_STEP_ROWS = 4
_MAX_ITERATIONS = 8
_MIN_SHIFT = 1e-5  # smallest strain by which the zero is shifted


@dataclass(frozen=True)
class Toe:
    """Toe of a test.

    Attributes
    ----------
    shift
        Strain, with the sign of the test, that is the new zero; 0 without compensation.
    u_shift
        Standard uncertainty of the shift; None if no line was fitted.
    end
        Strain, relative to the new zero, at which the toe ends; smaller strains do not describe the material.
    note
        What was compensated, in a sentence.
    """

    shift: float
    u_shift: float | None
    end: float
    note: str


def no_toe(note: str, u_shift: float | None = None) -> Toe:
    """Return the result without compensation, with the reason as a note."""
    return Toe(0.0, u_shift, 0.0, note)


def find_toe(test: StressStrain) -> Toe:
    """Return the toe of the first loading branch of a test in one direction."""
    if test.loading == "both":
        return no_toe("no toe compensation: the file contains both directions")
    rows = loading_branch(test)
    strain, stress = test.sign * test.strain[rows], test.sign * test.stress_MPa[rows]
    steps = _steps(stress)
    if len(steps) < 4:
        return no_toe("no toe compensation: too few points in the loading branch")
    return _compensated(test, strain, stress, steps)


def measure(mode: Mode, strain: FloatArray) -> FloatArray:
    """Return the neo-Hookean ratio P/E of engineering stress to Young's modulus.

    In the uniaxial mode, it is equal to the strain to first order.
    """
    stretch = np.maximum(1 + strain, 1e-3)
    return np.asarray(sum(2 * c * stretch ** (2 * c - 1) for c in mode.powers) / (6 * mode.directions))


def _compensated(test: StressStrain, strain: FloatArray, stress: FloatArray, steps: list[slice]) -> Toe:
    """Return the toe from a line through the two steps after it, iterated because the measure depends on the zero."""
    shift, u_shift, slope = 0.0, 0.0, 0.0
    end: int | None = None
    for _ in range(_MAX_ITERATIONS):
        g = test.sign * measure(test.mode, test.sign * (strain - shift))
        end = _end_of_toe(g, stress, steps)
        if end is None:
            return no_toe("no toe compensation: the slope keeps increasing, because of a toe or of the material")
        two_steps = slice(steps[end].start, steps[end + 1].stop)
        zero, u_zero, slope = _zero(g[two_steps], stress[two_steps])
        difference = zero - _zero(g[steps[end]], stress[steps[end]])[0]  # if only the first step is used
        change, u_shift = zero / test.mode.slope_ratio, float(np.hypot(u_zero, difference)) / test.mode.slope_ratio
        shift += change
        if abs(change) < 1e-9:
            break
    assert end is not None  # noqa: S101  the loop has run
    zero_text = f"{100 * shift:.3g} ± {100 * u_shift:.1g} %"
    if abs(shift) <= max(2 * u_shift, _MIN_SHIFT) or stress[0] < -0.5 * shift * slope:
        return no_toe(f"no toe: the initial tangent reaches zero stress at {zero_text} strain", u_shift)
    end_strain = max(float(strain[steps[end].start]) - shift, 0.0)
    note = f"strains are relative to {zero_text} in the file, where the tangent after the toe reaches zero stress"
    return Toe(test.sign * shift, u_shift, end_strain, note)


def _steps(stress: FloatArray) -> list[slice]:
    """Return the rows of equal steps of stress during loading; a step with too few rows is joined to the next."""
    highest = np.maximum.accumulate(stress)
    edges = np.searchsorted(highest, np.linspace(0, float(highest[-1]), _STEPS + 1)[1 : _MAX_TOE_STEPS + 4])
    steps, start = [], 0
    for edge in edges:
        if edge - start >= _MIN_STEP_ROWS:
            steps.append(slice(start, int(edge)))
            start = int(edge)
    return steps


def _end_of_toe(g: FloatArray, stress: FloatArray, steps: list[slice]) -> int | None:
    """Return the number of the first step after which the slope hardly increases; None if there is no such step."""
    slopes = [_slope(g[rows], stress[rows]) for rows in steps]
    for number, slope in enumerate(slopes[:-2]):
        limits = (_MAX_INCREASE * slope, _MAX_INCREASE**2 * slope)
        if slope > 0 and slopes[number + 1] <= limits[0] and slopes[number + 2] <= limits[1]:
            return number
    return None


def _slope(g: FloatArray, stress: FloatArray) -> float:
    centred = g - g.mean()
    squares = float(centred @ centred)
    return float(centred @ stress) / squares if squares > 0 else 0.0


def _zero(g: FloatArray, stress: FloatArray) -> tuple[float, float, float]:
    """Return where a line through points reaches zero stress, the standard uncertainty of this zero, and the slope."""
    rows = np.column_stack([np.ones_like(g), g])
    intercept, slope = np.linalg.lstsq(rows, stress, rcond=None)[0]
    statistics = scatter([rows], [stress - rows @ np.array([intercept, slope])])
    zero = -intercept / slope
    if statistics.covariance is None:
        return float(zero), float("inf"), float(slope)
    derivatives = np.array([-1 / slope, intercept / slope**2])
    return float(zero), float(np.sqrt(max(derivatives @ statistics.covariance @ derivatives, 0.0))), float(slope)

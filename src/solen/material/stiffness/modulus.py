"""Young's modulus by regression over a specified strain range, with its uncertainty; strength and break.

The modulus is the slope of engineering stress against engineering strain, fitted to every recorded point of the loading
branch between two strains, both included, as testing machines compute it (ISO 527-1: 0.05 to 0.25 %). Its uncertainty
combines that of the dimensions with the scatter about the line, which accounts for the correlation of neighbouring
residuals. The initial slope of a planar or equibiaxial test is 4/3 or 2 times Young's modulus and is divided by this
factor.

Over a wide range, the slope of a rubber differs from its modulus at zero strain: `ideal_ratio` returns the ratio for an
ideal rubber.

`young` evaluates a range, `default_range` selects one, and `secant` and `extremes` compute further values.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.regression import t_quantile
from solen.material.stiffness.correlation import scatter
from solen.material.stiffness.cycles import crossing, loading_branch
from solen.material.stiffness.modes import Mode
from solen.material.stiffness.stress_strain import StressStrain
from solen.material.stiffness.toe import measure

Range = tuple[float, float]

_TENSION: tuple[Range, ...] = ((0.0005, 0.0025), (0.02, 0.1), (0.05, 0.25), (0.0, 0.5))
_COMPRESSION: tuple[Range, ...] = ((0.02, 0.1), (0.05, 0.25), (0.0, 0.5))
_MIN_DEFAULT_POINTS, _MIN_POINTS = 8, 3
_MAX_RELATIVE_U = 0.02  # relative uncertainty above which a wider range is used
BREAK = 0.6
"""A specimen is broken if its force falls below this fraction of the largest force."""


@dataclass(frozen=True)
class Young:
    """A modulus, its uncertainty, and the data from which it was determined.

    Attributes
    ----------
    modulus_MPa, u_modulus_MPa
        Young's modulus, and its standard uncertainty due to scatter and, if known, dimensions.
    u_scatter_MPa, u_dimensions_MPa
        Parts of the uncertainty; the second is None if the uncertainty of the dimensions is unknown.
    interval95_modulus_MPa
        95 % interval, from Student's t with the effective degrees of freedom and a normal distribution for the
        dimensions.
    strain_range
        Lowest and highest strain, as magnitudes, both included.
    points, effective_points, lag_one
        Number of points in the range, equivalent number of independent points, and correlation of neighbouring
        residuals.
    r_squared, residual_MPa
        Fraction of the variance explained by the line, and standard deviation of the residuals.
    intercept_MPa
        Stress of the line at zero strain.
    """

    modulus_MPa: float
    u_modulus_MPa: float
    u_scatter_MPa: float
    u_dimensions_MPa: float | None
    interval95_modulus_MPa: tuple[float, float]
    strain_range: Range
    points: int
    effective_points: float
    lag_one: float
    r_squared: float
    residual_MPa: float
    intercept_MPa: float


@dataclass(frozen=True)
class Extremes:
    """Largest stress and its strain, and stress and strain at break, if recorded, as magnitudes."""

    strength_MPa: float
    strain_at_strength: float
    strain_at_break: float | None
    stress_at_break_MPa: float | None


def young(test: StressStrain, strain_range: Range, cycle: str = "first") -> Young:
    """Fit the modulus over a range of strain.

    Parameters
    ----------
    test
        Test whose strains have the same zero as the range.
    strain_range
        Lowest and highest strain, as magnitudes and fractions, both included.
    cycle
        Cycle whose loading branch is used, ``first`` or ``last``.

    Raises
    ------
    DataError
        If the range is empty, or contains fewer than three points or no change of strain.
    """
    low, high = strain_range
    if not 0 <= low < high < math.inf:
        limit = "must be two numbers of at least 0 in ascending order"
        raise DataError("strain range in per cent", value=f"{100 * low:g} {100 * high:g}", limit=limit)
    strain, stress = _in_range(test, strain_range, cycle)
    if len(strain) < _MIN_POINTS or float(np.ptp(strain)) == 0:
        limit = (
            f"contains {len(strain)} points of the loading branch, but at least {_MIN_POINTS} are required; the "
            f"largest strain is {100 * float(np.abs(test.strain).max()):.4g} %"
        )
        raise DataError(f"strain range {100 * low:g} to {100 * high:g} %", limit=limit, remedy="use a wider range")
    return _regression(test, strain, stress, strain_range)


def default_range(test: StressStrain, cycle: str = "first") -> Range:
    """Return the range of strain that is used if none is specified.

    In tension it is 0.05 to 0.25 %, as in ISO 527-1, if this range contains eight points and determines the modulus to
    2 %; otherwise, and in compression, the first of 2 to 10 %, 5 to 25 % and 0 to 50 % that contains eight points;
    otherwise 0 to the fifth lowest strain.
    """
    candidates = _COMPRESSION if test.loading == "compression" else _TENSION
    for candidate in candidates:
        strain, stress = _in_range(test, candidate, cycle)
        span = float(np.ptp(strain)) if len(strain) else 0.0
        if len(strain) < _MIN_DEFAULT_POINTS or span == 0 or span < 0.5 * (candidate[1] - candidate[0]):
            continue
        modulus = _regression(test, strain, stress, candidate)
        if candidate[1] > 0.01 or modulus.u_scatter_MPa < _MAX_RELATIVE_U * modulus.modulus_MPa:
            return candidate
    strains = np.unique(np.abs(test.strain[loading_branch(test, cycle)]))
    return 0.0, float(strains[min(4, len(strains) - 1)])


def ideal_ratio(mode: Mode, sign: int, strain_range: Range) -> float:
    """Return the slope of an ideal (neo-Hookean) rubber over a range of strain, relative to that at zero strain."""
    ends = sign * np.array(strain_range)
    low, high = measure(mode, ends)
    return float((high - low) / (ends[1] - ends[0]) / mode.slope_ratio)


def secant(test: StressStrain, strain: float, cycle: str = "first") -> float | None:
    """Return the secant modulus in MPa at a strain (magnitude) during loading; None if the test does not reach it."""
    rows = loading_branch(test, cycle)
    strains, stresses = test.sign * test.strain[rows], test.sign * test.stress_MPa[rows]
    if strain <= 0:
        return None
    stress = float(stresses[0]) if strains[0] == strain else crossing(strains, stresses, strain)
    return None if stress is None else stress / strain


def extremes(test: StressStrain) -> Extremes:
    """Return the largest stress, and the break: the first later row with a stress below 60 % of it.

    There is no break if the specimen was unloaded after the largest stress.
    """
    strain, stress = test.sign * test.strain, test.sign * test.stress_MPa
    peak = int(np.argmax(stress))
    broken = np.flatnonzero(stress[peak:] < BREAK * stress[peak])
    is_unloaded = loading_branch(test, "last").stop < len(stress) and np.ptp(strain[peak:]) > 0.1 * np.ptp(strain)
    row = peak + int(broken[0]) if len(broken) and not is_unloaded else None
    return Extremes(
        strength_MPa=float(stress[peak]),
        strain_at_strength=float(strain[peak]),
        strain_at_break=None if row is None else float(strain[row]),
        stress_at_break_MPa=None if row is None else float(stress[row]),
    )


def _in_range(test: StressStrain, strain_range: Range, cycle: str) -> tuple[FloatArray, FloatArray]:
    """Return strain and stress of the loading in a range; on both sides of zero for a test in both directions."""
    rows = loading_branch(test, cycle)
    strain, stress = test.sign * test.strain[rows], test.sign * test.stress_MPa[rows]
    magnitude = np.abs(strain) if test.loading == "both" else strain
    within = (magnitude >= strain_range[0]) & (magnitude <= strain_range[1])
    return strain[within], stress[within]


def _regression(test: StressStrain, strain: FloatArray, stress: FloatArray, strain_range: Range) -> Young:
    rows = np.column_stack([np.ones_like(strain), strain])
    centre = float(strain.mean())
    slope = float((strain - centre) @ stress / ((strain - centre) @ (strain - centre)))
    intercept = float(stress.mean() - slope * centre)
    residuals = stress - intercept - slope * strain
    statistics = scatter([rows], [residuals])
    u_slope = 0.0 if statistics.covariance is None else math.sqrt(max(float(statistics.covariance[1, 1]), 0.0))
    modulus, u_scatter = slope / test.mode.slope_ratio, u_slope / test.mode.slope_ratio
    u_dimensions = _u_dimensions(test, modulus)
    half_scatter = t_quantile(0.95, max(statistics.effective_points - 2, 1.0)) * u_scatter
    half = math.hypot(half_scatter, 1.959964 * (u_dimensions or 0.0))
    squares = float(np.sum((stress - stress.mean()) ** 2))
    return Young(
        modulus_MPa=modulus,
        u_modulus_MPa=math.hypot(u_scatter, u_dimensions or 0.0),
        u_scatter_MPa=u_scatter,
        u_dimensions_MPa=u_dimensions,
        interval95_modulus_MPa=(modulus - half, modulus + half),
        strain_range=strain_range,
        points=len(strain),
        effective_points=statistics.effective_points,
        lag_one=statistics.lag_one,
        r_squared=1 - float(residuals @ residuals) / squares if squares > 0 else 0.0,
        residual_MPa=statistics.sigma,
        intercept_MPa=intercept,
    )


def _u_dimensions(test: StressStrain, modulus: float) -> float | None:
    """Return the uncertainty due to the dimensions by which force and displacement were divided; None if unknown."""
    relative = [test.specimen.u_area] if test.area_used else []
    relative += [test.specimen.u_length] if test.from_displacement else []
    known = [u for u in relative if u is not None]
    return abs(modulus) * math.hypot(*known) if known else None

"""Young's modulus by regression over a specified strain range, with its uncertainty; strength and break.

The modulus is the slope of engineering stress against engineering strain, fitted to every recorded point of the loading
branch between two strains, both included, as testing machines compute it (ISO 527-1: 0.05 to 0.25 %). Its uncertainty
combines the scatter about the line, with correlated residuals counted as fewer points, and the specimen's dimensions.
The initial slope of a planar or equibiaxial test is 4/3 or 2 times Young's modulus and is divided by this factor.

Over a wide range a rubber's slope is not its modulus at zero strain: `ideal_ratio` returns the ratio for an ideal
rubber.

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
_ENOUGH, _MIN_POINTS = 8, 3
_RESOLVED = 0.02  # relative uncertainty above which a wider range is used
BREAK = 0.6
"""A specimen is broken if its force is below this fraction of the largest force."""


@dataclass(frozen=True)
class Young:
    """A modulus and its basis.

    Attributes
    ----------
    modulus_MPa, u_modulus_MPa
        Young's modulus, and its standard uncertainty from scatter and, if known, dimensions.
    u_scatter_MPa, u_dimensions_MPa
        The two parts; None for dimensions of unknown uncertainty.
    interval95_modulus_MPa
        95 % interval, from Student's t with the effective degrees of freedom and a normal distribution for the
        dimensions.
    strain_range
        Lowest and highest strain, as magnitudes, both included.
    points, effective_points, lag_one
        Points in the range, equivalent number of independent points, and correlation of neighbouring residuals.
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
    """Largest stress and its strain; stress and strain at break, if recorded. Magnitudes."""

    strength_MPa: float
    strain_at_strength: float
    strain_at_break: float | None
    stress_at_break_MPa: float | None


def young(test: StressStrain, strain_range: Range, cycle: str = "first") -> Young:
    """Fit the modulus over a range of strain, given as fractions.

    Parameters
    ----------
    test
        Test whose strains have the same zero as the range.
    strain_range
        Lowest and highest strain, magnitudes, both included.
    cycle
        Cycle whose loading branch is used, ``first`` or ``last``.

    Raises
    ------
    DataError
        If the range is empty, or contains fewer than three points or no slope.
    """
    low, high = strain_range
    if not 0 <= low < high < math.inf:
        given = f"{100 * low:g} {100 * high:g}"
        raise DataError(
            "strain range in percent", value=given, limit="must be two numbers of at least 0, the lower first"
        )
    strain, stress = _in_range(test, strain_range, cycle)
    if len(strain) < _MIN_POINTS or float(np.ptp(strain)) == 0:
        reached = 100 * float(np.abs(test.strain).max())
        limit = (
            f"contains {len(strain)} points of the loading branch, but {_MIN_POINTS} are needed; "
            f"the test reaches {reached:.4g} %"
        )
        raise DataError(f"strain range {100 * low:g} to {100 * high:g} %", limit=limit, remedy="choose a wider one")
    return _regression(test, strain, stress, strain_range)


def default_range(test: StressStrain, cycle: str = "first") -> Range:
    """Return the range of strain used if none is stated.

    In tension it is 0.05 to 0.25 %, as in ISO 527-1, if that range contains eight points and gives the modulus to 2 %;
    otherwise, and in compression, the first of 2 to 10 %, 5 to 25 % and 0 to 50 % that contains eight points; otherwise
    the first five points.
    """
    candidates = _COMPRESSION if test.loading == "compression" else _TENSION
    for wanted in candidates:
        strain, stress = _in_range(test, wanted, cycle)
        if len(strain) < _ENOUGH or float(np.ptp(strain)) == 0 or float(np.ptp(strain)) < 0.5 * (wanted[1] - wanted[0]):
            continue
        modulus = _regression(test, strain, stress, wanted)
        if wanted[1] > 0.01 or modulus.u_scatter_MPa < _RESOLVED * modulus.modulus_MPa:
            return wanted
    sizes = np.unique(np.abs(test.strain[loading_branch(test, cycle)]))
    return 0.0, float(sizes[min(4, len(sizes) - 1)])


def ideal_ratio(mode: Mode, sign: int, strain_range: Range) -> float:
    """Return the slope of an ideal (neo-Hookean) rubber over a range of strain, relative to that at zero strain."""
    ends = sign * np.array(strain_range)
    low, high = measure(mode, ends)
    return float((high - low) / (ends[1] - ends[0]) / mode.slope_ratio)


def secant(test: StressStrain, strain: float, cycle: str = "first") -> float | None:
    """Return stress over strain in MPa at a strain (magnitude) while loading; None if the test does not reach it."""
    rows = loading_branch(test, cycle)
    size, stress = test.sign * test.strain[rows], test.sign * test.stress_MPa[rows]
    if strain <= 0:
        return None
    at_strain = float(stress[0]) if size[0] == strain else crossing(size, stress, strain)
    return None if at_strain is None else at_strain / strain


def extremes(test: StressStrain) -> Extremes:
    """Return the largest stress, and the break: the first row after it whose stress is below 60 % of it.

    If a machine stops the record at the break, it is the last row.
    """
    size, stress = test.sign * test.strain, test.sign * test.stress_MPa
    at = int(np.argmax(stress))
    broken = np.flatnonzero(stress[at:] < BREAK * stress[at])
    unloads = loading_branch(test, "last").stop < len(stress) and np.ptp(size[at:]) > 0.1 * np.ptp(size)
    row = at + int(broken[0]) if len(broken) and not unloads else None
    return Extremes(
        strength_MPa=float(stress[at]),
        strain_at_strength=float(size[at]),
        strain_at_break=None if row is None else float(size[row]),
        stress_at_break_MPa=None if row is None else float(stress[row]),
    )


def _in_range(test: StressStrain, strain_range: Range, cycle: str) -> tuple[FloatArray, FloatArray]:
    """Return strain and stress of the points of the loading branch in a range, on either side of zero."""
    rows = loading_branch(test, cycle)
    strain, stress = test.sign * test.strain[rows], test.sign * test.stress_MPa[rows]
    size = np.abs(strain) if test.loading == "both" else strain
    within = (size >= strain_range[0]) & (size <= strain_range[1])
    return strain[within], stress[within]


def _regression(test: StressStrain, strain: FloatArray, stress: FloatArray, strain_range: Range) -> Young:
    rows = np.column_stack([np.ones_like(strain), strain])
    centre = float(strain.mean())
    slope = float((strain - centre) @ stress / ((strain - centre) @ (strain - centre)))
    intercept = float(stress.mean() - slope * centre)
    residuals = stress - intercept - slope * strain
    noise = scatter([rows], [residuals])
    u_slope = 0.0 if noise.covariance is None else math.sqrt(max(float(noise.covariance[1, 1]), 0.0))
    modulus, u_scatter = slope / test.mode.slope_ratio, u_slope / test.mode.slope_ratio
    u_dimensions = _u_dimensions(test, modulus)
    u_modulus = math.hypot(u_scatter, u_dimensions or 0.0)
    wide = t_quantile(0.95, max(noise.effective_points - 2, 1.0)) * u_scatter
    half = math.hypot(wide, 1.959964 * (u_dimensions or 0.0))
    spread = float(np.sum((stress - stress.mean()) ** 2))
    return Young(
        modulus_MPa=modulus,
        u_modulus_MPa=u_modulus,
        u_scatter_MPa=u_scatter,
        u_dimensions_MPa=u_dimensions,
        interval95_modulus_MPa=(modulus - half, modulus + half),
        strain_range=strain_range,
        points=len(strain),
        effective_points=noise.effective_points,
        lag_one=noise.lag_one,
        r_squared=1 - float(residuals @ residuals) / spread if spread > 0 else 0.0,
        residual_MPa=noise.sigma,
        intercept_MPa=intercept,
    )


def _u_dimensions(test: StressStrain, modulus: float) -> float | None:
    """Return the uncertainty from the dimensions by which force and displacement were divided."""
    parts = [test.specimen.u_area] if test.area_used else []
    parts += [test.specimen.u_length] if test.from_displacement else []
    known = [part for part in parts if part is not None]
    return abs(modulus) * math.hypot(*known) if known else None

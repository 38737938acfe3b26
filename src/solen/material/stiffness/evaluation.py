"""Evaluation of one specimen, and the mean modulus of several specimens of a material.

Every specimen is evaluated in the same way: toe, modulus, secants, cycles, extremes, and warnings about their
limitations. The modulus of a material is the mean over its specimens, with the uncertainty of the mean from their
scatter: specimens are replicates, cycles and points are not. For a single specimen, the uncertainty of its modulus is
reported, with a warning.

`evaluate` evaluates a test with `StiffnessOptions`; `mean_modulus` averages several moduli.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from solen.material.regression import t_quantile
from solen.material.rows import RowOptions
from solen.material.stiffness.cycles import (
    Cycle,
    Softening,
    cycles_of,
    loading_curve,
    relative_to_last_cycle,
    softening,
)
from solen.material.stiffness.hyperelastic import Curve, Weighting
from solen.material.stiffness.models import Kind
from solen.material.stiffness.modes import TestMode
from solen.material.stiffness.modulus import (
    Extremes,
    Range,
    Young,
    default_range,
    extremes,
    ideal_ratio,
    secant,
    young,
)
from solen.material.stiffness.specimen import bonded_ratio
from solen.material.stiffness.stress_strain import StressStrain
from solen.material.stiffness.toe import Toe, find_toe, no_toe
from solen.ranks import Caution, note, warning
from solen.results import Result, reported
from solen.spec.strict import Above0, Finite, refused

_MIN_EFFECTIVE_POINTS = 8.0  # below this number, an interval is too narrow
_MAX_SLOPE_CHANGE = 0.05  # largest relative change of the slope of an ideal rubber that causes no note
_MAX_LOSS = 0.1  # largest fraction of the absorbed work whose loss causes no warning


class StiffnessOptions(RowOptions):
    """Options for evaluating mechanical tests and for fitting models to them."""

    mode: TestMode | None = None
    """Mode of the tests; uniaxial includes tension and compression, by their signs; default: inferred from the files.
    """
    strain_range_percent: tuple[Finite, Finite] | None = None
    """Lowest and highest strain for the modulus in per cent, for example 0.05 0.25."""
    secant_percent: tuple[Above0, ...] = ()
    """Strains in per cent at which the secant modulus is computed."""
    toe: Literal["auto", "none", "always"] = "auto"
    """Toe compensation; auto: if strain is computed from displacement and the machine was not zeroed at a preload."""
    cycle: Literal["first", "last"] = "first"
    """Cycle whose loading is used for modulus and model."""
    fit: tuple[Literal["auto", "none", "all", Kind], ...] = ("auto",)
    """Models: auto (all of them, for rubbers), all, none, or names of models."""
    weighting: Weighting = "absolute"
    """Weighting of the stress errors in the fits: absolute or relative."""
    lubricated: bool = False
    """The ends of a compressed specimen slid on the platens."""
    compliance_mm_per_N: Finite = Field(0.0, ge=0.0)
    """Compliance of machine and fixture in mm/N; its effect is subtracted from the displacement."""

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if (ends := self.strain_range_percent) is not None and not 0.0 <= ends[0] < ends[1]:
            limit = "must be two numbers of at least 0 in ascending order"
            raise refused("strain_range_percent", limit, value=f"{ends[0]:g} {ends[1]:g}")
        return self


@dataclass(frozen=True)
class Secant:
    """Secant modulus at a strain (magnitude); None if the test does not reach this strain."""

    strain: float
    secant_MPa: float | None


@dataclass(frozen=True, eq=False)
class EvaluatedSpecimen:
    """Results for one specimen.

    Attributes
    ----------
    test
        The test, with strains relative to the zero of the toe compensation.
    toe, young, extremes, cycles, softening
        Toe, modulus, strength and break, cycles, and softening.
    secants
        Secant modulus at each requested strain.
    fitted
        Loading curve to which models are fitted.
    warnings
        Warnings, one sentence each.
    name, file
        Name of the specimen, and name of its file.
    """

    test: StressStrain
    toe: Toe
    young: Young
    secants: tuple[Secant, ...]
    extremes: Extremes
    cycles: tuple[Cycle, ...]
    softening: Softening | None
    fitted: Curve
    warnings: tuple[Caution, ...]
    name: str = ""
    file: str = ""

    @reported
    def mode(self) -> str:
        """Mode of deformation: uniaxial, planar or equibiaxial."""
        return self.test.mode.name


class MeanModulus(Result, kw_only=True):
    """Mean modulus over specimens.

    Attributes
    ----------
    modulus_MPa, u_modulus_MPa, interval95_modulus_MPa
        Mean, standard uncertainty of the mean, and interval from Student's t; for a single specimen, its modulus,
        uncertainty and interval. A few specimens may agree by chance: if they differ by less than the uncertainties of
        their moduli, these are used instead of the scatter.
    sd_modulus_MPa
        Standard deviation between specimens; None for a single specimen.
    """

    modulus_MPa: float
    u_modulus_MPa: float
    interval95_modulus_MPa: tuple[float, float]
    sd_modulus_MPa: float | None


def evaluate(test: StressStrain, options: StiffnessOptions, strain_range: Range | None = None) -> EvaluatedSpecimen:
    """Evaluate one test.

    Parameters
    ----------
    test
        Test of one specimen.
    options
        Options of the evaluation.
    strain_range
        Default range of the modulus, as fractions; None for `default_range`.

    Raises
    ------
    DataError
        If the range of the modulus contains too few points, or the specimen is never loaded.
    """
    toe, cycle = _toe(test, options.toe), options.cycle
    compensated = test.shifted(toe.shift)
    cycles = cycles_of(compensated)
    used = relative_to_last_cycle(compensated) if cycle == "last" else compensated
    if (percent := options.strain_range_percent) is not None:
        strain_range = (percent[0] / 100, percent[1] / 100)
    strain_range = strain_range or default_range(used, cycle)
    modulus = young(used, strain_range, cycle)
    secants = [percent / 100 for percent in options.secant_percent] or [strain_range[1]]
    return EvaluatedSpecimen(
        test=compensated,
        toe=toe,
        young=modulus,
        secants=tuple(Secant(strain, secant(used, strain, cycle)) for strain in secants),
        extremes=extremes(compensated),
        cycles=cycles,
        softening=softening(cycles),
        fitted=loading_curve(used, cycle, toe.end if cycle == "first" else 0.0),
        warnings=(*test.warnings, *_warnings(used, modulus, options, cycles)),
    )


def mean_modulus(moduli: Sequence[Young]) -> MeanModulus:
    """Return the mean over specimens tested in the same mode."""
    values = np.array([young.modulus_MPa for young in moduli])
    mean, sd, root = float(values.mean()), None, math.sqrt(len(values))
    if len(values) == 1:
        u, interval = moduli[0].u_modulus_MPa, moduli[0].interval95_modulus_MPa
    else:
        sd = float(values.std(ddof=1))
        rms_u = math.sqrt(float(np.mean([young.u_modulus_MPa**2 for young in moduli])))
        half = max(t_quantile(0.95, len(values) - 1) * sd, 1.959964 * rms_u) / root
        u, interval = max(sd, rms_u) / root, (mean - half, mean + half)
    return MeanModulus(modulus_MPa=mean, u_modulus_MPa=u, interval95_modulus_MPa=interval, sd_modulus_MPa=sd)


def _toe(test: StressStrain, option: str) -> Toe:
    if option == "none":
        return no_toe("no toe compensation, as requested")
    if option == "auto" and test.preload:
        return no_toe(f"no toe compensation: the testing machine was zeroed at its preload ({test.preload})")
    if option == "auto" and not test.from_displacement:
        return no_toe("no toe compensation: the file contains the strain, not a displacement")
    return find_toe(test)


def _warnings(test: StressStrain, modulus: Young, options: StiffnessOptions, cycles: Sequence[Cycle]) -> list[Caution]:
    """Return warnings about a test."""
    warnings = [
        _friction_warning(test, options),
        _dimension_warning(test, modulus),
        _compliance_warning(test, modulus),
        _correlation_warning(modulus),
        _curvature_note(test, modulus),
        _loss_warning(cycles),
    ]
    return [caution for caution in warnings if caution]


def _friction_warning(test: StressStrain, options: StiffnessOptions) -> Caution | None:
    if test.loading != "compression" or options.lubricated:
        return None
    shape_factor = test.specimen.shape_factor
    ratio = None if shape_factor is None else bonded_ratio(shape_factor)
    if shape_factor is None or ratio is None:
        return warning(
            "friction on dry platens increases the apparent modulus; the increase cannot be estimated without height "
            "and area, or for a flat pad"
        )
    return warning(
        f"if friction prevents the ends from sliding, the modulus is up to {100 * (ratio - 1):.0f} % too high (shape "
        f"factor {shape_factor:.3g}), and that of the material is {1 / ratio:.2f} to 1 times this value; specify "
        "--lubricated if the ends slid"
    )


def _dimension_warning(test: StressStrain, modulus: Young) -> Caution | None:
    per_mm = test.specimen.area_error_per_mm
    if not test.area_used or modulus.u_dimensions_MPa is not None or per_mm is None:
        return None
    return warning(
        "the uncertainty of the modulus does not include that of the dimensions (--u-geometry-mm): "
        f"0.05 mm on each side would make the area uncertain by {100 * 0.05 * per_mm:.1g} %"
    )


def _compliance_warning(test: StressStrain, modulus: Young) -> Caution | None:
    area, length = test.specimen.area_mm2, test.specimen.length_mm
    if not test.from_displacement or test.compliance_removed or area is None or length is None:
        return None
    stiffness = modulus.modulus_MPa * area / length
    return warning(
        f"the strain includes the deformation of machine and fixture: if their stiffness is {100 * stiffness:.2g} "
        f"N/mm, the modulus is 1 % too low, because the stiffness of the specimen is {stiffness:.2g} "
        "N/mm; subtract this deformation with --compliance-mm-per-N"
    )


def _correlation_warning(modulus: Young) -> Caution | None:
    if modulus.effective_points >= _MIN_EFFECTIVE_POINTS:
        return None
    return warning(
        f"the {modulus.points} points of the modulus are equivalent to {modulus.effective_points:.1f} independent "
        f"points, because neighbouring residuals are correlated; below {_MIN_EFFECTIVE_POINTS:g}, the interval is too "
        "narrow"
    )


def _curvature_note(test: StressStrain, modulus: Young) -> Caution | None:
    if test.loading == "both":
        return None
    low, high = modulus.strain_range
    ratio = ideal_ratio(test.mode, test.sign, (low, min(high, 0.9) if test.sign < 0 else high))
    if abs(ratio - 1) < _MAX_SLOPE_CHANGE:
        return None
    difference = f"{100 * abs(ratio - 1):.0f} % {'higher' if ratio > 1 else 'lower'}"
    return note(
        f"over {100 * low:.3g} to {100 * high:.3g} % strain, the slope of an ideal rubber is {difference} than its "
        "modulus at zero strain: expect the modulus over this range to differ similarly from a model's initial modulus"
    )


def _loss_warning(cycles: Sequence[Cycle]) -> Caution | None:
    losses = [cycle.loss_fraction for cycle in cycles if cycle.loss_fraction is not None]
    if not losses or losses[-1] < _MAX_LOSS:
        return None
    return warning(
        f"{100 * losses[-1]:.0f} % of the work absorbed in cycle {len(losses)} is lost: a hyperelastic model includes "
        "no loss and describes only the loading"
    )

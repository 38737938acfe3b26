"""Evaluation of a single specimen, and averaging over several specimens of a material.

Every specimen is evaluated in the same way: toe, modulus, secants, cycles, extremes, and warnings about their
limitations. A material's modulus is the mean over its specimens, with the uncertainty of the mean from their scatter:
specimens are replicates, cycles and points are not. For a single specimen, its own uncertainty is reported and labelled
accordingly.

`evaluate` evaluates a test with `StiffnessOptions`; `mean_modulus` averages several.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from solen.material.regression import t_quantile
from solen.material.rows import RowOptions
from solen.material.stiffness.cycles import Cycle, Softening, cycles_of, loading_curve, rereferenced, softening
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
from solen.material.stiffness.specimen import held_ends
from solen.material.stiffness.stress_strain import StressStrain
from solen.material.stiffness.toe import Toe, find_toe
from solen.ranks import Caution, note, warning
from solen.results import Result, reported
from solen.spec.strict import Above0, Finite, refused

_WORTH = 8.0  # number of effective points below which an interval is too narrow
_BENT = 0.05  # relative change of an ideal rubber's slope above which to warn
_LOSSY = 0.1


class StiffnessOptions(RowOptions):
    """Options for evaluating mechanical tests and for fitting models to them."""

    mode: TestMode | None = None
    """Mode of the tests; uniaxial includes both directions by their signs. Default: inferred from the files."""
    strain_range_percent: tuple[Finite, Finite] | None = None
    """Lowest and highest strain of the modulus in percent, for example 0.05 0.25."""
    secant_percent: tuple[Above0, ...] = ()
    """Strains at which stress over strain is computed."""
    toe: Literal["auto", "none", "always"] = "auto"
    """Toe compensation; auto: if strain is computed from displacement and the machine set no zero at a preload."""
    cycle: Literal["first", "last"] = "first"
    """Cycle whose loading is used for modulus and model."""
    fit: tuple[Literal["auto", "none", "all", Kind], ...] = ("auto",)
    """Models: auto (all of them, for rubbers), all, none, or names of models."""
    weighting: Weighting = "absolute"
    """Weighting of stress errors in the fits: absolute or relative."""
    lubricated: bool = False
    """The ends of a compressed specimen slid on the platens."""
    compliance_mm_per_N: Finite = Field(0.0, ge=0.0)
    """Compliance of machine and fixture in mm/N; its effect is subtracted from the displacement."""

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if (ends := self.strain_range_percent) is not None and not 0.0 <= ends[0] < ends[1]:
            limit = "must be two numbers of at least 0, the lower first"
            raise refused("strain_range_percent", limit, value=f"{ends[0]:g} {ends[1]:g}")
        return self


@dataclass(frozen=True)
class Secant:
    """Stress over strain at a strain (magnitude); None if that is not reached."""

    strain: float
    secant_MPa: float | None


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Results for one specimen.

    Attributes
    ----------
    test
        The test, with strains counted from the toe's zero.
    toe, young, extremes, cycles, softening
        Toe, modulus, strength and break, cycles, and softening.
    secants
        Stress over strain at each requested strain.
    fitted
        The loading curve for fits of models.
    warnings
        Warnings, in sentences with numbers.
    name, file
        Name of the specimen, and of its file.
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
        Mean, standard uncertainty of the mean, and interval from Student's t; for one specimen, its own values. Few
        specimens may agree by chance: if they differ by less than their own uncertainties, those are used instead.
    sd_modulus_MPa
        Standard deviation between specimens; None for one specimen.
    """

    modulus_MPa: float
    u_modulus_MPa: float
    interval95_modulus_MPa: tuple[float, float]
    sd_modulus_MPa: float | None


def evaluate(test: StressStrain, options: StiffnessOptions, strain_range: Range | None = None) -> Evaluated:
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
    counted = test.shifted(toe.shift)
    cycles = cycles_of(counted)
    used = rereferenced(counted) if cycle == "last" else counted
    if (percent := options.strain_range_percent) is not None:
        strain_range = (percent[0] / 100, percent[1] / 100)
    wanted = strain_range or default_range(used, cycle)
    modulus = young(used, wanted, cycle)
    secants = [percent / 100 for percent in options.secant_percent] or [wanted[1]]
    return Evaluated(
        test=counted,
        toe=toe,
        young=modulus,
        secants=tuple(Secant(strain, secant(used, strain, cycle)) for strain in secants),
        extremes=extremes(counted),
        cycles=cycles,
        softening=softening(cycles),
        fitted=loading_curve(used, cycle, toe.end if cycle == "first" else 0.0),
        warnings=(*test.warnings, *_warnings(used, modulus, options, cycles)),
    )


def mean_modulus(moduli: Sequence[Young]) -> MeanModulus:
    """Return the mean over specimens tested in the same mode."""
    values = np.array([each.modulus_MPa for each in moduli])
    mean, sd, root = float(values.mean()), None, math.sqrt(len(values))
    if len(values) == 1:
        u, interval = moduli[0].u_modulus_MPa, moduli[0].interval95_modulus_MPa
    else:
        sd, own = float(values.std(ddof=1)), math.sqrt(float(np.mean([each.u_modulus_MPa**2 for each in moduli])))
        half = max(t_quantile(0.95, len(values) - 1) * sd, 1.959964 * own) / root
        u, interval = max(sd, own) / root, (mean - half, mean + half)
    return MeanModulus(modulus_MPa=mean, u_modulus_MPa=u, interval95_modulus_MPa=interval, sd_modulus_MPa=sd)


def _toe(test: StressStrain, wanted: str) -> Toe:
    if wanted == "none":
        return Toe(0.0, None, 0.0, "no toe compensation, as requested")
    if wanted == "auto" and test.preload:
        return Toe(
            0.0, None, 0.0, f"no toe compensation: the testing machine was zeroed at its preload ({test.preload})"
        )
    if wanted == "auto" and not test.from_displacement:
        return Toe(0.0, None, 0.0, "no toe compensation: the file contains the strain itself")
    return find_toe(test)


def _warnings(test: StressStrain, modulus: Young, options: StiffnessOptions, cycles: Sequence[Cycle]) -> list[Caution]:
    """Return warnings about the numbers of a test."""
    warnings = [
        _of_friction(test, options),
        _of_dimensions(test, modulus),
        _of_compliance(test, modulus),
        _of_points(modulus),
        _of_bending(test, modulus),
        _of_loss(cycles),
    ]
    return [each for each in warnings if each]


def _of_friction(test: StressStrain, options: StiffnessOptions) -> Caution | None:
    if test.loading != "compression" or options.lubricated:
        return None
    shape = test.specimen.shape_factor
    ratio = None if shape is None else held_ends(shape)
    if shape is None or ratio is None:
        return warning(
            "compression between dry platens overestimates the modulus; height and area are needed to estimate by "
            "how much"
        )
    return warning(
        f"shape factor {shape:.3g}: if the platens hold the ends, the modulus appears up to {100 * (ratio - 1):.0f} "
        f"% too high, and the material's modulus is {1 / ratio:.2f} to 1 times this value; specify "
        "--lubricated if the ends slid"
    )


def _of_dimensions(test: StressStrain, modulus: Young) -> Caution | None:
    per_mm = test.specimen.area_error_per_mm
    if not test.area_used or modulus.u_dimensions_MPa is not None or per_mm is None:
        return None
    return warning(
        "the uncertainty of the modulus does not include the specimen's dimensions (--u-geometry-mm): "
        f"0.05 mm on each side would make the area uncertain by {100 * 0.05 * per_mm:.1g} %"
    )


def _of_compliance(test: StressStrain, modulus: Young) -> Caution | None:
    area, length = test.specimen.area_mm2, test.specimen.length_mm
    if not test.from_displacement or test.compliance_removed or area is None or length is None:
        return None
    stiffness = modulus.modulus_MPa * area / length
    return warning(
        f"the strain includes the deformation of machine and fixture: if their stiffness is {100 * stiffness:.2g} "
        f"N/mm, the modulus is 1 % too low, because the stiffness of the specimen is {stiffness:.2g} "
        "N/mm; subtract this deformation with --compliance-mm-per-N"
    )


def _of_points(modulus: Young) -> Caution | None:
    if modulus.effective_points >= _WORTH:
        return None
    return warning(
        f"the {modulus.points} points of the modulus count as {modulus.effective_points:.1f} independent "
        "points, because neighbouring residuals correlate; below 8 the interval is too narrow"
    )


def _of_bending(test: StressStrain, modulus: Young) -> Caution | None:
    if test.loading == "both":
        return None
    low, high = modulus.strain_range
    ratio = ideal_ratio(test.mode, test.sign, (low, min(high, 0.9) if test.sign < 0 else high))
    if abs(ratio - 1) < _BENT:
        return None
    off = f"{100 * abs(ratio - 1):.0f} % {'higher' if ratio > 1 else 'lower'}"
    return note(
        f"over {100 * low:.3g} to {100 * high:.3g} % strain an ideal rubber's slope is {off} than "
        "its modulus at zero strain, to which a model's initial modulus corresponds"
    )


def _of_loss(cycles: Sequence[Cycle]) -> Caution | None:
    losses = [each.loss_fraction for each in cycles if each.loss_fraction is not None]
    if not losses or losses[-1] < _LOSSY:
        return None
    return warning(
        f"cycle {len(losses)} loses {100 * losses[-1]:.0f} % of the work absorbed: a hyperelastic "
        "model includes no loss and describes only the loading"
    )

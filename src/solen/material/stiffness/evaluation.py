"""One specimen from its record to its numbers, and several specimens to one material's.

The idea: every specimen is evaluated alike: toe, modulus, secants, cycles, extremes, and warnings with numbers of what
these do not know. A material's modulus is the mean over its specimens, and its uncertainty is that of the mean by their
scatter: specimens are replicates, cycles and points are not. One specimen has no scatter; its own uncertainty is given,
and said to be that.

The interface: `evaluate` a test by `Settings`; `mean_modulus` of several.
"""

# ruff: noqa: N815  units keep their case

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from solen.material.stiffness.cycles import Cycle, Softening, cycles_of, softening
from solen.material.stiffness.hyperelastic import Curve
from solen.material.stiffness.loading import loading_curve, rereferenced
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
from solen.material.stiffness.test import StressStrain
from solen.material.stiffness.toe import Toe, find_toe

TOE = ("auto", "none", "always")
CYCLE = ("first", "last")
_WORTH = 8.0  # effective points below which an interval is known to be too narrow
_BENT = 0.05  # departure of an ideal rubber's slope from its first one that is worth saying
_LOSSY = 0.1


@dataclass(frozen=True)
class Settings:
    """How specimens are evaluated.

    Attributes
    ----------
    strain_range
        Of the modulus, as fractions; None for `default_range`.
    toe
        ``auto``: where the strain is a displacement and the file states no preload; ``always``; ``none``.
    cycle
        ``first`` or ``last``.
    secants
        Strains (magnitudes) at which stress over strain is wanted.
    lubricated
        Whether the platens of a compression test let the ends slide.
    """

    strain_range: Range | None = None
    toe: str = "auto"
    cycle: str = "first"
    secants: tuple[float, ...] = ()
    lubricated: bool = False


@dataclass(frozen=True)
class Evaluated:
    """One specimen's numbers.

    Attributes
    ----------
    test
        With strains counted from the toe's zero.
    toe, young, extremes, cycles, softening
        What was found.
    secants_MPa
        Stress over strain at each strain that was asked for; None where it is not reached.
    curve
        The loading, to fit models to.
    warnings
        Sentences with numbers.
    """

    test: StressStrain
    toe: Toe
    young: Young
    secants_MPa: tuple[tuple[float, float | None], ...]
    extremes: Extremes
    cycles: tuple[Cycle, ...]
    softening: Softening | None
    curve: Curve
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class MeanModulus:
    """Modulus over specimens.

    Attributes
    ----------
    modulus_MPa, u_modulus_MPa, interval95_MPa
        Mean, standard uncertainty of the mean, and interval by Student's t; those of the specimen where it is one. Few
        specimens may agree by chance: where they differ by less than each is uncertain, that is taken instead.
    sd_modulus_MPa
        Standard deviation between specimens; None for one.
    specimens
        How many.
    """

    modulus_MPa: float
    u_modulus_MPa: float
    interval95_MPa: tuple[float, float]
    sd_modulus_MPa: float | None
    specimens: int


def evaluate(test: StressStrain, settings: Settings) -> Evaluated:
    """Numbers of one test.

    Raises
    ------
    DataError
        Where the range of the modulus holds too few points, or the test is never loaded.
    """
    toe = _toe(test, settings.toe)
    counted = test.shifted(toe.shift)
    found = cycles_of(counted)
    used = rereferenced(counted) if settings.cycle == "last" else counted
    wanted = settings.strain_range or default_range(used, settings.cycle)
    modulus = young(used, wanted, settings.cycle)
    softened = softening(found)
    return Evaluated(
        test=counted,
        toe=toe,
        young=modulus,
        secants_MPa=tuple((s, secant(used, s, settings.cycle)) for s in settings.secants or (wanted[1],)),
        extremes=extremes(counted),
        cycles=found,
        softening=softened,
        curve=loading_curve(used, settings.cycle, toe.end if settings.cycle == "first" else 0.0),
        warnings=(*test.warnings, *_warnings(used, modulus, settings, found)),
    )


def mean_modulus(found: Sequence[Young]) -> MeanModulus:
    """Mean over specimens of one kind of test."""
    from scipy.stats import t

    values = np.array([each.modulus_MPa for each in found])
    if len(values) == 1:
        only = found[0]
        return MeanModulus(only.modulus_MPa, only.u_modulus_MPa, only.interval95_MPa, None, 1)
    mean, sd, root = float(values.mean()), float(values.std(ddof=1)), math.sqrt(len(values))
    own = math.sqrt(float(np.mean([each.u_modulus_MPa**2 for each in found])))
    half = max(float(t.ppf(0.975, len(values) - 1)) * sd, 1.959964 * own) / root
    return MeanModulus(mean, max(sd, own) / root, (mean - half, mean + half), sd, len(values))


def _toe(test: StressStrain, wanted: str) -> Toe:
    if wanted == "none":
        return Toe(0.0, None, 0.0, "no toe compensation, as asked")
    if wanted == "auto" and test.preload:
        return Toe(0.0, None, 0.0, f"no toe compensation: the machine set zero at its preload ({test.preload})")
    if wanted == "auto" and not test.from_displacement:
        return Toe(0.0, None, 0.0, "no toe compensation: the file states the strain itself")
    return find_toe(test)


def _warnings(test: StressStrain, found: Young, settings: Settings, cycled: Sequence[Cycle]) -> list[str]:
    """What the numbers of a test do not know."""
    told = [
        _of_friction(test, settings),
        _of_dimensions(test, found),
        _of_compliance(test, found),
        _of_points(found),
        _of_bending(test, found),
        _of_loss(cycled),
    ]
    return [each for each in told if each]


def _of_friction(test: StressStrain, settings: Settings) -> str:
    if test.loading != "compression" or settings.lubricated:
        return ""
    shape = test.specimen.shape_factor
    ratio = None if shape is None else held_ends(shape)
    if shape is None or ratio is None:
        return "compression between dry platens overestimates the modulus; height and area would tell by how much"
    return (
        f"shape factor {shape:.3g}: platens that hold the ends let the modulus appear up to {100 * (ratio - 1):.0f} % "
        f"too high: the material's lies between {1 / ratio:.2f} and 1 of it; --lubricated says that the ends slid"
    )


def _of_dimensions(test: StressStrain, found: Young) -> str:
    per_mm = test.specimen.area_error_per_mm
    if not test.area_used or found.u_dimensions_MPa is not None or per_mm is None:
        return ""
    return (
        "the uncertainty of the modulus leaves out the specimen's dimensions (--u-geometry-mm): "
        f"0.05 mm on each side would make the area uncertain by {100 * 0.05 * per_mm:.1g} %"
    )


def _of_compliance(test: StressStrain, found: Young) -> str:
    area, length = test.specimen.area_mm2, test.specimen.length_mm
    if not test.from_displacement or test.compliance_removed or area is None or length is None:
        return ""
    stiffness = found.modulus_MPa * area / length
    return (
        f"the strain holds what machine and fixture give way: with {100 * stiffness:.2g} N/mm they make it 1 % "
        f"too low, as the specimen has {stiffness:.2g} N/mm; --compliance-mm-per-n takes it off"
    )


def _of_points(found: Young) -> str:
    if found.effective_points >= _WORTH:
        return ""
    return (
        f"the {found.points} points of the modulus are worth {found.effective_points:.1f} independent ones, as "
        "neighbouring residuals are alike; below 8 its interval is too narrow"
    )


def _of_bending(test: StressStrain, found: Young) -> str:
    if test.loading == "both":
        return ""
    low, high = found.strain_range
    ratio = ideal_ratio(test.mode, test.sign, (low, min(high, 0.9) if test.sign < 0 else high))
    if abs(ratio - 1) < _BENT:
        return ""
    off = f"{100 * abs(ratio - 1):.0f} % {'higher' if ratio > 1 else 'lower'}"
    return (
        f"over {100 * low:.3g} to {100 * high:.3g} % strain an ideal rubber's slope is {off} than its modulus at zero "
        "strain, which a model's initial modulus gives"
    )


def _of_loss(cycled: Sequence[Cycle]) -> str:
    losses = [each.loss_fraction for each in cycled if each.loss_fraction is not None]
    if not losses or losses[-1] < _LOSSY:
        return ""
    return (
        f"cycle {len(losses)} loses {100 * losses[-1]:.0f} % of the work put in: a hyperelastic model has no such loss "
        "and describes the loading only"
    )


def with_range(settings: Settings, strain_range: Range) -> Settings:
    """The same settings with a range of the modulus."""
    return replace(settings, strain_range=strain_range)

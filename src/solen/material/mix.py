"""Mixing by weight: masses to weigh, the effect of the balance's readability, and an estimate of the mixture's index.

"25 % of additive" has two meanings. As a fraction of the whole mixture, 25 g of additive are added to 75 g of the base;
relative to the base, 25 g are added to 100 g of the base, which makes 20 % of the mixture. `of_whole` and `on_base`
implement these meanings, and both results are shown. The masses are rounded to the readability of the balance, and the
resulting errors of the fractions are reported.

The index of a mixture is estimated by the Lorentz-Lorenz rule, (n² − 1)/(n² + 2) = Σ φᵢ (nᵢ² − 1)/(nᵢ² + 2), with
volume fractions φᵢ and additive volumes (H. A. Lorentz, Ann. Phys. 245, 641, 1880; L. Lorenz, Ann. Phys. 247, 70,
1880). The rule applies to the liquid: curing shrinks the resin and raises its index, so the estimate does not replace a
measurement.

`mixtures` returns the masses for components and `MixOptions`, in the steps `of_whole`, `on_base` and `weighed`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Self

from pydantic import Field, model_validator

from solen.errors import SpecError
from solen.results import Result, reported
from solen.spec.strict import Options, nearest, refused

TOTAL_PERCENT = 100.0
MAX_TOTAL_ERROR_PERCENT = 0.1
"""Largest deviation of a sum of fractions from 100 % that is attributed to rounding."""
MAX_G, MIN_G = 1e6, 1e-6


class MixOptions(Options):
    """Amount to mix, and optional properties of the components."""

    total_g: float | None = Field(None, gt=0.0, le=MAX_G)
    """Mass of the whole mixture in g; default: 100."""
    base_g: float | None = Field(None, gt=0.0, le=MAX_G)
    """Mass of the available base in g, instead of --total-g."""
    density: tuple[str, ...] = ()
    """Density of a component in g/mL, for example "lauryl acrylate:0.884"; repeatable."""
    index: tuple[str, ...] = ()
    """Index of a liquid component, for example "lauryl acrylate:1.44"; repeatable. If the index and the density of
    every component are given, the index of the mixture is estimated.
    """
    resolution_g: float = Field(0.01, ge=MIN_G)
    """Readability of the balance in g."""

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        if self.total_g is not None and self.base_g is not None:
            raise refused("base_g", "cannot be combined with --total-g", remedy="omit one of the two")
        if self.resolution_g > (mass_g := self.base_g or self.total_g or TOTAL_PERCENT):
            limit = f"must be at most the mass to weigh, {mass_g:g} g"
            raise refused("resolution_g", limit, value=self.resolution_g)
        return self


@dataclass(frozen=True)
class Component:
    """A component: its mass fraction in per cent and, optionally, its density in g/mL and its index as a liquid."""

    name: str
    percent: float
    density_g_per_mL: float | None = None  # noqa: N815  units keep their case
    index: float | None = None


@dataclass(frozen=True)
class Weighed:
    """A component of a mixture as it is weighed.

    Attributes
    ----------
    name
        Name of the component.
    wt_percent
        Intended mass fraction in the mixture.
    phr
        Grams per 100 g of the base, the first component.
    exact_g, weighed_g
        Intended mass, and this mass rounded to the readability of the balance.
    weighed_wt_percent
        Mass fraction that results from the rounded masses.
    worst_wt_percent
        Largest error of the fraction if each mass is wrong by half the readability.
    volume_mL, volume_percent
        Volume of the rounded mass, and its fraction of the total volume; None if a required density is not known.
    """

    name: str
    wt_percent: float
    phr: float
    exact_g: float
    weighed_g: float
    weighed_wt_percent: float
    worst_wt_percent: float
    volume_mL: float | None  # noqa: N815
    volume_percent: float | None

    @reported
    def error_wt_percent(self) -> float:
        """Deviation of the fraction as weighed from the intended fraction."""
        return self.weighed_wt_percent - self.wt_percent


@dataclass(frozen=True)
class Mixture:
    """Components for one meaning of the percentages, and the liquid's index, None if it cannot be estimated."""

    components: tuple[Weighed, ...]
    index_estimate: float | None

    @reported
    def total_g(self) -> float:
        """Sum of the masses to weigh."""
        return math.fsum(part.weighed_g for part in self.components)


class Mixtures(Result):
    """Masses to weigh, for both meanings of the percentages.

    Attributes
    ----------
    of_whole, on_base
        Mixture if the percentages are fractions of the whole mixture, or grams per 100 g of the base.
    base
        Name of the first component.
    total_g, base_g, resolution_g
        Requested mass of the whole mixture or of the base (the other is None), and readability of the balance.
    """

    of_whole: Mixture
    on_base: Mixture
    base: str
    total_g: float | None
    base_g: float | None
    resolution_g: float


def mixtures(components: Sequence[str], options: MixOptions = MixOptions()) -> Mixtures:
    """Return the masses of a mixture for both meanings of its percentages.

    Parameters
    ----------
    components
        Names with mass fractions in per cent, ``name:percent``, the base first.
    options
        Amount to mix, and properties of the components.

    Raises
    ------
    SpecError
        If a component is not a name and a number, the fractions do not add up to 100 %, or a number is impossible.
    """
    densities = dict(named_number(text, "--density") for text in options.density)
    indices = dict(named_number(text, "--index") for text in options.index)
    parts = with_properties([Component(*named_number(text, "component")) for text in components], densities, indices)
    check_components(parts)
    if options.total_g is None and options.base_g is None:
        options = options.model_copy(update={"total_g": TOTAL_PERCENT})
    return Mixtures(
        weighed(of_whole(parts), options),
        weighed(on_base(parts), options),
        parts[0].name,
        options.total_g,
        options.base_g,
        options.resolution_g,
    )


def named_number(text: str, what: str) -> tuple[str, float]:
    """Return the name and number of ``name:number``; a per cent sign may follow."""
    name, colon, number = text.rpartition(":")
    try:
        value = float(number.strip().removesuffix("%"))
    except ValueError:
        value = math.nan
    if not (colon and name.strip() and math.isfinite(value)):
        raise SpecError(
            what, value=text, limit="is not of the form name:number", remedy='for example "lauryl acrylate:25"'
        )
    return name.strip(), value


def of_whole(components: Sequence[Component]) -> tuple[Component, ...]:
    """Return components whose percentages are fractions of the whole mixture, scaled to a sum of exactly 100 %.

    Raises
    ------
    SpecError
        If the sum deviates from 100 % by more than rounding explains.
    """
    total = math.fsum(part.percent for part in components)
    if abs(total - TOTAL_PERCENT) > MAX_TOTAL_ERROR_PERCENT:
        ratio = " ".join(f'"{part.name}:{part.percent / total * TOTAL_PERCENT:.4g}"' for part in components)
        limit = f"the fractions must add up to {TOTAL_PERCENT:g} %, to within {MAX_TOTAL_ERROR_PERCENT:g} %"
        raise SpecError("mixture", value=f"{total:g} %", limit=limit, remedy=f"for the same ratio, write {ratio}")
    return tuple(replace(part, percent=part.percent / total * TOTAL_PERCENT) for part in components)


def on_base(components: Sequence[Component]) -> tuple[Component, ...]:
    """Return the components with fractions of the whole, from percentages that mean grams per 100 g of the first."""
    base, *others = components
    total = TOTAL_PERCENT + math.fsum(part.percent for part in others)
    parts = (replace(base, percent=TOTAL_PERCENT), *others)
    return tuple(replace(part, percent=part.percent / total * TOTAL_PERCENT) for part in parts)


def check_components(components: Sequence[Component]) -> None:
    """Raise `SpecError` unless there are at least two different components with physical values."""
    if len(components) < 2:
        raise SpecError(
            "mixture", value=len(components), limit="requires at least 2 components", remedy='add one, as in "LA:25"'
        )
    names = [part.name for part in components]
    for part in components:
        if names.count(part.name) > 1:
            raise SpecError(part.name, limit="is named twice", remedy="add up its fractions")
        if not 0.0 < part.percent <= TOTAL_PERCENT:
            raise SpecError(f"fraction of {part.name}", value=part.percent, limit="must be above 0 and at most 100 %")
        if part.density_g_per_mL is not None and not 0.0 < part.density_g_per_mL < 30.0:
            limit = "must be above 0 and below 30 g/mL"
            raise SpecError(f"density of {part.name}", value=part.density_g_per_mL, limit=limit)
        if part.index is not None and not 1.0 <= part.index < 5.0:
            raise SpecError(f"index of {part.name}", value=part.index, limit="must be at least 1 and below 5")


def with_properties(
    components: Sequence[Component],
    densities: dict[str, float],
    indices: dict[str, float],
) -> tuple[Component, ...]:
    """Return components with densities in g/mL and indices that are keyed by name; `SpecError` for an unknown name."""
    names = [part.name for part in components]
    for option, numbers in (("--density", densities), ("--index", indices)):
        for name in numbers:
            if name not in names:
                near = nearest(name, names)
                remedy = f"did you mean {near}?" if near else f"the components are {', '.join(names)}"
                raise SpecError(option, value=name, limit="is not a component of the mixture", remedy=remedy)
    return tuple(
        replace(part, density_g_per_mL=densities.get(part.name), index=indices.get(part.name)) for part in components
    )


def weighed(components: Sequence[Component], options: MixOptions) -> Mixture:
    """Return the mixture with the mass to weigh of each component.

    Parameters
    ----------
    components
        Components with fractions of the whole mixture, the base first.
    options
        Mass of the whole mixture or of the base, and the readability of the balance.

    Raises
    ------
    SpecError
        If a mass is rounded to 0.
    """
    base_g, resolution_g = options.base_g, options.resolution_g
    base = components[0]
    total_g = (options.total_g or TOTAL_PERCENT) if base_g is None else base_g / base.percent * TOTAL_PERCENT
    exact = [part.percent / TOTAL_PERCENT * total_g for part in components]
    masses = [float(round(grams / resolution_g) * Decimal(repr(resolution_g))) for grams in exact]
    if base_g is not None:
        masses[0] = base_g
    for part, grams, mass in zip(components, exact, masses, strict=True):
        if mass <= 0.0:
            limit = f"is less than half the readability of the balance, {resolution_g:g} g"
            raise SpecError(f"mass of {part.name}", value=f"{grams:g} g", limit=limit, remedy="mix a larger amount")
    sum_g = math.fsum(masses)
    volumes = [
        None if part.density_g_per_mL is None else mass / part.density_g_per_mL
        for part, mass in zip(components, masses, strict=True)
    ]
    known_ml = [volume for volume in volumes if volume is not None]
    sum_ml = math.fsum(known_ml) if len(known_ml) == len(volumes) else None
    return Mixture(
        tuple(
            Weighed(
                name=part.name,
                wt_percent=part.percent,
                phr=part.percent / base.percent * TOTAL_PERCENT,
                exact_g=grams,
                weighed_g=mass,
                weighed_wt_percent=mass / sum_g * TOTAL_PERCENT,
                worst_wt_percent=_max_error_percent(mass / sum_g, len(masses), resolution_g / sum_g),
                volume_mL=volume,
                volume_percent=None if volume is None or sum_ml is None else volume / sum_ml * TOTAL_PERCENT,
            )
            for part, grams, mass, volume in zip(components, exact, masses, volumes, strict=True)
        ),
        _index([part.index for part in components], volumes),
    )


def _max_error_percent(fraction: float, count: int, step: float) -> float:
    """Return the largest error of a mass fraction in per cent if each of the masses is wrong by half a step.

    The step is given as a fraction of the total mass. To first order, an error e of the component's own mass, also as a
    fraction of the total, changes its fraction f by (1 − f) e, and an error of any other mass changes it by −f e.
    """
    return TOTAL_PERCENT * 0.5 * step * ((1.0 - fraction) + (count - 1) * fraction)


def _index(indices: Sequence[float | None], volumes: Sequence[float | None]) -> float | None:
    """Return the index of the liquid mixture by the Lorentz-Lorenz rule; None if a required number is not known."""
    pairs = [(n, v) for n, v in zip(indices, volumes, strict=True) if n is not None and v is not None]
    if len(pairs) < len(indices):
        return None
    total = math.fsum(volume for _, volume in pairs)
    refraction = math.fsum(volume / total * (n * n - 1.0) / (n * n + 2.0) for n, volume in pairs)
    return math.sqrt((1.0 + 2.0 * refraction) / (1.0 - refraction))

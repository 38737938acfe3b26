"""Mixing by weight: masses to weigh in, the effect of the balance's steps, and an estimate of the mixture's index.

"25 % of additive" has two meanings. As a fraction of the complete mixture, 25 g of additive are added to 75 g of the
base; relative to the resin, 25 g are added to 100 g of the base, which makes 20 % of the mixture. `of_whole` and
`on_base` implement these meanings, and both results are shown. A balance weighs in steps: the masses are rounded to
them, and the effect on the fractions is reported.

The index of a mixture is estimated by the Lorentz-Lorenz rule, (n² − 1)/(n² + 2) = Σ φ (nᵢ² − 1)/(nᵢ² + 2), with volume
fractions φ and additive volumes (H. A. Lorentz, Ann. Phys. 245, 641, 1880; L. Lorenz, Ann. Phys. 247, 70, 1880). It
applies to the liquid: curing shrinks the resin and raises its index, so the estimate does not replace a measurement.

`mixtures` returns the masses for components and `MixOptions`; `of_whole`, `on_base` and `weighed` are its steps.
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

WHOLE = 100.0
OFF_WHOLE = 0.1
"""Largest deviation of the sum of fractions from 100 %, in per cent, that is attributed to rounding."""
MAX_G, MIN_G = 1e6, 1e-6


class MixOptions(Options):
    """Amount to mix, and optional properties of the components."""

    total_g: float | None = Field(None, gt=0.0, le=MAX_G)
    """Mass of the complete mixture in g; default: 100."""
    base_g: float | None = Field(None, gt=0.0, le=MAX_G)
    """Mass of the available base in g, instead of --total-g."""
    density: tuple[str, ...] = ()
    """Density in g/mL of a component, "lauryl acrylate:0.884"; repeatable."""
    index: tuple[str, ...] = ()
    """Index of a liquid component, written like a density; with both for all components, the mixture's index is
    estimated.
    """
    resolution_g: float = Field(0.01, ge=MIN_G)
    """Step of the balance in g."""

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        if self.total_g is not None and self.base_g is not None:
            raise refused(
                "base_g", "specify either the total mass or the mass of the base", remedy="--total-g or --base-g"
            )
        if self.resolution_g > (mass_g := self.base_g or self.total_g or WHOLE):
            raise refused("resolution_g", f"must be at most the mass, {mass_g:g} g", value=self.resolution_g)
        return self


@dataclass(frozen=True)
class Component:
    """A component: its fraction in per cent and, optionally, its density in g/mL and its index as a liquid."""

    name: str
    percent: float
    density_g_per_mL: float | None = None  # noqa: N815  units keep their case
    index: float | None = None


@dataclass(frozen=True)
class Weighed:
    """A component of a mixture as it is weighed in.

    Attributes
    ----------
    name
        Name of the component.
    wt_percent
        Intended fraction of the whole mixture.
    phr
        Grams per 100 g of the base, the first component.
    exact_g, weighed_g
        Intended mass, and the mass rounded to whole steps of the balance.
    weighed_wt_percent
        Fraction of the whole that results from the weighed masses.
    worst_wt_percent
        Largest error of the fraction if each mass is off by half a step.
    volume_mL, volume_percent
        Volume of the weighed mass, and its fraction; None if a required density is not known.
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
        """Deviation of the fraction, as weighed, from the intended one."""
        return self.weighed_wt_percent - self.wt_percent


@dataclass(frozen=True)
class Mixture:
    """Components for one meaning of the percentages, and the liquid's index; None if it cannot be estimated."""

    components: tuple[Weighed, ...]
    index_estimate: float | None

    @reported
    def total_g(self) -> float:
        """Sum of the masses to weigh in."""
        return math.fsum(part.weighed_g for part in self.components)


class Mixtures(Result):
    """Masses to weigh in, for both meanings of the percentages.

    Attributes
    ----------
    of_whole, on_base
        Percentages as fractions of the whole mixture; as grams per 100 g of the base.
    base
        The first component.
    total_g, base_g, resolution_g
        Mass of the whole, or of the base, and step of the balance.
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
        ``name:share``, mass fractions in per cent, the base first.
    options
        Amount to mix.

    Raises
    ------
    SpecError
        If a component is not a name and a fraction, the fractions do not add up to 100 %, or a number is impossible.
    """
    parts = [Component(*named_number(text, "component")) for text in components]
    check_components(parts)
    densities = dict(named_number(text, "--density") for text in options.density)
    indices = dict(named_number(text, "--index") for text in options.index)
    parts = list(with_known(parts, densities, indices))
    check_components(parts)
    if options.total_g is None and options.base_g is None:
        options = options.model_copy(update={"total_g": WHOLE})
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
    """Return components by their fraction of the complete mixture; `SpecError` if the fractions do not add up to 100 %.

    Fractions that miss 100 % only by rounding are scaled to it.
    """
    total = math.fsum(part.percent for part in components)
    if abs(total - WHOLE) > OFF_WHOLE:
        ratio = ", ".join(f"{part.name}:{part.percent / total * WHOLE:.4g}" for part in components)
        limit = f"the fractions must add up to {WHOLE:g} %, to within {OFF_WHOLE:g} %"
        raise SpecError("mixture", value=f"{total:g} %", limit=limit, remedy=f"in this ratio, the parts are {ratio}")
    return tuple(replace(part, percent=part.percent / total * WHOLE) for part in components)


def on_base(components: Sequence[Component]) -> tuple[Component, ...]:
    """Return fractions of the complete mixture if the percentages mean grams per 100 g of the first component."""
    base, *others = components
    total = WHOLE + math.fsum(part.percent for part in others)
    parts = (replace(base, percent=WHOLE), *others)
    return tuple(replace(part, percent=part.percent / total * WHOLE) for part in parts)


def check_components(components: Sequence[Component]) -> None:
    """Raise `SpecError` unless there are two or more different components with possible fraction, density and index."""
    if len(components) < 2:
        raise SpecError(
            "mixture", value=len(components), limit="requires at least 2 components", remedy='as in "LA:25"'
        )
    names = [part.name for part in components]
    for part in components:
        if names.count(part.name) > 1:
            raise SpecError(part.name, limit="is named twice", remedy="add up its fractions")
        if not 0.0 < part.percent <= WHOLE:
            raise SpecError(f"share of {part.name}", value=part.percent, limit="must be above 0 and at most 100 %")
        if part.density_g_per_mL is not None and not 0.0 < part.density_g_per_mL < 30.0:
            limit = "must be above 0 and below 30 g/mL"
            raise SpecError(f"density of {part.name}", value=part.density_g_per_mL, limit=limit)
        if part.index is not None and not 1.0 <= part.index < 5.0:
            raise SpecError(f"index of {part.name}", value=part.index, limit="must be at least 1 and below 5")


def with_known(
    components: Sequence[Component],
    densities: dict[str, float],
    indices: dict[str, float],
) -> tuple[Component, ...]:
    """Return components with their densities in g/mL and indices by name; `SpecError` for an unknown name."""
    names = [part.name for part in components]
    for what, known in (("density", densities), ("index", indices)):
        for name in known:
            if name not in names:
                near = nearest(name, names)
                remedy = f"did you mean {near}?" if near else f"there are {', '.join(names)}"
                raise SpecError(f"{what} of {name}", limit="is not a component of the mixture", remedy=remedy)
    return tuple(
        replace(part, density_g_per_mL=densities.get(part.name), index=indices.get(part.name)) for part in components
    )


def weighed(components: Sequence[Component], options: MixOptions) -> Mixture:
    """Return the masses of a mixture.

    Parameters
    ----------
    components
        Components by their fraction of the whole, the base first.
    options
        Options with the mass of the whole or of the base, and the step of the balance.

    Raises
    ------
    SpecError
        If the step is too coarse for a component.
    """
    base_g, resolution_g = options.base_g, options.resolution_g
    base = components[0]
    whole_g = (options.total_g or WHOLE) if base_g is None else base_g / base.percent * WHOLE
    exact = [part.percent / WHOLE * whole_g for part in components]
    masses = [float(round(grams / resolution_g) * Decimal(repr(resolution_g))) for grams in exact]
    if base_g is not None:
        masses[0] = base_g
    for part, grams, mass in zip(components, exact, masses, strict=True):
        if mass <= 0.0:
            limit = f"is less than half a step of the balance, {resolution_g:g} g"
            raise SpecError(f"mass of {part.name}", value=f"{grams:g} g", limit=limit, remedy="mix a larger amount")
    sum_g = math.fsum(masses)
    volumes = [
        None if part.density_g_per_mL is None else mass / part.density_g_per_mL
        for part, mass in zip(components, masses, strict=True)
    ]
    known = [volume for volume in volumes if volume is not None]
    sum_ml = math.fsum(known) if len(known) == len(volumes) else None
    return Mixture(
        tuple(
            Weighed(
                name=part.name,
                wt_percent=part.percent,
                phr=part.percent / base.percent * WHOLE,
                exact_g=grams,
                weighed_g=mass,
                weighed_wt_percent=mass / sum_g * WHOLE,
                worst_wt_percent=_worst(mass / sum_g, len(masses), resolution_g / sum_g),
                volume_mL=volume,
                volume_percent=None if volume is None or sum_ml is None else volume / sum_ml * WHOLE,
            )
            for part, grams, mass, volume in zip(components, exact, masses, volumes, strict=True)
        ),
        _index([part.index for part in components], volumes),
    )


def _worst(share: float, count: int, step: float) -> float:
    """Return the error of a fraction, in per cent, if each mass is wrong by half a step, a fraction of the total.

    To first order, an error in the component's own mass changes the fraction by 1 − share, any other error by −share.
    """
    return WHOLE * 0.5 * step * ((1.0 - share) + (count - 1) * share)


def _index(indices: Sequence[float | None], volumes: Sequence[float | None]) -> float | None:
    """Return the index of the liquid mixture by the Lorentz-Lorenz rule; None if a required number is not known."""
    pairs = [(n, v) for n, v in zip(indices, volumes, strict=True) if n is not None and v is not None]
    if len(pairs) < len(indices):
        return None
    whole = math.fsum(volume for _, volume in pairs)
    refraction = math.fsum(volume / whole * (n * n - 1.0) / (n * n + 2.0) for n, volume in pairs)
    return math.sqrt((1.0 + 2.0 * refraction) / (1.0 - refraction))

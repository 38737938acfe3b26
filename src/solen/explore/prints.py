"""Traced prints of a design and surrogates of their merits: yields, costs of tolerances, variation of merits.

The yield comes from a surrogate of every merit, corrected by the traced prints. The surrogate alone gives the cost of
each tolerance and its largest acceptable value.

Public names: `Prints`, `Yield`, `VariedNumber` and `MeritSpread`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.explore.merits import shown
from solen.explore.requirement import Requirement
from solen.explore.surrogate import FOLDS, Surrogate, fit, parts
from solen.explore.variations import Variation, drawn
from solen.results import Result
from solen.sensor import Sensor
from solen.sensor.numbers import number

MODELLED = 2**14
"""Number of samples of the surrogates."""
WANTED_YIELD = 0.95
FAR = 1e100
"""Finite stand-in for an infinite uncertainty of a merit."""


class Yield(Result, eq=True):
    """Fraction of the prints that meet one requirement, or all of them.

    Attributes
    ----------
    requirement
        Text of the requirement; empty for all together.
    share, u_share
        Fraction of the prints without calibration or adjustment.
    calibrated_share, u_calibrated_share
        Fraction after a calibration of each sensor, which removes the null's offset and the gain: null and slope count
        as those of the design; None for a network, whose merits no calibration changes.
    adjusted_share, u_adjusted_share
        Fraction after each print is adjusted as stated, without a calibration; None without an adjustment.
    """

    requirement: str
    share: float
    u_share: float
    calibrated_share: float | None
    u_calibrated_share: float | None
    adjusted_share: float | None = None
    u_adjusted_share: float | None = None


class VariedNumber(Result, eq=True):
    """One number that varies.

    Attributes
    ----------
    key, value
        The number and its value in the design. Numbers that move together have their sum as stated, or the name of
        their common cause, as the key and no value.
    distribution
        ``normal`` or ``uniform``.
    deviation
        Mean and standard deviation, or the ends, of its deviation from that value.
    source
        Source of the distribution: ``stated``, ``[tolerance]`` of the design, ``assumed`` by solen, or the name of a
        process, a part or a resin.
    share_if_exact
        Yield if this number alone did not vary but stayed at `Variation.centre`, from the surrogates; None without
        requirements.
    factor_alone, factor_together
        Factor on its deviation for a yield of 95 %, if it alone is tightened or all are; None if that yield is not
        reached, or without requirements.
    """

    key: str
    value: float | None
    distribution: str
    deviation: tuple[float, float]
    source: str
    share_if_exact: float | None
    factor_alone: float | None
    factor_together: float | None


class MeritSpread(Result):
    """Variation of one merit between prints.

    Attributes
    ----------
    merit
        Name of the merit.
    base, u_base
        Value for the design itself, and its uncertainty.
    mean, sd
        Mean and standard deviation over the prints.
    first_order, total
        Sobol' indices by key, from the surrogate: fraction of the variance due to that number alone, and with others.
    degree
        Degree of the surrogate's polynomial.
    held_out
        Fraction of the variance of held-out prints that the surrogate does not explain.
    """

    merit: str
    base: float
    u_base: float
    mean: float
    sd: float
    first_order: dict[str, float]
    total: dict[str, float]
    degree: int
    held_out: float


@dataclass(frozen=True, eq=False)
class Prints:
    """Traced prints with surrogates of their merits.

    Attributes
    ----------
    variations
        D numbers that vary.
    deviations
        Deviations (P, D) of the prints.
    merits
        Values (P,) of the merits by name.
    base
        Merits of the design itself.
    adjusted
        The same prints after an adjustment, or None without one.
    calibrated
        Merits that a calibration of each sensor sets to those of the design, if the first of them exists.
    """

    variations: Sequence[Variation]
    deviations: FloatArray
    merits: Mapping[str, FloatArray]
    base: Mapping[str, float]
    adjusted: "Prints | None" = None
    calibrated: tuple[str, ...] = ("null_deg", "slope_per_deg")

    @cached_property
    def surrogates(self) -> dict[str, Surrogate]:
        """Surrogates of the merits that exist for enough prints."""
        return {
            name: fit(self.variations, self.deviations, self.merits[name])
            for name in self.merits
            if not name.startswith("u_") and np.isfinite(self.merits[name]).sum() >= 2 * FOLDS
        }

    @cached_property
    def modelled(self) -> FloatArray:
        """Deviations at which the surrogates are evaluated."""
        return drawn(self.variations, MODELLED, 1)

    def met(self, requirements: Sequence[Requirement], merits: Mapping[str, FloatArray]) -> BoolArray:
        """Return a mask of merits (N,) that meet all requirements."""
        size = next(iter(merits.values())).size
        met = np.ones(size, bool)
        for requirement in requirements:
            met &= requirement.met(merits, self.base)
        return met

    def yields(self, requirements: Sequence[Requirement]) -> Iterator[Yield]:
        """Yield the yield of each requirement, and that of all together."""
        groups = [("", requirements)] if requirements else []
        if len(requirements) > 1:
            groups = [*((requirement.text, [requirement]) for requirement in requirements), *groups]
        for text, group in groups:
            after = () if self.adjusted is None else self.adjusted.share(group)
            calibrated = self.share(group, calibrated=True) if self.calibrated else (None, None)
            yield Yield(text, *self.share(group), *calibrated, *after)

    def share(self, requirements: Sequence[Requirement], *, calibrated: bool = False) -> tuple[float, float]:
        """Return the fraction of prints that meet requirements, with its standard uncertainty.

        The fraction of the traced prints is corrected with a control variate: the difference between surrogates fitted
        without each of the prints and the surrogates' fraction over many samples. The weight of the correction
        minimises the scatter; a weight of 0 is counting. The error of the surrogates does not bias the estimate. Its
        uncertainty is that of the mean, combined with the effect of the uncertainties of the merits.
        """
        part = parts(len(self.deviations))
        true = self.met(requirements, self._calibrated(self.merits) if calibrated else self.merits).astype(float)
        modelled, whole = np.empty(true.size), np.empty(true.size)
        for fold in range(FOLDS):
            inside = part == fold
            modelled[inside] = self._by_surrogates(requirements, self.deviations[inside], fold, calibrated=calibrated)
            whole[inside] = self._by_surrogates(requirements, self.modelled, fold, calibrated=calibrated).mean()
        missed = modelled - whole
        scatter = np.cov(true, missed)
        corrected = true - (scatter[0, 1] / scatter[1, 1] if scatter[1, 1] else 0.0) * missed
        u = max(
            float(corrected.std(ddof=1)) / math.sqrt(true.size), 1.0 / (true.size + 2)
        )  # a count of 0 may be chance
        blurred = self._blurred(requirements, calibrated=calibrated)
        return min(max(float(corrected.mean()), 0.0), 1.0), math.hypot(u, blurred)

    def varied(self, sensor: Sensor, requirements: Sequence[Requirement]) -> list[VariedNumber]:
        """Return the numbers that vary and their cost in yield, the costliest first."""
        named = {name for requirement in requirements for name in requirement.merits}
        if not all(np.isfinite(self.merits[name]).all() for name in named):
            requirements = []  # surrogates cannot predict missing merits
        of_all = self._factor(requirements, range(len(self.variations)))
        rows = [
            VariedNumber(
                key=variation.key,
                value=number(sensor, variation.key) if variation.key in variation.weights else None,
                distribution=variation.kind,
                deviation=(variation.first, variation.second),
                source=variation.source,
                share_if_exact=self._scaled(requirements, [place], 0.0) if requirements else None,
                factor_alone=self._factor(requirements, [place]),
                factor_together=of_all,
            )
            for place, variation in enumerate(self.variations)
        ]
        return sorted(rows, key=lambda row: row.share_if_exact or 0.0, reverse=True)

    def spreads(self) -> Iterator[MeritSpread]:
        """Yield the variation of each merit that has a surrogate, except for merits of single channels of a network."""
        keys = [variation.key for variation in self.variations]
        for name in (name for name in shown(self.merits) if name in self.surrogates):
            made = self.surrogates[name]
            values = self.merits[name][np.isfinite(self.merits[name])]
            yield MeritSpread(
                merit=name,
                base=self.base[name],
                u_base=self.base[f"u_{name}"],
                mean=float(values.mean()),
                sd=float(values.std(ddof=1)),
                first_order=dict(zip(keys, made.first_order.tolist(), strict=True)),
                total=dict(zip(keys, made.total.tolist(), strict=True)),
                degree=made.degree,
                held_out=made.held_out,
            )

    def _blurred(self, requirements: Sequence[Requirement], *, calibrated: bool) -> float:
        """Return the uncertainty of a fraction due to those of the merits.

        Errors that scatter about a surrogate differ from print to print. The scatter of the prints already contains the
        prints that they move over a limit; they also blur the limit, which changes the number of prints within it. The
        remaining error is common to all prints and to the design and shifts them together. The error of the design
        alone, as the base of a requirement, is estimated from its surrogate. Changes of the fraction are computed from
        the many samples of the surrogates.
        """
        named = list(dict.fromkeys(name for requirement in requirements for name in requirement.merits))
        merits = dict(self.merits)
        if self.surrogates.keys() >= {*named, *self.calibrated[:1]}:
            nothing = np.full(len(self.modelled), np.nan)
            merits = dict.fromkeys(self.merits, nothing) | {
                name: self.surrogates[name](self.modelled) for name in (*named, *self.calibrated[:1])
            }

        def met(name: str, by: float, base_by: float) -> float:
            """Return the fraction if the errors of one merit are ``by`` and ``base_by``."""
            moved = {**merits, name: merits[name] + by}
            at = replace(self, base={**self.base, name: self.base[name] + base_by})
            return float(at.met(requirements, at._calibrated(moved) if calibrated else moved).mean())

        share, squares = met(named[0], 0.0, 0.0), 0.0
        for name in named:
            own, common, of_base = self._parts_of_u(name)
            squares += (0.5 * (met(name, own, 0.0) + met(name, -own, 0.0)) - share) ** 2
            squares += 0.5 * sum((met(name, by, by) - share) ** 2 for by in (-common, common))
            squares += 0.5 * sum((met(name, 0.0, by) - share) ** 2 for by in (-of_base, of_base))
        return math.sqrt(squares)

    def _parts_of_u(self, name: str) -> tuple[float, float, float]:
        """Return the parts of a merit's uncertainty (rms): individual to prints, common, and of the design alone."""
        of_each, of_design = (np.nan_to_num(of[f"u_{name}"], posinf=FAR) for of in (self.merits, self.base))
        u, u_base = float(np.sqrt(np.mean(of_each**2))), float(of_design)
        made = self.surrogates.get(name)
        if made is None:
            return 0.0, u, u_base
        values = self.merits[name][np.isfinite(self.merits[name])]
        fitted = max(1.0 - len(made.degrees) / (values.size * (1.0 - 1.0 / FOLDS)), 0.0)  # its terms also fit noise
        own = min(u, math.sqrt(made.held_out * fitted) * float(values.std()))
        at_design = np.zeros((1, len(self.variations)))
        unsure = math.sqrt(FOLDS - 1.0) * float(np.std([made(at_design, fold) for fold in range(FOLDS)]))  # jackknife
        off = self.base[name] - float(made(at_design)[0])
        return own, math.sqrt(u * u - own * own), min(u_base, math.hypot(off, unsure))

    def _calibrated(self, merits: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return merits after a calibration of offset and gain: null and slope of the design, if there is a null."""
        exists = [np.isfinite(merits[name]) for name in self.calibrated[:1]]
        return {**merits} | {name: np.where(exists[0], self.base[name], np.nan) for name in self.calibrated}

    def _by_surrogates(
        self, requirements: Sequence[Requirement], deviations: FloatArray, fold: int | None, *, calibrated: bool = False
    ) -> BoolArray:
        named = dict.fromkeys(name for requirement in requirements for name in requirement.merits)
        nothing = np.full(len(deviations), np.nan)
        merits = dict.fromkeys(self.merits, nothing) | {
            name: self.surrogates[name](deviations, fold)
            for name in (*named, *(self.calibrated[:1] if calibrated else ()))
            if name in self.surrogates
        }
        return self.met(requirements, self._calibrated(merits) if calibrated else merits)

    def _scaled(self, requirements: Sequence[Requirement], places: Sequence[int], factor: float) -> float:
        """Return the yield from surrogates with some deviations scaled by a factor."""
        deviations = self.modelled.copy()
        for place in places:
            centre = self.variations[place].centre
            deviations[:, place] = centre + factor * (deviations[:, place] - centre)
        return float(self._by_surrogates(requirements, deviations, None).mean())

    def _factor(self, requirements: Sequence[Requirement], places: Sequence[int]) -> float | None:
        """Return the largest factor, up to 1, on some deviations that gives the yield; None if there is none."""
        if not requirements or self._scaled(requirements, places, 0.0) < WANTED_YIELD:
            return None
        low, high = 0.0, 1.0
        if self._scaled(requirements, places, high) >= WANTED_YIELD:
            return high
        for _ in range(8):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._scaled(requirements, places, middle) >= WANTED_YIELD else (low, middle)
        return low

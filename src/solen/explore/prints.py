"""Prints of a design, traced, and surrogates of their merits: yields, what costs them, and how each merit varies.

A surrogate of every merit, corrected by what the traced prints say of it, gives the yield; it alone tells which
tolerance costs most and what each may be.

The interface: `Prints`, whose methods give `Yield`, `VariedNumber` and `MeritSpread`.
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
"""Samples of the surrogates."""
WANTED_YIELD = 0.95
FAR = 1e100
"""Uncertainty of a merit that may be anything."""


class Yield(Result, eq=True):
    """Share of the prints that meet a requirement, or all of them.

    Attributes
    ----------
    requirement
        Its text; empty for all together.
    share, u_share
        Share of the prints as they come out.
    calibrated_share, u_calibrated_share
        After a calibration of each sensor, which removes the null's offset and the gain: null and slope count as
        those of the design; None of a network, whose merits no calibration changes.
    adjusted_share, u_adjusted_share
        After each print is adjusted as stated, and then not calibrated; None where no adjustment is.
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
        The number and its value in the design; of several that move together their sum as stated or a name of what
        moves them, and null.
    distribution
        ``normal`` or ``uniform``.
    deviation
        Mean and standard deviation, or the ends, of its deviation from that value.
    source
        Where that comes from: ``stated``, ``[tolerance]`` of the design, ``assumed`` by solen, or a process, a part or
        a resin by name.
    share_if_exact
        Yield if this number alone did not vary but stayed at `Variation.centre`, by the surrogates; None without
        requirements.
    factor_alone, factor_together
        Factor on its deviation for a yield of 95 %, if it alone is tightened or all are; None where that is not
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
    """How one merit varies between prints.

    Attributes
    ----------
    merit
        Its name.
    base, u_base
        Of the design itself.
    mean, sd
        Over the prints.
    first_order, total
        Sobol' indices by key: share of the variance by that number alone, and with others; of the surrogate.
    degree
        Degree of the surrogate's polynomial.
    held_out
        Share of the variance which the surrogate leaves unexplained of prints that it was not fitted to.
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
        (P, D).
    merits
        By name the values (P,).
    base
        Merits of the design itself.
    adjusted
        The same prints after an adjustment; None where none is.
    calibrated
        Merits that a calibration of each sensor makes those of the design, where the first of them exists.
    """

    variations: Sequence[Variation]
    deviations: FloatArray
    merits: Mapping[str, FloatArray]
    base: Mapping[str, float]
    adjusted: "Prints | None" = None
    calibrated: tuple[str, ...] = ("null_deg", "slope_per_deg")

    @cached_property
    def surrogates(self) -> dict[str, Surrogate]:
        """Surrogates of the merits that enough prints have."""
        return {
            name: fit(self.variations, self.deviations, self.merits[name])
            for name in self.merits
            if not name.startswith("u_") and np.isfinite(self.merits[name]).sum() >= 2 * FOLDS
        }

    @cached_property
    def modelled(self) -> FloatArray:
        """Deviations at which surrogates are taken."""
        return drawn(self.variations, MODELLED, 1)

    def met(self, requirements: Sequence[Requirement], merits: Mapping[str, FloatArray]) -> BoolArray:
        """Where merits (N,) meet all requirements."""
        size = next(iter(merits.values())).size
        met = np.ones(size, bool)
        for one in requirements:
            met &= one.met(merits, self.base)
        return met

    def yields(self, requirements: Sequence[Requirement]) -> Iterator[Yield]:
        """Yield of each requirement, and of all together."""
        groups = [("", requirements)] if requirements else []
        if len(requirements) > 1:
            groups = [*((one.text, [one]) for one in requirements), *groups]
        for text, group in groups:
            after = () if self.adjusted is None else self.adjusted.share(group)
            calibrated = self.share(group, calibrated=True) if self.calibrated else (None, None)
            yield Yield(text, *self.share(group), *calibrated, *after)

    def share(self, requirements: Sequence[Requirement], *, calibrated: bool = False) -> tuple[float, float]:
        """Share of prints that meet requirements, with its standard uncertainty.

        The share of the traced prints, corrected by what surrogates fitted without each of them miss of the surrogates'
        share over many samples (a control variate), as far as that lessens the scatter: not at all is counting. The
        estimate is free of the surrogates' error. Its uncertainty is that of the mean, with what the uncertainties of
        the merits make of it.
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
        )  # none may be a few not seen
        blurred = self._blurred(requirements, calibrated=calibrated)
        return min(max(float(corrected.mean()), 0.0), 1.0), math.hypot(u, blurred)

    def varied(self, sensor: Sensor, requirements: Sequence[Requirement]) -> list[VariedNumber]:
        """What varies and what it costs, the costliest first."""
        named = {name for one in requirements for name in one.merits}
        if not all(np.isfinite(self.merits[name]).all() for name in named):
            requirements = []  # surrogates do not know which prints lack a merit
        of_all = self._factor(requirements, range(len(self.variations)))
        rows = [
            VariedNumber(
                key=one.key,
                value=number(sensor, one.key) if one.key in one.weights else None,
                distribution=one.kind,
                deviation=(one.first, one.second),
                source=one.source,
                share_if_exact=self._scaled(requirements, [place], 0.0) if requirements else None,
                factor_alone=self._factor(requirements, [place]),
                factor_together=of_all,
            )
            for place, one in enumerate(self.variations)
        ]
        return sorted(rows, key=lambda row: row.share_if_exact or 0.0, reverse=True)

    def spreads(self) -> Iterator[MeritSpread]:
        """Spread of each merit that has a surrogate, but not of single channels of a network."""
        keys = [one.key for one in self.variations]
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
        """Uncertainty of a share by those of the merits.

        What scatters about a surrogate differs from print to print: which prints it moves over a limit is in the
        scatter of the prints, and that a limit is blurred makes more leave than enter, or fewer. The rest is common to
        all prints and to the design, so that it shifts them together. What the design alone is off by, as the base of a
        requirement, its surrogate tells. Changes of the share are those of the surrogates' samples, which are many.
        """
        named = list(dict.fromkeys(name for one in requirements for name in one.merits))
        merits = dict(self.merits)
        if self.surrogates.keys() >= {*named, *self.calibrated[:1]}:
            nothing = np.full(len(self.modelled), np.nan)
            merits = dict.fromkeys(self.merits, nothing) | {
                name: self.surrogates[name](self.modelled) for name in (*named, *self.calibrated[:1])
            }

        def met(name: str, by: float, base_by: float) -> float:
            """Share where a merit is off by so much."""
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
        """Uncertainty of a merit (rms): what differs between prints, what they share, and of the design alone."""
        of_each, of_design = (np.nan_to_num(of[f"u_{name}"], posinf=FAR) for of in (self.merits, self.base))
        u, u_base = float(np.sqrt(np.mean(of_each**2))), float(of_design)
        made = self.surrogates.get(name)
        if made is None:
            return 0.0, u, u_base
        values = self.merits[name][np.isfinite(self.merits[name])]
        fitted = max(1.0 - len(made.degrees) / (values.size * (1.0 - 1.0 / FOLDS)), 0.0)  # its terms follow noise too
        own = min(u, math.sqrt(made.held_out * fitted) * float(values.std()))
        at_design = np.zeros((1, len(self.variations)))
        unsure = math.sqrt(FOLDS - 1.0) * float(np.std([made(at_design, fold) for fold in range(FOLDS)]))  # jackknife
        off = self.base[name] - float(made(at_design)[0])
        return own, math.sqrt(u * u - own * own), min(u_base, math.hypot(off, unsure))

    def _calibrated(self, merits: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Merits after a calibration of offset and gain: null and slope of the design, where there is a null."""
        exists = [np.isfinite(merits[name]) for name in self.calibrated[:1]]
        return {**merits} | {name: np.where(exists[0], self.base[name], np.nan) for name in self.calibrated}

    def _by_surrogates(
        self, requirements: Sequence[Requirement], deviations: FloatArray, fold: int | None, *, calibrated: bool = False
    ) -> BoolArray:
        named = dict.fromkeys(name for one in requirements for name in one.merits)
        nothing = np.full(len(deviations), np.nan)
        merits = dict.fromkeys(self.merits, nothing) | {
            name: self.surrogates[name](deviations, fold)
            for name in (*named, *(self.calibrated[:1] if calibrated else ()))
            if name in self.surrogates
        }
        return self.met(requirements, self._calibrated(merits) if calibrated else merits)

    def _scaled(self, requirements: Sequence[Requirement], places: Sequence[int], factor: float) -> float:
        """Yield by surrogates with some deviations tightened by a factor."""
        deviations = self.modelled.copy()
        for place in places:
            centre = self.variations[place].centre
            deviations[:, place] = centre + factor * (deviations[:, place] - centre)
        return float(self._by_surrogates(requirements, deviations, None).mean())

    def _factor(self, requirements: Sequence[Requirement], places: Sequence[int]) -> float | None:
        """Largest factor, up to 1, on some deviations for the wanted yield; None where none reaches it."""
        if not requirements or self._scaled(requirements, places, 0.0) < WANTED_YIELD:
            return None
        low, high = 0.0, 1.0
        if self._scaled(requirements, places, high) >= WANTED_YIELD:
            return high
        for _ in range(8):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._scaled(requirements, places, middle) >= WANTED_YIELD else (low, middle)
        return low

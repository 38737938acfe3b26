"""Traced prints of a design, and surrogates of their merits: yields, effects of tolerances, variation of merits.

The yield comes from a surrogate of every merit, corrected by the traced prints. The surrogate alone gives the cost of
each tolerance and its largest acceptable value.

Public names: `Prints`, `Yield`, `VariedParameter` and `MeritSpread`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.explore.merits import table_merits
from solen.explore.requirement import Requirement
from solen.explore.surrogate import FOLDS, Surrogate, fit, fold_indices
from solen.explore.variations import Variation, draw_deviations
from solen.results import Result
from solen.sensor import Sensor
from solen.sensor.numbers import number

SURROGATE_SAMPLES = 2**14
"""Number of samples of the surrogates."""
TARGET_YIELD = 0.95
LARGE_U = 1e100
"""Finite substitute for an infinite uncertainty of a merit."""


class Yield(Result, eq=True):
    """Fraction of the prints that meet one requirement, or all of them.

    Attributes
    ----------
    requirement
        The requirement as specified; empty for all together.
    share, u_share
        Fraction of the prints without calibration or adjustment.
    calibrated_share, u_calibrated_share
        Fraction after a calibration of each sensor, which corrects null and gain: null and slope are then those of the
        design; None for a network, whose merits no calibration changes.
    adjusted_share, u_adjusted_share
        Fraction after the adjustment of each print, without a calibration; None without an adjustment.
    """

    requirement: str
    share: float
    u_share: float
    calibrated_share: float | None
    u_calibrated_share: float | None
    adjusted_share: float | None = None
    u_adjusted_share: float | None = None


class VariedParameter(Result, eq=True):
    """A parameter that varies, or several that vary together.

    Attributes
    ----------
    key, value
        The parameter and its value in the design. For parameters that vary together, the key is their sum as specified
        or the name of their common cause, and there is no value.
    distribution
        ``normal`` or ``uniform``.
    deviation
        Mean and standard deviation, or limits, of the deviation from that value.
    source
        Source of the distribution: ``specified``, ``[tolerance]`` of the design, ``assumed`` by solen, or the name of
        a process, a part or a resin.
    share_if_exact
        Yield if this parameter did not vary but stayed at `Variation.centre` while all others vary, from the
        surrogates; None without requirements.
    factor_alone, factor_together
        Factor on its deviation for a yield of 95 % if only this tolerance is tightened, or all by the same factor; None
        if that yield is not reached, or without requirements.
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
        Sobol' indices, keyed by parameter, from the surrogate: fraction of the variance due to the parameter alone,
        and including its interactions.
    degree
        Degree of the surrogate.
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
        D variations.
    deviations
        Deviations (P, D) of the prints.
    merits
        Merits (P,) of the prints, keyed by name.
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
    def samples(self) -> FloatArray:
        """Deviations at which the surrogates are evaluated."""
        return draw_deviations(self.variations, SURROGATE_SAMPLES, 1)

    def met(self, requirements: Sequence[Requirement], merits: Mapping[str, FloatArray]) -> BoolArray:
        """Return a mask (N,) of the prints or samples whose merits meet all requirements."""
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
            adjusted = () if self.adjusted is None else self.adjusted.yield_of(group)
            calibrated = self.yield_of(group, calibrated=True) if self.calibrated else (None, None)
            yield Yield(text, *self.yield_of(group), *calibrated, *adjusted)

    def yield_of(self, requirements: Sequence[Requirement], *, calibrated: bool = False) -> tuple[float, float]:
        """Return the fraction of prints that meet requirements, with its standard uncertainty.

        The fraction of traced prints that meet them is corrected with a control variate. For each print, this is the
        prediction of the surrogates fitted without it, minus the mean prediction of the same surrogates over many
        samples. The weight of the correction minimises the scatter; with a weight of 0, the result is a plain count.
        Errors of the surrogates do not bias the result. Its uncertainty is that of the mean, combined with the effect
        of the uncertainties of the merits.
        """
        fold_of = fold_indices(len(self.deviations))
        met = self.met(requirements, self._calibrated(self.merits) if calibrated else self.merits).astype(float)
        predicted, mean = np.empty(met.size), np.empty(met.size)
        for fold in range(FOLDS):
            inside = fold_of == fold
            predicted[inside] = self._by_surrogates(requirements, self.deviations[inside], fold, calibrated=calibrated)
            mean[inside] = self._by_surrogates(requirements, self.samples, fold, calibrated=calibrated).mean()
        control = predicted - mean
        covariance = np.cov(met, control)
        corrected = met - (covariance[0, 1] / covariance[1, 1] if covariance[1, 1] else 0.0) * control
        u_mean = float(corrected.std(ddof=1)) / math.sqrt(met.size)
        u = max(u_mean, 1.0 / (met.size + 2))  # a count of 0 has an uncertainty too
        u_merits = self._u_from_merits(requirements, calibrated=calibrated)
        return min(max(float(corrected.mean()), 0.0), 1.0), math.hypot(u, u_merits)

    def varied(self, sensor: Sensor, requirements: Sequence[Requirement]) -> list[VariedParameter]:
        """Return the parameters that vary and their effect on the yield, in descending order of `share_if_exact`."""
        named = {name for requirement in requirements for name in requirement.merits}
        if not all(np.isfinite(self.merits[name]).all() for name in named):
            requirements = []  # surrogates cannot predict missing merits
        common_factor = self._factor(requirements, range(len(self.variations)))
        rows = [
            VariedParameter(
                key=variation.key,
                value=number(sensor, variation.key) if variation.key in variation.weights else None,
                distribution=variation.kind,
                deviation=(variation.first, variation.second),
                source=variation.source,
                share_if_exact=self._scaled(requirements, [k], 0.0) if requirements else None,
                factor_alone=self._factor(requirements, [k]),
                factor_together=common_factor,
            )
            for k, variation in enumerate(self.variations)
        ]
        return sorted(rows, key=lambda row: row.share_if_exact or 0.0, reverse=True)

    def spreads(self) -> Iterator[MeritSpread]:
        """Yield the variation of each merit that has a surrogate, except for merits of single channels of a network."""
        keys = [variation.key for variation in self.variations]
        for name in (name for name in table_merits(self.merits) if name in self.surrogates):
            surrogate = self.surrogates[name]
            values = self.merits[name][np.isfinite(self.merits[name])]
            yield MeritSpread(
                merit=name,
                base=self.base[name],
                u_base=self.base[f"u_{name}"],
                mean=float(values.mean()),
                sd=float(values.std(ddof=1)),
                first_order=dict(zip(keys, surrogate.first_order.tolist(), strict=True)),
                total=dict(zip(keys, surrogate.total.tolist(), strict=True)),
                degree=surrogate.degree,
                held_out=surrogate.held_out,
            )

    def _u_from_merits(self, requirements: Sequence[Requirement], *, calibrated: bool) -> float:
        """Return the uncertainty of a fraction due to the uncertainties of the merits.

        Errors that scatter about a surrogate differ from print to print. The scatter of the prints already includes the
        prints that these errors move across a limit; they also blur the limit, which changes the number of prints
        within it. The remaining error is common to all prints and the design and shifts them together. The error of
        the design alone, as the base of a requirement, is estimated from the surrogate. Changes of the fraction are
        computed from the many samples of the surrogates.
        """
        named = list(dict.fromkeys(name for requirement in requirements for name in requirement.merits))
        merits = dict(self.merits)
        if self.surrogates.keys() >= {*named, *self.calibrated[:1]}:
            missing = np.full(len(self.samples), np.nan)
            merits = dict.fromkeys(self.merits, missing) | {
                name: self.surrogates[name](self.samples) for name in (*named, *self.calibrated[:1])
            }

        def fraction(name: str, error: float, base_error: float) -> float:
            """Return the fraction if one merit of the prints and of the design has the given errors."""
            shifted = {**merits, name: merits[name] + error}
            prints = replace(self, base={**self.base, name: self.base[name] + base_error})
            return float(prints.met(requirements, prints._calibrated(shifted) if calibrated else shifted).mean())

        nominal, squares = fraction(named[0], 0.0, 0.0), 0.0
        for name in named:
            individual, common, base = self._parts_of_u(name)
            squares += (0.5 * (fraction(name, individual, 0.0) + fraction(name, -individual, 0.0)) - nominal) ** 2
            squares += 0.5 * sum((fraction(name, error, error) - nominal) ** 2 for error in (-common, common))
            squares += 0.5 * sum((fraction(name, 0.0, error) - nominal) ** 2 for error in (-base, base))
        return math.sqrt(squares)

    def _parts_of_u(self, name: str) -> tuple[float, float, float]:
        """Return the parts of a merit's uncertainty (RMS): individual to prints, common, and of the design alone."""
        u_prints, u_design = (np.nan_to_num(part[f"u_{name}"], posinf=LARGE_U) for part in (self.merits, self.base))
        u, u_base = float(np.sqrt(np.mean(u_prints**2))), float(u_design)
        surrogate = self.surrogates.get(name)
        if surrogate is None:
            return 0.0, u, u_base
        values = self.merits[name][np.isfinite(self.merits[name])]
        residual_fraction = max(1.0 - len(surrogate.degrees) / (values.size * (1.0 - 1.0 / FOLDS)), 0.0)
        individual = min(u, math.sqrt(surrogate.held_out * residual_fraction) * float(values.std()))
        at_design = np.zeros((1, len(self.variations)))
        jackknife = [surrogate(at_design, fold) for fold in range(FOLDS)]
        u_surrogate = math.sqrt(FOLDS - 1.0) * float(np.std(jackknife))
        error = self.base[name] - float(surrogate(at_design)[0])
        return individual, math.sqrt(u * u - individual * individual), min(u_base, math.hypot(error, u_surrogate))

    def _calibrated(self, merits: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return merits after a calibration of offset and gain: null and slope of the design, if there is a null."""
        exists = [np.isfinite(merits[name]) for name in self.calibrated[:1]]
        return {**merits} | {name: np.where(exists[0], self.base[name], np.nan) for name in self.calibrated}

    def _by_surrogates(
        self, requirements: Sequence[Requirement], deviations: FloatArray, fold: int | None, *, calibrated: bool = False
    ) -> BoolArray:
        named = dict.fromkeys(name for requirement in requirements for name in requirement.merits)
        missing = np.full(len(deviations), np.nan)
        merits = dict.fromkeys(self.merits, missing) | {
            name: self.surrogates[name](deviations, fold)
            for name in (*named, *(self.calibrated[:1] if calibrated else ()))
            if name in self.surrogates
        }
        return self.met(requirements, self._calibrated(merits) if calibrated else merits)

    def _scaled(self, requirements: Sequence[Requirement], columns: Sequence[int], factor: float) -> float:
        """Return the yield from the surrogates with the deviations in ``columns`` multiplied by a factor."""
        deviations = self.samples.copy()
        for k in columns:
            centre = self.variations[k].centre
            deviations[:, k] = centre + factor * (deviations[:, k] - centre)
        return float(self._by_surrogates(requirements, deviations, None).mean())

    def _factor(self, requirements: Sequence[Requirement], columns: Sequence[int]) -> float | None:
        """Return the largest factor, up to 1, on the deviations in ``columns`` for `TARGET_YIELD`; None without one."""
        if not requirements or self._scaled(requirements, columns, 0.0) < TARGET_YIELD:
            return None
        low, high = 0.0, 1.0
        if self._scaled(requirements, columns, high) >= TARGET_YIELD:
            return high
        for _ in range(8):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._scaled(requirements, columns, middle) >= TARGET_YIELD else (low, middle)
        return low

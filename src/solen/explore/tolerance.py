"""Tolerances: what many prints of a design will do, whose numbers vary as stated.

Prints are a scrambled Sobol' sequence of what varies, each traced. A surrogate of every merit, corrected by what the
traced prints say of it, gives the yield; it alone tells which tolerance costs most and what each may be.

The interface: `tolerance` of a design by `ToleranceOptions` returns `Tolerances`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from functools import partial

import numpy as np
from pydantic import Field

from solen.arrays import BoolArray, FloatArray, Progress
from solen.errors import SpecError
from solen.explore.machines import Machine
from solen.explore.merits import MERITS, NAMES
from solen.explore.requirement import Requirement
from solen.explore.store import Store, Variant
from solen.explore.surrogate import FOLDS, Surrogate, fit, parts
from solen.explore.sweep import AccuracyOptions, check_angles, failures_of, merits_of_points, point_warnings, responses
from solen.explore.variations import Variation, drawn, offs, together, variations_of
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.sensor.effects import as_built
from solen.sensor.numbers import number
from solen.spec import Design
from solen.spec.strict import Finite

MODELLED = 2**14
"""Samples of the surrogates."""
WANTED_YIELD = 0.95


class ToleranceOptions(AccuracyOptions):
    """What varies between prints, and what they must do."""

    vary: tuple[str, ...] = ()
    """A number of the design and how it deviates from its value there, KEY=normal:MEAN:SD or KEY=uniform:LOW:HIGH;
    numbers that move together are a sum, KEY+0.5*KEY=normal:MEAN:SD; repeatable. Default: every number that the light
    depends on by the tolerances of the design, which are limits (uniform) but where a resin states a standard
    uncertainty (normal)."""
    require: tuple[str, ...] = ()
    """A condition on merits that a good print meets, as in "abs(null_deg) < 0.3"; repeatable."""
    prints: int = Field(256, ge=32, le=100_000)
    """Number of prints that are traced."""
    seed: int = Field(0, ge=0)
    """Seed of the prints."""
    tolerance: Finite | None = Field(1e-3, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power, as a share of the emitted power."""
    print_number: int | None = Field(None, ge=1)
    """Write the design of the print of this number as well, NAME-print-NUMBER.toml."""


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
        those of the design.
    """

    requirement: str
    share: float
    u_share: float
    calibrated_share: float
    u_calibrated_share: float


class VariedNumber(Result, eq=True):
    """One number that varies.

    Attributes
    ----------
    key, value
        The number and its value in the design; of several that move together their sum as stated, and null.
    distribution
        ``normal`` or ``uniform``.
    deviation
        Mean and standard deviation, or the ends, of its deviation from that value.
    share_if_exact
        Yield if this number alone did not vary, by the surrogates; None without requirements.
    factor_alone, factor_together
        Factor on its deviation for a yield of 95 %, if it alone is tightened or all are; None where that is not
        reached, or without requirements.
    """

    key: str
    value: float | None
    distribution: str
    deviation: tuple[float, float]
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
        Of the surrogate's polynomial.
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


class Tolerances(Result):
    """What prints of a design do whose numbers vary.

    Attributes
    ----------
    name
        Name of the design.
    prints, seed
        Number of traced prints, and the seed of them.
    yields
        Of each requirement, and last of all together.
    varied
        What varies; what costs most yield first.
    spreads
        Of each merit.
    traced
        Number of prints traced now; the others were known.
    deviations
        By key the deviations (P,) of each print.
    merits
        By name the merits (P,) of each print, and their uncertainties.
    """

    name: str
    prints: int
    seed: int
    yields: tuple[Yield, ...]
    varied: tuple[VariedNumber, ...]
    spreads: tuple[MeritSpread, ...]
    traced: int
    warnings: tuple[str, ...]
    deviations: Mapping[str, FloatArray] = field(metadata=HIDDEN)
    merits: Mapping[str, FloatArray] = field(metadata=HIDDEN)
    met: BoolArray = field(metadata=HIDDEN)
    simulated: bool = True

    def table(self) -> str:
        """CSV of the prints: number, deviations, merits with their uncertainties, and whether it meets everything."""
        columns = {f"{key} off by": values for key, values in self.deviations.items()} | dict(self.merits)
        head = ["print", *columns, "meets all"]
        rows = zip(*(values.tolist() for values in columns.values()), self.met.tolist(), strict=True)
        text = [",".join(head)]
        for place, (*values, met) in enumerate(rows, start=1):
            cells = ("" if math.isnan(value) else f"{value:.9g}" for value in values)
            text.append(",".join([str(place), *cells, "yes" if met else "no"]))
        return "\n".join(["# simulated by solen, not measured", *text, ""])


def tolerance(
    design: Design,
    options: ToleranceOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    machine: Machine | None = None,
) -> Tolerances:
    """What prints of a design do whose numbers vary; arguments as those of `solen.explore.sweep`.

    Raises
    ------
    SpecError
        Where a variation or a requirement is malformed, or no print has a response.
    """
    store = Store() if store is None else store
    requirements = [Requirement.parse(text) for text in options.require]
    sensor = Sensor.of(design)
    check_angles(design)
    variations = variations_of(sensor, options.vary)
    deviations = drawn(variations, options.prints, options.seed)
    every = [{}, *(offs(variations, row) for row in deviations.tolist())]
    known = len(store.points)
    variants = (partial(Variant, design, off) for off in every)
    points = responses(variants, options.accuracy, store, progress, machine)
    failures = failures_of(points[1:])
    if not points[0].right.size:
        raise SpecError("design", limit=f"has no response: {points[0].why}")
    if sum(failures.values()) == options.prints:
        raise SpecError("prints", limit=f"none has a response; the first: {next(iter(failures))}")
    merits = merits_of_points(np.array(design.motion.angles_deg()), points)
    base = {name: float(values[0]) for name, values in merits.items()}
    study = Prints(variations, deviations, {name: values[1:] for name, values in merits.items()}, base)
    met = study.met(requirements, study.merits)
    return Tolerances(
        name=design.name,
        prints=options.prints,
        seed=options.seed,
        yields=tuple(study.yields(requirements)),
        varied=tuple(study.varied(sensor, requirements)),
        spreads=tuple(study.spreads()),
        traced=len(store.points) - known,
        warnings=tuple(point_warnings(points, failures)),
        deviations={one.key: column for one, column in zip(variations, deviations.T, strict=True)},
        merits=study.merits,
        met=met,
    )


def print_design(design: Design, options: ToleranceOptions) -> Design | None:
    """Design of the print that was asked for, with its numbers as they came out; None where none was.

    Raises
    ------
    SpecError
        If the study has no such print, or a design file cannot describe it.
    """
    place = options.print_number
    if place is None:
        return None
    if place > options.prints:
        raise SpecError("--print-number", value=place, limit=f"the prints are 1 to {options.prints}")
    sensor = Sensor.of(design)
    variations = variations_of(sensor, options.vary)
    row = drawn(variations, options.prints, options.seed)[place - 1]
    off = offs(variations, row.tolist())
    values = {key: number(sensor, key) + step for key, step in off.items()}
    if "emitter.distance_mm" in values and sensor.has_lens:
        limit = "emitter.distance_mm varies, and the lens of a design file is cut for the distance that it states"
        raise SpecError("--print-number", value=place, limit=limit, remedy="hold it, by --vary of the others")
    if "material.index" in values and design.material.resin is not None:
        if sensor.is_loaded or sensor.light.spectrum:
            limit = "material.index varies, and a design without its resin has neither its stiffness nor its dispersion"
            raise SpecError("--print-number", value=place, limit=limit, remedy="hold it, by --vary of the others")
        values = {"material.absorption_per_mm": sensor.material.absorption_per_mm} | values
    if sensor.has_lens and not sensor.is_measured and {"material.index", "emitter.wavelength_nm"} & values.keys():
        values = {"lens.design_index": sensor.design.lens.design_index or sensor.material.index} | values
    if "material.index" in values:  # takes the resin away, with its loss and its dispersion
        built = as_built(sensor, off).material
        values |= {"material.index": built.index, "material.absorption_per_mm": built.absorption_per_mm}
    return design.set(values)


class Prints:
    """Traced prints with surrogates of their merits.

    Parameters
    ----------
    variations
        D numbers that vary.
    deviations
        (P, D).
    merits
        By name the values (P,).
    base
        Merits of the design itself.
    """

    def __init__(
        self,
        variations: Sequence[Variation],
        deviations: FloatArray,
        merits: Mapping[str, FloatArray],
        base: Mapping[str, float],
    ) -> None:
        self.variations, self.deviations, self.merits, self.base = variations, deviations, merits, base
        self.surrogates: dict[str, Surrogate] = {
            name: fit(variations, deviations, merits[name])
            for name in MERITS
            if np.isfinite(merits[name]).sum() >= 2 * FOLDS
        }
        self.modelled = drawn(variations, MODELLED, 1)

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
            yield Yield(text, *self.share(group), *self.share(group, calibrated=True))

    def share(self, requirements: Sequence[Requirement], *, calibrated: bool = False) -> tuple[float, float]:
        """Share of prints that meet requirements, with its standard uncertainty.

        The surrogates' share over many samples, plus what each traced print differs from surrogates fitted without it
        (a control variate): the estimate is free of the surrogates' error, and its uncertainty is that of the mean
        difference.
        """
        part = parts(len(self.deviations))
        true = self.met(requirements, self._calibrated(self.merits) if calibrated else self.merits)
        missed = np.empty(true.size)
        modelled = np.empty(FOLDS)
        for fold in range(FOLDS):
            inside = part == fold
            made = self._by_surrogates(requirements, self.deviations[inside], fold, calibrated=calibrated)
            missed[inside] = true[inside].astype(float) - made
            modelled[fold] = self._by_surrogates(requirements, self.modelled, fold, calibrated=calibrated).mean()
        share = float(missed.mean() + modelled[part].mean())
        u = max(float(missed.std(ddof=1)) / math.sqrt(true.size), 1.0 / (true.size + 2))  # none may be a few not seen
        undecided = self._undecided(requirements, calibrated=calibrated)
        return min(max(share, 0.0), 1.0), math.hypot(u, undecided / math.sqrt(12.0))

    def varied(self, sensor: Sensor, requirements: Sequence[Requirement]) -> list[VariedNumber]:
        """What varies and what it costs, the costliest first."""
        named = {name for one in requirements for name in one.merits}
        if not all(np.isfinite(self.merits[name]).all() for name in named):
            requirements = []  # surrogates do not know which prints lack a merit
        of_all = self._factor(requirements, range(len(self.variations)))
        rows = [
            VariedNumber(
                key=one.key,
                value=number(sensor, one.key) if one.key in together(one.key) else None,
                distribution=one.kind,
                deviation=(one.first, one.second),
                share_if_exact=self._scaled(requirements, [place], 0.0) if requirements else None,
                factor_alone=self._factor(requirements, [place]),
                factor_together=of_all,
            )
            for place, one in enumerate(self.variations)
        ]
        return sorted(rows, key=lambda row: row.share_if_exact or 0.0, reverse=True)

    def spreads(self) -> Iterator[MeritSpread]:
        """Spread of each merit that has a surrogate."""
        keys = [one.key for one in self.variations]
        for name, made in self.surrogates.items():
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

    def _undecided(self, requirements: Sequence[Requirement], *, calibrated: bool) -> float:
        """Share of prints for which a requirement would change where one of its merits is off by its uncertainty."""
        changes = np.zeros(len(self.deviations), bool)
        met = self.met(requirements, self._calibrated(self.merits) if calibrated else self.merits)
        for name in dict.fromkeys(name for one in requirements for name in one.merits):
            for sign in (-1.0, 1.0):
                off = {**self.merits, name: self.merits[name] + sign * np.nan_to_num(self.merits[f"u_{name}"])}
                changes |= met != self.met(requirements, self._calibrated(off) if calibrated else off)
        return float(changes.mean())

    def _calibrated(self, merits: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Merits after a calibration of offset and gain: null and slope of the design, where there is a null."""
        exists = np.isfinite(merits["null_deg"])
        return {**merits} | {name: np.where(exists, self.base[name], np.nan) for name in ("null_deg", "slope_per_deg")}

    def _by_surrogates(
        self, requirements: Sequence[Requirement], deviations: FloatArray, fold: int | None, *, calibrated: bool = False
    ) -> BoolArray:
        named = dict.fromkeys(name for one in requirements for name in one.merits)
        nothing = np.full(len(deviations), np.nan)
        merits = dict.fromkeys(NAMES, nothing) | {
            name: self.surrogates[name](deviations, fold)
            for name in (*named, *(("null_deg",) if calibrated else ()))
            if name in self.surrogates
        }
        return self.met(requirements, self._calibrated(merits) if calibrated else merits)

    def _scaled(self, requirements: Sequence[Requirement], places: Sequence[int], factor: float) -> float:
        """Yield by surrogates with some deviations times a factor."""
        deviations = self.modelled.copy()
        deviations[:, list(places)] *= factor
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

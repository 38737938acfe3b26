"""Tolerances: statistics of many prints of a design whose numbers vary as stated.

Prints are a scrambled Sobol' sequence of the varying numbers, and each print is traced; `solen.explore.prints`
evaluates them.

Public names: `tolerance`, `ToleranceOptions` and `Tolerances`.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from solen.arrays import BoolArray, FloatArray
from solen.errors import SpecError
from solen.explore.adjustment import Adjustment
from solen.explore.default_variations import variations_of
from solen.explore.machines import Machine
from solen.explore.measures import measure_of, merits_of_points
from solen.explore.prints import MeritSpread, Prints, VariedNumber, Yield
from solen.explore.requirement import Requirement
from solen.explore.responses import AccuracyOptions, failures_of, point_warnings, responses
from solen.explore.store import Point, Store, Variant
from solen.explore.subject import Subject, design_of
from solen.explore.variations import STATED, Variation, drawn, offs
from solen.fabricate.process import Settings
from solen.files import SIMULATED
from solen.progress import Progress, part_of
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.sensor.effects import with_deviations
from solen.sensor.numbers import number
from solen.spec import Design
from solen.spec.strict import Finite

OFF = 0.84
"""Probability at which the effect of a single deviation is tested: one standard deviation of a normal distribution."""


class ToleranceOptions(AccuracyOptions):
    """Variations between prints, and requirements on them."""

    vary: tuple[str, ...] = ()
    """A number of the design and its deviation from the value there, KEY=normal:MEAN:SD or KEY=uniform:LOW:HIGH;
    numbers that move together are a sum, KEY+0.5*KEY=normal:MEAN:SD; repeatable. By default, or for all numbers
    not stated if one text is "usual": every number that affects the light, with the limits of the emitter's part,
    a resin's standard uncertainty (normal), or the tolerances of the design, which are limits (uniform).
    """
    process: Path | None = None
    """Process file of the printer: walls grow and the part shrinks as stated there, with their uncertainties, in
    place of the tolerances of its lengths.
    """
    compensated: bool = False
    """The drawing is compensated for that process: the mean deviation of growth and shrinkage is 0."""
    adjust: str | None = None
    """Adjustment of each print on the bench, KEY=LIMIT, as in emitter.offset_mm=0.05: the number is moved by up to this
    limit until the contrast at the design's null equals the design's. Every print is then traced twice.
    """
    require: tuple[str, ...] = ()
    """A condition on merits that a good print meets, as in "abs(null_deg) < 0.3"; repeatable."""
    prints: int = Field(256, ge=32, le=100_000)
    """Number of prints to trace."""
    seed: int = Field(0, ge=0)
    """Seed of the prints."""
    tolerance: Finite | None = Field(1e-3, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power, as a fraction of the emitted power."""
    print_number: int | None = Field(None, ge=1)
    """Number of a print whose design is also written, NAME-print-NUMBER.toml."""


class Tolerances(Result):
    """Statistics of prints of a design whose numbers vary.

    Attributes
    ----------
    name
        Name of the design.
    prints, seed
        Number of traced prints, and their seed.
    yields
        Yield of each requirement and, as the last one, of all together.
    varied
        Numbers that vary, the one with the largest cost in yield first.
    spreads
        Variation of each merit.
    traced
        Number of prints that were traced rather than read from the store.
    deviations
        Deviations (P,) of the prints by key.
    merits
        Merits (P,) of the prints by name, with their uncertainties.
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

    def dataset_parts(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Return deviations by key, merits, and whether all requirements are met, along ``print``."""
        coordinates = {"print": np.arange(1, self.prints + 1)} | {
            key: ("print", x) for key, x in self.deviations.items()
        }
        variables = {name: ("print", values) for name, values in (*self.merits.items(), ("meets_all", self.met))}
        return variables, coordinates, {"title": f"Prints of {self.name}", "simulated": 1}

    def table(self) -> str:
        """CSV table of the prints: number, deviations, merits with uncertainties, and whether all is met."""
        columns = {f"{key} off by": values for key, values in self.deviations.items()} | dict(self.merits)
        head = ["print", *columns, "meets all"]
        rows = zip(*(values.tolist() for values in columns.values()), self.met.tolist(), strict=True)
        text = [",".join(head)]
        for place, (*values, met) in enumerate(rows, start=1):
            cells = ("" if math.isnan(value) else f"{value:.9g}" for value in values)
            text.append(",".join([str(place), *cells, "yes" if met else "no"]))
        return SIMULATED + "\n".join([*text, ""])


def tolerance(
    subject: Subject,
    options: ToleranceOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    machine: Machine | None = None,
    printed_by: Settings | None = None,
) -> Tolerances:
    """Trace prints of a design whose numbers vary; the arguments are those of `solen.explore.sweep`.

    With ``printed_by``, each print has the lens that this process makes from the designed one.

    Raises
    ------
    SpecError
        If a variation or a requirement is malformed, or no print has a response.
    """
    store, design = Store() if store is None else store, design_of(subject)
    measure = measure_of(design)
    requirements = [Requirement.parse(text, measure.names) for text in options.require]
    sensor = Sensor.of(design)
    adjustment = None if options.adjust is None else Adjustment.parse(options.adjust, sensor)
    variations = _varied(sensor, options)
    deviations = drawn(variations, options.prints, options.seed)
    every = [{}, *(offs(variations, row) for row in deviations.tolist())]
    known = len(store.points)

    def traced(every: Sequence[Mapping[str, float]], progress: Progress | None) -> list[Point]:
        variants = (partial(Variant, design, off, printed_by) for off in every)
        return responses(variants, options.accuracy, store, progress, machine)

    passes = 1 if adjustment is None else 2
    points = traced(every, part_of(progress, 0, passes))
    failures = failures_of(points[1:])
    if not points[0].is_traced:
        raise SpecError("design", limit=f"has no response: {points[0].why}")
    if sum(failures.values()) == options.prints:
        raise SpecError("prints", limit=f"none has a response; the first reason: {next(iter(failures))}")
    merits = merits_of_points(measure, points)
    base = {name: float(values[0]) for name, values in merits.items()}
    of_prints = {name: values[1:] for name, values in merits.items()}
    study = Prints(variations, deviations, of_prints, base, calibrated=measure.calibrated)
    if adjustment is not None:
        alone = traced([{adjustment.key: step} for step in adjustment.steps], None)
        offs_adjusted = adjustment.of(measure.angle_deg, base["null_deg"], alone, points[1:], every[1:])
        again = traced(offs_adjusted, part_of(progress, 1, passes))
        study = replace(study, adjusted=replace(study, merits=merits_of_points(measure, again)))
    return Tolerances(
        name=design.name,
        prints=options.prints,
        seed=options.seed,
        yields=tuple(study.yields(requirements)),
        varied=tuple(study.varied(sensor, requirements)),
        spreads=tuple(study.spreads()),
        traced=len(store.points) - known,
        warnings=(
            *point_warnings(measure, points, failures),
            *_missed_by_design(requirements, base),
            *_without_effect(variations, points[0], traced),
        ),
        deviations={variation.key: column for variation, column in zip(variations, deviations.T, strict=True)},
        merits=study.merits,
        met=study.met(requirements, study.merits),
    )


def _varied(sensor: Sensor, options: ToleranceOptions) -> list[Variation]:
    if options.compensated and options.process is None:
        limit = "requires a process specified with --process, but there is none"
        raise SpecError("--compensated", limit=limit, remedy="add --process FILE, or omit --compensated")
    return variations_of(sensor, options.vary, options.process, compensated=options.compensated)


def _without_effect(
    variations: Sequence[Variation],
    base: Point,
    traced: Callable[[Sequence[Mapping[str, float]], Progress | None], Sequence[Point]],
) -> Iterator[str]:
    """Return warnings about stated numbers that change no response when varied alone."""
    stated = [variation for variation in variations if variation.source == STATED]
    off = [offs([one], one.deviation(np.array([OFF])).tolist()) for one in stated]
    for one, point in zip(stated, traced(off, None), strict=True):
        if point.content == base.content:
            yield f"{one.key} changes no response when varied alone; omit --vary {one.key}"


def _missed_by_design(requirements: Sequence[Requirement], base: Mapping[str, float]) -> Iterator[str]:
    """Return warnings about requirements that no tolerance can achieve, since the design itself misses them."""
    merits = {name: np.array([value]) for name, value in base.items()}
    for requirement in requirements:
        if not requirement.met(merits, base)[0]:
            values = ", ".join(f"{name} is {base[name]:.4g}" for name in requirement.merits)
            yield (
                f"the design itself does not meet {requirement.text}: its {values}; no tolerance can correct "
                "this: change the design or the requirement"
            )


def print_design(subject: Subject, options: ToleranceOptions) -> Design | None:
    """Return the design of the requested print, with its deviations; None if no print was requested.

    Raises
    ------
    SpecError
        If the study has no such print, or a design file cannot describe it.
    """
    place = options.print_number
    if place is None:
        return None
    if place > options.prints:
        raise SpecError("--print-number", value=place, limit=f"prints are numbered from 1 to {options.prints}")
    design = design_of(subject)
    sensor = Sensor.of(design)
    variations = _varied(sensor, options)
    row = drawn(variations, options.prints, options.seed)[place - 1]
    off = offs(variations, row.tolist())
    values = {key: number(sensor, key) + step for key, step in off.items()}
    if "emitter.distance_mm" in values and sensor.has_lens:
        grown = any(
            variation.moved is not None and "emitter.distance_mm" in variation.weights for variation in variations
        )
        why = "growth of --process moves the lens towards the emitter" if grown else "emitter.distance_mm varies"
        limit = f"{why}, and the lens of a design file is designed for the distance specified in the file"
        remedy = "omit --process" if grown else ("keep it constant: name only the other parameters with --vary")
        raise SpecError("--print-number", value=place, limit=limit, remedy=f"{remedy}; the table contains this print")
    if "material.index" in values and design.material.resin is not None:
        if sensor.is_loaded or sensor.light.spectrum:
            limit = "material.index varies, and a design without its resin specifies neither stiffness nor dispersion"
            raise SpecError(
                "--print-number",
                value=place,
                limit=limit,
                remedy="keep it constant: name only the other parameters with --vary",
            )
        values = {"material.absorption_per_mm": sensor.material.absorption_per_mm} | values
    if sensor.has_lens and not sensor.is_measured and {"material.index", "emitter.wavelength_nm"} & values.keys():
        values = {"lens.design_index": sensor.design.lens.design_index or sensor.material.index} | values
    if "material.index" in values:  # replaces the resin, with its loss and its dispersion
        built = with_deviations(sensor, off).material
        values |= {"material.index": built.index, "material.absorption_per_mm": built.absorption_per_mm}
    return design.set(values)

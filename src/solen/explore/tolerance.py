"""Tolerance analysis: statistics of many prints of a design whose parameters vary.

The varying parameters of the prints are points of a scrambled Sobol' sequence, and each print is traced;
`solen.explore.prints` evaluates them.

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
from solen.explore.prints import MeritSpread, Prints, VariedParameter, Yield
from solen.explore.requirement import Requirement
from solen.explore.responses import AccuracyOptions, failures_of, point_warnings, responses
from solen.explore.store import Point, Store, Variant
from solen.explore.subject import Subject, design_of
from solen.explore.variations import SPECIFIED, Variation, deviations_by_key, draw_deviations
from solen.fabricate.process import Settings
from solen.files import SIMULATED
from solen.progress import Progress, part_of
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.sensor.effects import with_deviations
from solen.sensor.numbers import number
from solen.spec import Design
from solen.spec.strict import Finite

TEST_PROBABILITY = 0.84
"""Probability of the deviation with which a single tolerance is tested: one standard deviation above a normal mean."""
KEEP_CONSTANT = "keep this parameter constant: specify only the other parameters with --vary"


class ToleranceOptions(AccuracyOptions):
    """Variations between prints, and requirements on them."""

    vary: tuple[str, ...] = ()
    """A parameter of the design and its deviation from the value in the design, KEY=normal:MEAN:SD or
    KEY=uniform:LOW:HIGH; parameters that vary together form a sum, KEY+0.5*KEY=normal:MEAN:SD; repeatable. By default,
    or with "usual" for all parameters not specified otherwise: every parameter that affects the light, with the limits
    of the emitter's part (uniform), a resin's standard uncertainty (normal), or the tolerances of the design (uniform).
    """
    process: Path | None = None
    """Process file of the printer: wall growth and shrinkage vary as specified in it, in place of the tolerances of
    lengths.
    """
    compensated: bool = False
    """The drawing is compensated for the process of --process: the mean deviation of growth and shrinkage is 0."""
    adjust: str | None = None
    """Adjustment of each print on the bench, KEY=LIMIT, as in emitter.offset_mm=0.05: the parameter is changed by up to
    this limit until the contrast at the design's null is zero. Every print is then traced twice.
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
    """Statistics of prints of a design whose parameters vary.

    Attributes
    ----------
    name
        Name of the design.
    prints, seed
        Number of traced prints, and their seed.
    yields
        Yield of each requirement and, as the last one, that of all together.
    varied
        Parameters that vary, in descending order of yield loss.
    spreads
        Variation of each merit.
    traced
        Number of prints that were traced rather than read from the store.
    deviations
        Deviations (P,) of the prints, keyed by parameter.
    merits
        Merits (P,) of the prints and their uncertainties, keyed by name.
    met
        Whether (P,) each print meets all requirements.
    """

    name: str
    prints: int
    seed: int
    yields: tuple[Yield, ...]
    varied: tuple[VariedParameter, ...]
    spreads: tuple[MeritSpread, ...]
    traced: int
    warnings: tuple[str, ...]
    deviations: Mapping[str, FloatArray] = field(metadata=HIDDEN)
    merits: Mapping[str, FloatArray] = field(metadata=HIDDEN)
    met: BoolArray = field(metadata=HIDDEN)
    simulated: bool = True

    def dataset_parts(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Return variables (merits), coordinates (deviations) and attributes of a dataset along ``print``."""
        coordinates = {"print": np.arange(1, self.prints + 1)} | {
            key: ("print", x) for key, x in self.deviations.items()
        }
        variables = {name: ("print", values) for name, values in (*self.merits.items(), ("meets_all", self.met))}
        return variables, coordinates, {"title": f"Prints of {self.name}", "simulated": 1}

    def table(self) -> str:
        """Return a CSV table of the prints: number, deviations, merits with u, and whether all requirements are met."""
        columns = {f"{key} off by": values for key, values in self.deviations.items()} | dict(self.merits)
        head = ["print", *columns, "meets all"]
        rows = zip(*(values.tolist() for values in columns.values()), self.met.tolist(), strict=True)
        lines = [",".join(head)]
        for print_number, (*values, met) in enumerate(rows, start=1):
            cells = ("" if math.isnan(value) else f"{value:.9g}" for value in values)
            lines.append(",".join([str(print_number), *cells, "yes" if met else "no"]))
        return SIMULATED + "\n".join([*lines, ""])


def tolerance(
    subject: Subject,
    options: ToleranceOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    machine: Machine | None = None,
    printed_by: Settings | None = None,
) -> Tolerances:
    """Trace prints of a design whose parameters vary; the arguments are those of `solen.explore.sweep`.

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
    variations = _variations(sensor, options)
    deviations = draw_deviations(variations, options.prints, options.seed)
    cases = [{}, *(deviations_by_key(variations, row) for row in deviations.tolist())]
    known = len(store.points)

    def traced(cases: Sequence[Mapping[str, float]], progress: Progress | None) -> list[Point]:
        variants = (partial(Variant, design, case, printed_by) for case in cases)
        return responses(variants, options.accuracy, store, progress, machine)

    passes = 1 if adjustment is None else 2
    points = traced(cases, part_of(progress, 0, passes))
    failures = failures_of(points[1:])
    if not points[0].is_traced:
        raise SpecError("design", limit=f"has no response: {points[0].why}")
    if sum(failures.values()) == options.prints:
        raise SpecError("prints", limit=f"none has a response; the first reason: {next(iter(failures))}")
    merits = merits_of_points(measure, points)
    base = {name: float(values[0]) for name, values in merits.items()}
    print_merits = {name: values[1:] for name, values in merits.items()}
    prints = Prints(variations, deviations, print_merits, base, calibrated=measure.calibrated)
    if adjustment is not None:
        design_points = traced([{adjustment.key: step} for step in adjustment.steps], None)
        adjusted = adjustment.applied(measure.angle_deg, base["null_deg"], design_points, points[1:], cases[1:])
        adjusted_points = traced(adjusted, part_of(progress, 1, passes))
        prints = replace(prints, adjusted=replace(prints, merits=merits_of_points(measure, adjusted_points)))
    return Tolerances(
        name=design.name,
        prints=options.prints,
        seed=options.seed,
        yields=tuple(prints.yields(requirements)),
        varied=tuple(prints.varied(sensor, requirements)),
        spreads=tuple(prints.spreads()),
        traced=len(store.points) - known,
        warnings=(
            *point_warnings(measure, points, failures),
            *_unmet_by_design(requirements, base),
            *_without_effect(variations, points[0], traced),
        ),
        deviations={variation.key: column for variation, column in zip(variations, deviations.T, strict=True)},
        merits=prints.merits,
        met=prints.met(requirements, prints.merits),
    )


def _variations(sensor: Sensor, options: ToleranceOptions) -> list[Variation]:
    if options.compensated and options.process is None:
        limit = "requires a process specified with --process, but there is none"
        raise SpecError("--compensated", limit=limit, remedy="add --process FILE, or omit --compensated")
    return variations_of(sensor, options.vary, options.process, compensated=options.compensated)


def _without_effect(
    variations: Sequence[Variation],
    base: Point,
    traced: Callable[[Sequence[Mapping[str, float]], Progress | None], Sequence[Point]],
) -> Iterator[str]:
    """Yield warnings about specified variations that change no response when applied alone."""
    specified = [variation for variation in variations if variation.source == SPECIFIED]
    probability = np.array([TEST_PROBABILITY])
    cases = [deviations_by_key([variation], variation.quantile(probability).tolist()) for variation in specified]
    for variation, point in zip(specified, traced(cases, None), strict=True):
        if point.content == base.content:
            yield f"{variation.key} changes no response when varied alone; omit --vary {variation.key}"


def _unmet_by_design(requirements: Sequence[Requirement], base: Mapping[str, float]) -> Iterator[str]:
    """Yield warnings about requirements that the design itself does not meet."""
    merits = {name: np.array([value]) for name, value in base.items()}
    for requirement in requirements:
        if not requirement.met(merits, base)[0]:
            values = ", ".join(f"{name} is {base[name]:.4g}" for name in requirement.merits)
            yield (
                f"the design itself does not meet {requirement.text}: its {values}; tighter tolerances cannot "
                "correct this: change the design or the requirement"
            )


def print_design(subject: Subject, options: ToleranceOptions) -> Design | None:
    """Return the design of the requested print, with its deviations; None if no print was requested.

    Raises
    ------
    SpecError
        If there is no such print, or a design file cannot describe it.
    """
    print_number = options.print_number
    if print_number is None:
        return None
    if print_number > options.prints:
        limit, remedy = f"prints are numbered from 1 to {options.prints}", "specify one of these numbers"
        raise SpecError("--print-number", value=print_number, limit=limit, remedy=remedy)
    design = design_of(subject)
    sensor = Sensor.of(design)
    variations = _variations(sensor, options)
    row = draw_deviations(variations, options.prints, options.seed)[print_number - 1]
    deviations = deviations_by_key(variations, row.tolist())
    values = {key: number(sensor, key) + step for key, step in deviations.items()}
    if "emitter.distance_mm" in values and sensor.has_lens:
        by_growth = any(
            variation.effects is not None and "emitter.distance_mm" in variation.weights for variation in variations
        )
        why = "growth of --process moves the lens towards the emitter" if by_growth else "emitter.distance_mm varies"
        limit = f"{why}, and the lens of a design file is designed for the distance specified in the file"
        remedy = f"{'omit --process' if by_growth else KEEP_CONSTANT}; the table contains this print"
        raise SpecError("--print-number", value=print_number, limit=limit, remedy=remedy)
    if "material.index" in values and design.material.resin is not None:
        if sensor.is_loaded or sensor.light.spectrum:
            limit = "material.index varies, and a design without its resin specifies neither stiffness nor dispersion"
            raise SpecError("--print-number", value=print_number, limit=limit, remedy=KEEP_CONSTANT)
        values = {"material.absorption_per_mm": sensor.material.absorption_per_mm} | values
    if sensor.has_lens and not sensor.is_measured and {"material.index", "emitter.wavelength_nm"} & values.keys():
        values = {"lens.design_index": sensor.design.lens.design_index or sensor.material.index} | values
    if "material.index" in values:  # replaces the resin, with its loss and its dispersion
        built = with_deviations(sensor, deviations).material
        values |= {"material.index": built.index, "material.absorption_per_mm": built.absorption_per_mm}
    return design.set(values)

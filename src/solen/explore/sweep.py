"""A sweep: the response and the merits of a design over values of any of its keys.

The interface: `sweep` of a design by `SweepOptions` returns a `Sweep`; `responses` traces any designs and keeps them in
a `Store`.
"""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

import solen
from solen.arrays import FloatArray, Progress, part_of
from solen.errors import DesignError, SpecError
from solen.explore.axes import Axis, axis, check_axes, grid, sampled
from solen.explore.machines import Here, Machine
from solen.explore.measures import Measure, measure_of, merits_of_points
from solen.explore.merits import worst_place
from solen.explore.robust import cases_of
from solen.explore.still import still_in_samples, still_on_grid
from solen.explore.store import Accuracy, Point, Store, Variant, no_response
from solen.explore.subject import Subject, design_of
from solen.extras import need
from solen.results import HIDDEN, Result, reported
from solen.sensor import Sensor
from solen.sensor.numbers import inert
from solen.spec import Design, dumps, with_values
from solen.spec.strict import Finite, Options

if TYPE_CHECKING:
    import xarray

MOST_REASONS = 3
LOT = 2**14
"""Points whose designs are in memory at once."""
BLOCK_S, BLOCK_POINTS = 5.0, 256
"""Points are written after this time at the latest, and so many at once at most."""
NUMBER = re.compile(r"[-+]?\d[\d.,]*(e[-+]?\d+)?")
OF_THE_MOTION = ("motion.from_deg", "motion.to_deg", "motion.step_deg", "network.motion[")


class AccuracyOptions(Options):
    """How closely responses are traced."""

    tolerance: Finite | None = Field(None, ge=1e-6, le=1e-2)
    """Largest uncertainty of a power, as a share of the emitted power; default: 1e-6 for a point in one colour, 1e-4
    for any other source."""
    rays: int | None = Field(None, ge=256, le=10_000_000)
    """Trace so many rays at each angle by the compiled batch in place of integrating, which is quicker for very many
    designs with a chip in the plane. Designs that the batch does not know are integrated."""

    @property
    def accuracy(self) -> Accuracy:
        """The same for the machine that traces."""
        return Accuracy(self.tolerance, self.rays)


class SweepOptions(AccuracyOptions):
    """Axes of a sweep."""

    over: tuple[str, ...] = ()
    """A key of the design and its values, KEY=FROM:TO:NUMBER or KEY=VALUE,VALUE,...; with --samples, KEY=FROM:TO;
    repeatable."""
    samples: int | None = Field(None, ge=2)
    """Draw so many points of a scrambled Sobol' sequence in place of the grid of all values."""
    seed: int = Field(0, ge=0)
    """Seed of the samples."""
    part: str | None = None
    """Trace one of several parts of the points alone, as in 3/10; each part has a table of its own."""

    @property
    def stem(self) -> str:
        """End of the names of what the sweep writes."""
        return "sweep" if self.part is None else f"sweep-{self.part.replace('/', '-of-')}"

    def folder(self, out: Path) -> Path:
        """Where its points are kept: those of a part in a folder of their own, so that memory holds one part."""
        return out if self.part is None else out / self.stem

    robust: tuple[str, ...] = ()
    """A number and how far off it may be, KEY=DEVIATION: each point is traced with it off to either side as well, in
    all combinations, and the worst of each merit is in the table, worst_NAME; repeatable."""


class Sweep(Result):
    """Responses of a design over values of its keys, P points of A angles.

    Attributes
    ----------
    name
        Name of the design.
    values
        By key the P values; of a grid the last key runs fastest.
    shape
        Number of values of each key of a grid; one number, P, for samples or a part.
    seed
        Seed of the samples; None for a grid.
    part
        Part of the points, such as 3/10; None for all.
    first
        Number of the first point among all.
    merits
        By name of merit (`Merits`) the P values, and their uncertainties by ``u_`` and that name. With deviations also
        the worst over these, by ``worst_`` and that name.
    failures
        Reasons why points have no response, and how many have each; those that differ in numbers alone are one.
    traced
        Number of responses traced now; the others were known.
    robust
        Deviations with which each point was traced as well.
    angle_deg, power, u_power
        Angles (A,) and powers (P, A, 2) at the right and the left receiver; of a network the angles (A, M) of M motions
        in A states and powers (P, A, C) of C receivers, of each emitter in turn. NaN where a point has no response.
    labels
        Of a network the names of its motions, emitters and receivers.
    design
        The design before its values are set, as TOML.
    """

    name: str
    values: Mapping[str, Sequence[Any]]
    shape: tuple[int, ...]
    seed: int | None
    merits: Mapping[str, FloatArray]
    failures: Mapping[str, int]
    traced: int
    robust: tuple[dict[str, float], ...]
    warnings: tuple[str, ...]
    angle_deg: FloatArray = field(metadata=HIDDEN)
    power: FloatArray = field(metadata=HIDDEN)
    u_power: FloatArray = field(metadata=HIDDEN)
    design: str = field(metadata=HIDDEN)
    part: str | None = None
    first: int = 0
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict, metadata=HIDDEN)
    simulated: bool = True

    @property
    def contrast(self) -> FloatArray:
        """Contrast (P, A) of two receivers."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.power[..., 0] - self.power[..., 1]) / self.power.sum(axis=-1))

    @reported
    def points(self) -> int:
        """Number of points."""
        return int(np.prod(self.shape))

    @property
    def is_grid(self) -> bool:
        """Whether it is a grid of all values, rather than samples."""
        return self.seed is None and self.part is None

    @property
    def axes(self) -> dict[str, list[Any]]:
        """The distinct values of each key of a grid."""
        return {key: list(dict.fromkeys(values)) for key, values in self.values.items()}

    def to_dataset(self) -> "xarray.Dataset":
        """The sweep as an xarray dataset: a grid has a dimension for each key, samples have ``sample``.

        Raises
        ------
        OutputError
            Where xarray is not installed.
        """
        need("xarray", what="to_dataset", doing="a dataset")
        import xarray

        names = tuple(self.values) if self.is_grid else ("sample",)
        numbers = {} if self.part is None else {"sample": np.arange(self.first, self.first + self.points)}
        values = (
            {key: (key, own) for key, own in self.axes.items()}
            if self.is_grid
            else {key: ("sample", list(own)) for key, own in self.values.items()}
        )
        coordinates: dict[str, Any] = {**values, **numbers}
        variables: dict[str, Any] = {name: (names, merit.reshape(self.shape)) for name, merit in self.merits.items()}
        if self.labels:
            coordinates |= {name: (name, list(own)) for name, own in self.labels.items()}
            coordinates["angle_deg"] = (("state", "motion"), self.angle_deg)
            ends = [len(self.labels[name]) for name in ("emitter", "receiver")]
            for name in ("power", "u_power"):
                curve = getattr(self, name).reshape(*self.shape, -1, *ends)
                variables[name] = ((*names, "state", "emitter", "receiver"), curve)
        else:
            coordinates["angle_deg"] = ("angle_deg", self.angle_deg)
            for name, curve in self._curves().items():
                variables[name] = ((*names, "angle_deg"), curve.reshape(*self.shape, -1))
        attributes = {
            "title": f"Sweep of {self.name}",
            "comment": "Simulated, not measured. Powers are fractions of the emitted power.",
            "source": f"solen {solen.__version__}",
            "design": self.design,
            "simulated": 1,
        }
        return xarray.Dataset(variables, coordinates, attributes)

    def _curves(self) -> dict[str, FloatArray]:
        """Responses (P, A) of two receivers."""
        u_power = self.u_power.max(axis=-1)
        with np.errstate(invalid="ignore"):
            u_contrast = 2.0 * u_power / self.power.sum(axis=-1)
        right, left = np.moveaxis(self.power, -1, 0)
        return {"right": right, "left": left, "u_power": u_power, "contrast": self.contrast, "u_contrast": u_contrast}


def sweep(
    subject: Subject,
    options: SweepOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    machine: Machine | None = None,
) -> Sweep:
    """Responses and merits of a design over values of its keys.

    Parameters
    ----------
    subject
        What the values are set in: a sensor, a design, or the path of a design file.
    options
        The axes.
    store
        What is known already, and where points are kept as they come; default: in memory alone.
    progress
        Called with the share done, up to 1.
    machine
        What traces the points; default: this process.

    Raises
    ------
    SpecError
        Where an axis is malformed, or no point is a valid design.
    """
    store, design = Store() if store is None else store, design_of(subject)
    axes = [axis(text, design) for text in options.over]
    numbers = check_axes(axes, options.samples, options.part)
    measure = measure_of(design)
    _check_axes(axes)
    if options.samples is None and "seed" in options.model_fields_set:
        limit = "is the seed of --samples, and a grid has none"
        raise SpecError("--seed", value=options.seed, limit=limit, remedy="add --samples N, or leave it out")
    points = list(grid(axes, numbers) if options.samples is None else sampled(axes, numbers, options.seed))
    known = len(store.points)
    cases = list(cases_of(Sensor.of(design), options.robust, mirrors=False))

    def trace(
        points: Sequence[Mapping[str, Any]],
        cases: Sequence[Mapping[str, float]] = ({},),
        progress: Progress | None = None,
    ) -> list[Point]:
        variants = (partial(_set_in, design, point, case) for point in points for case in cases)
        return responses(variants, options.accuracy, store, progress, machine)

    traced = trace(points, cases, progress)
    as_it_is = traced[:: len(cases)]
    is_grid = options.samples is None and options.part is None
    still = still_on_grid(axes, as_it_is) if is_grid else list(still_in_samples(axes, points, as_it_is, trace))
    values = {one.key: [point[one.key] for point in points] for one in axes}
    shape = tuple(len(one.values) for one in axes) if is_grid else (len(points),)
    seed = None if options.samples is None else options.seed
    swept = _swept(design, measure, values, shape, seed, traced, cases, len(store.points) - known)
    swept = replace(swept, part=options.part, first=numbers.start)
    return replace(swept, warnings=(*swept.warnings, *(_has_no_effect(design, key) for key in still)))


def _has_no_effect(design: Design, key: str) -> str:
    """Warning about a key that changes nothing, and why where that is known."""
    try:
        why = inert(Sensor.of(design), key)
    except (SpecError, DesignError):
        why = ""
    return f"{key} changes no response at any point{f': {why}' if why else ''}; leave --over {key} out"


def _set_in(design: Design, point: Mapping[str, Any], off: Mapping[str, float]) -> Variant:
    return Variant(with_values(design, point), off)


def _worst(measure: Measure, points: Sequence[Point], cases: int) -> dict[str, FloatArray]:
    """Worst of each merit over the cases of each point, and its uncertainty there."""
    table = {name: column.reshape(-1, cases) for name, column in merits_of_points(measure, points).items()}
    found = {}
    for name in measure.names:
        place = np.array([worst_place(name, row) for row in table[name]])[:, None]
        for key in (name, f"u_{name}"):
            found[f"u_worst_{name}" if key != name else f"worst_{name}"] = np.take_along_axis(table[key], place, 1)[
                :, 0
            ]
    return found


def _check_axes(axes: Sequence[Axis]) -> None:
    """All points of a sweep have the same angles."""
    bad = next((one.key for one in axes if one.key.startswith(OF_THE_MOTION)), None)
    if bad is not None:
        limit = "all points of a sweep have the same angles"
        raise SpecError(f"--over {bad}", limit=limit, remedy="set it with --set")


def responses(
    variants: Iterable[Callable[[], Variant]],
    accuracy: Accuracy,
    store: Store,
    progress: Progress | None = None,
    machine: Machine | None = None,
) -> list[Point]:
    """Responses of designs, in their order: known ones from the store, others traced and kept there as they come.

    A design that cannot be built or traced is a point without angles that says why. They are traced by this process,
    or by another machine.
    """
    every = list(variants)
    machine = machine or Here()
    named: list[str | Point] = []
    lots = range(0, len(every), LOT)
    for done, first in enumerate(lots):
        lot = every[first : first + LOT]
        named += _named(lot, accuracy, store, machine, part_of(progress, done, len(lots)))
    return [store.points[one] if isinstance(one, str) else one for one in named]


def _named(
    variants: Sequence[Callable[[], Variant]],
    accuracy: Accuracy,
    store: Store,
    machine: Machine,
    progress: Progress | None,
) -> list[str | Point]:
    """Names of responses that are in the store then, or points of designs that cannot be."""
    named: list[str | Point] = []
    missing: dict[str, Variant] = {}
    for make in variants:
        try:
            variant = make()
            named.append(name := variant.name(accuracy))
        except (SpecError, DesignError) as bad:  # the same at any time, and quickly
            named.append(no_response(bad))
            continue
        if name not in store.points:
            missing[name] = variant
    _trace(missing, accuracy, store, machine, progress)
    return named


def _trace(
    missing: Mapping[str, Variant],
    accuracy: Accuracy,
    store: Store,
    machine: Machine,
    progress: Progress | None,
) -> None:
    """Trace variants and keep them, in blocks."""
    fresh: dict[str, Point] = {}
    written, done = time.monotonic(), 0
    try:
        for points in machine.traced(missing, accuracy):
            fresh |= points
            done += len(points)
            if len(fresh) >= BLOCK_POINTS or time.monotonic() - written > BLOCK_S:
                store.add(fresh)
                fresh, written = {}, time.monotonic()
            if progress is not None:
                progress(done / len(missing))
    finally:
        store.add(fresh)


def failures_of(points: Sequence[Point]) -> dict[str, int]:
    """Reasons why points have no response, the most frequent first, with their numbers.

    Reasons that differ in their numbers alone count as the first of them.
    """
    reasons = [point.why for point in points if not point.is_traced]
    first = {NUMBER.sub("", why): why for why in reversed(reasons)}
    return {first[kind]: number for kind, number in Counter(NUMBER.sub("", why) for why in reasons).most_common()}


def _swept(
    design: Design,
    measure: Measure,
    values: Mapping[str, Sequence[Any]],
    shape: tuple[int, ...],
    seed: int | None,
    every: Sequence[Point],
    cases: Sequence[Mapping[str, float]],
    traced: int,
) -> Sweep:
    points, failures = every[:: len(cases)], failures_of(every)
    first = next((point for point in points if point.is_traced), None)
    if first is None:
        raise SpecError("sweep", limit=f"no point has a response; the first: {next(iter(failures))}")
    nothing = np.full_like(first.power, np.nan)
    power, u_power = (
        np.array([getattr(point, name) if point.is_traced else nothing for point in points])
        for name in ("power", "u_power")
    )
    return Sweep(
        name=design.name,
        values=values,
        shape=shape,
        seed=seed,
        merits=merits_of_points(measure, points) | (_worst(measure, every, len(cases)) if cases[1:] else {}),
        failures=failures,
        traced=traced,
        robust=tuple(dict(case) for case in cases[1:]),
        warnings=tuple(point_warnings(measure, every, failures)),
        angle_deg=measure.angle_deg,
        power=power,
        u_power=u_power,
        labels=measure.labels,
        design=dumps(design),
    )


def point_warnings(measure: Measure, points: Sequence[Point], failures: Mapping[str, int]) -> Iterator[str]:
    """Warnings about points without a response, and about those that did not reach the tolerance."""
    if failures:
        many, first = sum(failures.values()), next(iter(failures))
        others = "".join(f"; {number} of them: {why}" for why, number in list(failures.items())[1:MOST_REASONS])
        more = f"; and {len(failures) - MOST_REASONS} further reasons" if len(failures) > MOST_REASONS else ""
        yield f"{many} of {len(points)} points have no response: {first}{others}{more}"
    yield from measure.warnings(points)
    rough = [point.why for point in points if point.is_traced and point.why]
    if rough:
        yield f"{len(rough)} of {len(points)} points missed the tolerance; their u states what was reached: {rough[0]}"

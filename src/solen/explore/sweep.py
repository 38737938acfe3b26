"""A sweep: the response and the figures of merit of a design over values of any of its keys.

Public names: `sweep` and `SweepOptions`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from solen.arrays import FloatArray
from solen.errors import DesignError, SpecError
from solen.explore.axes import Axis, axis, check_axes, grid, sampled
from solen.explore.chips import chips_last, chips_of
from solen.explore.machines import Machine
from solen.explore.measures import Measure, measure_of, merits_of_points
from solen.explore.merits import worst_index
from solen.explore.responses import AccuracyOptions, failures_of, point_warnings, responses
from solen.explore.robust import cases_of
from solen.explore.store import Chip, Point, Store, Variant
from solen.explore.subject import Subject, design_of
from solen.explore.swept import Sweep
from solen.explore.unused_axes import unused_in_samples, unused_on_grid
from solen.progress import Progress
from solen.sensor import Sensor
from solen.sensor.numbers import why_inert
from solen.spec import Design, dumps, with_values

MOTION_KEYS = ("motion.from_deg", "motion.to_deg", "motion.step_deg", "network.motion[")


class SweepOptions(AccuracyOptions):
    """Axes of a sweep."""

    over: tuple[str, ...] = ()
    """A key of the design and its values: KEY=FROM:TO:NUMBER or KEY=VALUE,VALUE,...; with --samples, KEY=FROM:TO;
    repeatable.
    """
    samples: int | None = Field(None, ge=2)
    """Number of points of a scrambled Sobol' sequence, which replace the grid of all values."""
    seed: int = Field(0, ge=0)
    """Seed of the samples."""
    part: str | None = None
    """Part of the points to trace, as in 3/10; each part is written to a separate table."""

    @property
    def stem(self) -> str:
        """Stem of the names of the files written by the sweep."""
        return "sweep" if self.part is None else f"sweep-{self.part.replace('/', '-of-')}"

    def folder(self, out: Path) -> Path:
        """Return the folder of the points; each part has a separate folder, so that only that part is in memory."""
        return out if self.part is None else out / self.stem

    robust: tuple[str, ...] = ()
    """A parameter and its deviation, KEY=DEVIATION: each point is also traced with the parameter deviating to either
    side, in all combinations, and the table contains the worst value of each merit, worst_NAME; repeatable.
    """


def sweep(
    subject: Subject,
    options: SweepOptions,
    store: Store | None = None,
    progress: Progress | None = None,
    machine: Machine | None = None,
) -> Sweep:
    """Compute responses and figures of merit of a design over values of its keys.

    Parameters
    ----------
    subject
        The initial design: a sensor, a design, or the path of a design file.
    options
        The axes.
    store
        Store of known points, to which new ones are added; default: a store in memory.
    progress
        Function called with the completed fraction, up to 1.
    machine
        Machine that traces the points; default: this process.

    Raises
    ------
    SpecError
        If an axis is malformed, or no point is a valid design.
    """
    store, design = Store() if store is None else store, design_of(subject)
    axes = [axis(text, design) for text in options.over]
    indices = check_axes(axes, options.samples, options.part)
    measure = measure_of(design)
    _check_same_angles(axes)
    if options.samples is None and "seed" in options.model_fields_set:
        limit = "is the seed of --samples, and a grid uses no seed"
        raise SpecError("--seed", value=options.seed, limit=limit, remedy="add --samples N, or omit --seed")
    points = list(grid(axes, indices) if options.samples is None else sampled(axes, indices, options.seed))
    known = len(store.points)
    cases = list(cases_of(Sensor.of(design), options.robust, mirrors=False))

    is_grid = options.samples is None and options.part is None
    chips = chips_of(design, axes) if is_grid and options.rays is not None and not cases[1:] else ()

    def trace(
        points: Sequence[Mapping[str, Any]],
        cases: Sequence[Mapping[str, float]] = ({},),
        progress: Progress | None = None,
    ) -> list[Point]:
        variants = (partial(_variant, design, point, case, chips) for point in points for case in cases)
        return responses(variants, options.accuracy, store, progress, machine)

    order = chips_last(axes) if chips else range(len(points))
    traced = trace([points[index] for index in order], cases, progress)
    traced = [traced[index] for index in np.argsort(order)] if chips else traced
    new = sum(point.is_traced for point in list(store.points.values())[known:])
    nominal = traced[:: len(cases)]
    unused = unused_on_grid(axes, nominal) if is_grid else list(unused_in_samples(axes, points, nominal, trace))
    values = {axis.key: [point[axis.key] for point in points] for axis in axes}
    shape = tuple(len(axis.values) for axis in axes) if is_grid else (len(points),)
    seed = None if options.samples is None else options.seed
    swept = _swept(design, measure, values, shape, seed, traced, cases, new)
    swept = replace(swept, part=options.part, first=indices.start)
    return replace(swept, warnings=(*swept.warnings, *(_no_effect_warning(design, key) for key in unused)))


def _no_effect_warning(design: Design, key: str) -> str:
    """Return a warning about a key that changes nothing, with the reason if it is known."""
    try:
        why = why_inert(Sensor.of(design), key)
    except (SpecError, DesignError):
        why = ""
    return f"{key} changes no response at any point{f': {why}' if why else ''}; omit --over {key}"


def _variant(
    design: Design, point: Mapping[str, Any], deviations: Mapping[str, float], chips: tuple[Chip, ...] = ()
) -> Variant:
    return Variant(with_values(design, point), deviations, chips=chips)


def _worst(measure: Measure, points: Sequence[Point], cases: int) -> dict[str, FloatArray]:
    """Return the worst value of each merit over the cases of each point, and the uncertainty of that value."""
    table = {name: column.reshape(-1, cases) for name, column in merits_of_points(measure, points).items()}
    worst = {}
    for name in measure.names:
        index = np.array([worst_index(name, row) for row in table[name]])[:, None]
        worst[f"worst_{name}"] = np.take_along_axis(table[name], index, 1)[:, 0]
        worst[f"u_worst_{name}"] = np.take_along_axis(table[f"u_{name}"], index, 1)[:, 0]
    return worst


def _check_same_angles(axes: Sequence[Axis]) -> None:
    key = next((axis.key for axis in axes if axis.key.startswith(MOTION_KEYS)), None)
    if key is not None:
        limit = "all points of a sweep must have the same angles"
        raise SpecError(f"--over {key}", limit=limit, remedy="specify a single value with --set")


def _swept(
    design: Design,
    measure: Measure,
    values: Mapping[str, Sequence[Any]],
    shape: tuple[int, ...],
    seed: int | None,
    all_points: Sequence[Point],
    cases: Sequence[Mapping[str, float]],
    traced: int,
) -> Sweep:
    points, failures = all_points[:: len(cases)], failures_of(all_points)
    first = next((point for point in points if point.is_traced), None)
    if first is None:
        raise SpecError("sweep", limit=f"no point has a response; the first reason: {next(iter(failures))}")
    missing = np.full_like(first.power, np.nan)
    power, u_power = (
        np.array([getattr(point, name) if point.is_traced else missing for point in points])
        for name in ("power", "u_power")
    )
    return Sweep(
        name=design.name,
        values=values,
        shape=shape,
        seed=seed,
        merits=merits_of_points(measure, points) | (_worst(measure, all_points, len(cases)) if cases[1:] else {}),
        failures=failures,
        traced=traced,
        robust=tuple(dict(case) for case in cases[1:]),
        warnings=tuple(point_warnings(measure, all_points, failures)),
        angle_deg=measure.angle_deg,
        power=power,
        u_power=u_power,
        labels=measure.labels,
        design=dumps(design),
    )

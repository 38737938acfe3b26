"""The task of a search: goals, conditions, free parameters, deviations, and the process that prints its designs.

Public name: `Task`.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.axes import Axis, axis
from solen.explore.measures import measure_of
from solen.explore.optimise.options import OptimiseOptions
from solen.explore.printed_lens import check_printable
from solen.explore.requirement import Expression, Goal, Limit
from solen.explore.robust import cases_of
from solen.explore.variations import check_key
from solen.fabricate.process import Process, process_of, with_resin
from solen.lens import SplineLens
from solen.sensor import Sensor
from solen.sensor.numbers import number
from solen.spec import Design, with_values

MAX_GOALS = 2
TRIALS_PER_DESIGN = 10
"""Smallest number of designs tried for each design of a front."""
FORMS = "write KEY=LOW:HIGH"


class Task(NamedTuple):
    """The task of a search.

    Parameters
    ----------
    design, sensor
        The initial design.
    goals, signs
        The goals, with sign 1 to minimise and −1 to maximise.
    limits
        Conditions to be met.
    free
        Free parameters, each with its limits.
    cases
        Deviations of the built part in each case, keyed by parameter; the first case has none.
    process
        Process that prints the designs, if one was specified.
    as_printed
        Whether designs are traced with the printed lens.
    """

    design: Design
    sensor: Sensor
    goals: tuple[Goal, ...]
    signs: tuple[float, ...]
    limits: tuple[Limit, ...]
    free: tuple[Axis, ...]
    cases: tuple[dict[str, float], ...]
    process: Process | None
    as_printed: bool

    @classmethod
    def of(cls, design: Design, options: OptimiseOptions) -> "Task":
        """Create the task from a design and options.

        Raises
        ------
        SpecError
            If goals, conditions, free parameters or deviations are malformed.
        DataError
            If the process cannot be read.
        """
        known = measure_of(design).names
        goals = tuple(Goal.parse(text, known) for text in (*options.minimise, *options.maximise))
        _check_goals(goals, options)
        sensor = Sensor.of(design)
        free = tuple(_free(sensor, options.free))
        limits = tuple(Limit.parse(text, known) for text in options.subject_to)
        _check_worst((*goals, *limits), options)
        merits = {name for expression in (*goals, *limits) for name in expression.merits}
        motion = design.motion
        mirrors = motion.from_deg == -motion.to_deg and "null_deg" not in merits and not sensor.is_network
        mirrors = mirrors and all(axis.key != "emitter.offset_mm" for axis in free)
        return cls(
            design=design,
            sensor=sensor,
            goals=goals,
            signs=(1.0,) * len(options.minimise) + (-1.0,) * len(options.maximise),
            limits=limits,
            free=free,
            cases=tuple(cases_of(sensor, options.robust, mirrors=mirrors)),
            process=_process(sensor, options),
            as_printed=options.as_printed,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the goals, such as "minimise linearity_percent"."""
        words = ("maximise" if sign < 0.0 else "minimise" for sign in self.signs)
        return tuple(f"{word} {goal.text}" for word, goal in zip(words, self.goals, strict=True))

    @property
    def printed_by(self) -> str | None:
        """Name of the process whose printed lens is traced, or None for the designed lens."""
        return self.process.name if self.process is not None and self.as_printed else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the process."""
        return () if self.process is None else tuple(self.process.warnings())

    @property
    def initial_point(self) -> FloatArray:
        """Point of the initial design; a free parameter outside its limits is set to the nearer limit."""
        low, high = np.array([axis.values for axis in self.free]).T
        values = np.array(list(self.free_values(self.sensor).values()))
        return np.asarray(np.clip((values - low) / (high - low), 0.0, 1.0))

    def free_values(self, sensor: Sensor) -> dict[str, float]:
        """Return the values of the free parameters of a sensor, keyed by parameter."""
        return {axis.key: number(sensor, axis.key) for axis in self.free}

    def design_at(self, point: FloatArray) -> Design:
        """Return the design at a point of the box; raise `SpecError` if it is not valid."""
        values = {axis.key: axis.at(fraction) for axis, fraction in zip(self.free, point.tolist(), strict=True)}
        return with_values(self.design, values)

    def min_feature_um(self, lens: SplineLens) -> float:
        """Return the smallest printable feature of a free form, from the process, otherwise from the lens itself."""
        return lens.min_feature_um if self.process is None else self.process.process.min_feature_um


def _check_goals(goals: Sequence[Goal], options: OptimiseOptions) -> None:
    both = "--minimise, --maximise"
    if not 0 < len(goals) <= MAX_GOALS:
        limit = "a search has one goal, or two for a front"
        remedy = "specify one, for example --minimise linearity_percent"
        raise SpecError(both, value=f"{len(goals)} goals", limit=limit, remedy=remedy)
    if len({goal.text for goal in goals}) < len(goals):
        raise SpecError(both, value=goals[0].text, limit="is specified twice", remedy="omit one of the two goals")
    if len(goals) == 1 and "front" in options.model_fields_set:
        limit = "a front requires two goals, but only one is specified"
        raise SpecError("--front", value=options.front, limit=limit, remedy="specify another goal, or omit --front")
    min_evaluations = TRIALS_PER_DESIGN * options.front
    if len(goals) > 1 and options.evaluations < min_evaluations:
        limit = f"a front of {options.front} designs requires at least {min_evaluations}"
        raise SpecError(
            "--evaluations", value=options.evaluations, limit=limit, remedy="increase --evaluations, or reduce --front"
        )


def _check_worst(expressions: Sequence[Expression], options: OptimiseOptions) -> None:
    if options.robust:
        return
    for expression in expressions:
        if expression.worst:
            limit = "worst(...) requires deviations specified with --robust, but there are none"
            raise expression.malformed(expression.text, limit, "add --robust KEY=DEVIATION")


def _free(sensor: Sensor, texts: Sequence[str]) -> Iterator[Axis]:
    """Yield the free parameters with their limits."""
    if not texts:
        raise SpecError("--free", limit="no parameter is free to change", remedy=FORMS)
    keys: set[str] = set()
    for text in texts:
        free = axis(text, sensor.design, "--free", FORMS)
        if free.kind != "range":
            raise SpecError(f"--free {free.key}", limit="is not a range", remedy=FORMS)
        low, high = free.values
        if low > high:
            limit, remedy = "is in descending order", "write the lower limit first"
            raise SpecError(f"--free {free.key}", value=f"{low:g}:{high:g}", limit=limit, remedy=remedy)
        check_key(sensor, free.key, "--free")
        if free.key in keys:
            raise SpecError(f"--free {free.key}", limit="is specified twice", remedy="omit one of the two ranges")
        keys.add(free.key)
        yield free


def _process(sensor: Sensor, options: OptimiseOptions) -> Process | None:
    """Return the named process or, for designs traced as printed, the default one."""
    if options.as_printed:
        check_printable(sensor)
    elif not (options.process or options.printer or options.cure):
        return None
    elif not any(isinstance(lens, SplineLens) for lens in sensor.all_lenses):
        limit = "limits the features of a free-form lens, but the design has none"
        raise SpecError("--process, --printer, --cure", limit=limit, remedy="add --as-printed, or omit these options")
    return with_resin(process_of(options)[0], sensor.design)

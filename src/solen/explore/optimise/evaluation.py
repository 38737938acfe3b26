"""Evaluation of a design for a task: the worst values of its goals, and the conditions that it meets or violates.

Public names: `Evaluator` and `Evaluation`.
"""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.explore.measures import measure_of, merits_of_points
from solen.explore.optimise.task import Task
from solen.explore.requirement import Goal
from solen.explore.responses import responses
from solen.explore.store import Accuracy, Point, Store, Variant
from solen.lens import SplineLens
from solen.results import Result
from solen.sensor import Sensor
from solen.spec import Design

NO_DEVIATIONS: Mapping[str, float] = {}


class GoalResult(Result):
    """One design evaluated for one goal.

    Attributes
    ----------
    goal, u_goal
        Worst value of the goal over all cases (the design with and without deviations), and its uncertainty due to
        those of the merits.
    meets
        Whether each condition is met in all cases, keyed by condition.
    merits
        Merits of the design without deviations and their uncertainties, keyed by name.
    worst_off
        Deviations for which the goal is worst, keyed by parameter; empty for the design without deviations.
    worst
        Merits with these deviations, keyed by name.
    """

    goal: float
    u_goal: float
    meets: dict[str, bool]
    merits: dict[str, float]
    worst_off: dict[str, float]
    worst: dict[str, float]


class Evaluation(NamedTuple):
    """Result of evaluating a design: results for each goal, violation of the conditions, and responses in all cases."""

    by_goal: tuple[GoalResult, ...]
    violation: float
    points: list[Point]

    @property
    def goals(self) -> FloatArray:
        """Worst value of each goal."""
        return np.array([result.goal for result in self.by_goal])

    @property
    def meets(self) -> dict[str, bool]:
        """Whether each condition is met in all cases, keyed by condition."""
        return self.by_goal[0].meets


class Evaluator:
    """Evaluator of designs for a task; responses are traced to a tolerance.

    Attributes
    ----------
    why
        Reason why the last design has no response; otherwise empty.
    """

    def __init__(
        self, task: Task, store: Store, tolerance: float, base: Mapping[str, float] | None = None, lattice: int = 0
    ) -> None:
        self.task, self.store, self.tolerance = task, store, tolerance
        self.measure, self.lattice = measure_of(task.design), lattice
        self.base: Mapping[str, float] = dict.fromkeys(self.measure.names, math.nan) if base is None else base
        self.why = ""

    @classmethod
    def of_task(cls, task: Task, store: Store, tolerance: float) -> tuple["Evaluator", Evaluation]:
        """Return an evaluator with the merits of the initial design as ``base``, and the evaluation of that design.

        Raises
        ------
        SpecError
            If the initial design has no response, or a goal is undefined for it.
        """
        design = task.design
        evaluator = cls(task, store, tolerance)
        first = evaluator.required(design, "design")
        evaluator = cls(task, store, tolerance, first.by_goal[0].merits)
        evaluation = evaluator.required(design, "design")
        for goal, value in zip(task.goals, evaluation.goals.tolist(), strict=True):
            if math.isnan(value):
                limit = f"{goal.text} is undefined for the design or for some of its deviations"
                remedy = "start from a design for which it is defined, or use smaller steps of the motion"
                raise SpecError(goal.option, limit=limit, remedy=remedy)
        return evaluator, evaluation

    def required(self, design: Design, what: str) -> Evaluation:
        """Return the evaluation of a design; raise `SpecError` naming ``what`` if it has no response."""
        evaluation = self.of(design)
        if evaluation is None:
            raise SpecError(what, limit=f"has no response: {self.why}")
        return evaluation

    def of(self, design: Design) -> Evaluation | None:
        """Return the evaluation of a design; None if it has no response in one of the cases."""
        variants = [partial(self.variant, design, case) for case in self.task.cases]
        points = responses(variants, Accuracy(self.tolerance, lattice=self.lattice), self.store)
        self.why = next((point.why for point in points if not point.is_traced), "")
        return None if self.why else self._evaluation(design, points)

    def variant(self, design: Design, case: Mapping[str, float] = NO_DEVIATIONS) -> Variant:
        """Return the variant of a design to be traced, with the deviations of a case."""
        process = self.task.process if self.task.as_printed else None
        return Variant(design, case, None if process is None else process.process)

    def _evaluation(self, design: Design, points: list[Point]) -> Evaluation:
        merits = merits_of_points(measure_of(design), points)
        violations = {limit.text: float(limit.violation(merits, self.base).max()) for limit in self.task.limits}
        violations |= self._feature_violations(design)
        meets = {text: not violation for text, violation in violations.items()}
        by_goal = tuple(
            self._goal_result(goal, sign, merits, meets)
            for goal, sign in zip(self.task.goals, self.task.signs, strict=True)
        )
        undefined = float(any(math.isnan(result.goal) for result in by_goal))
        return Evaluation(by_goal, sum(violations.values()) + undefined, points)

    def _feature_violations(self, design: Design) -> dict[str, float]:
        """Return by how much free-form lenses violate the minimum size of printable features, keyed by condition."""
        violations: dict[str, float] = {}
        for lens in Sensor.of(design).all_lenses:
            if isinstance(lens, SplineLens):
                min_um = self.task.min_feature_um(lens)
                text = f"lens without features below {min_um:.3g} µm"
                violations[text] = max(violations.get(text, 0.0), lens.fine_feature_excess(min_um))
        return violations

    def _goal_result(
        self, goal: Goal, sign: float, merits: Mapping[str, FloatArray], meets: dict[str, bool]
    ) -> GoalResult:
        """Return the result for a goal from the merits (C,) of all cases."""
        values = self._values(goal, merits)
        worst = int(np.argmax(np.where(np.isnan(values), np.inf, sign * values)))
        return GoalResult(
            goal=float(values[worst]),
            u_goal=sum(abs(float(change)) for change in self._changes(goal, merits, worst)),
            meets=meets,
            merits={name: float(column[0]) for name, column in merits.items()},
            worst_off=self.task.cases[worst],
            worst={name: float(column[worst]) for name, column in merits.items()},
        )

    def _changes(self, goal: Goal, merits: Mapping[str, FloatArray], case: int) -> Iterator[float]:
        """Yield the change of a goal in one case due to the uncertainty of each merit."""
        value = self._values(goal, merits)[case]
        for name in goal.merits:
            yield self._values(goal, {**merits, name: merits[name] + merits[f"u_{name}"]})[case] - value

    def _values(self, goal: Goal, merits: Mapping[str, FloatArray]) -> FloatArray:
        """Return a goal (C,) in all cases; NaN if it is undefined or infinite, as for an undetectable motion."""
        values = goal.value(merits, self.base)
        return np.broadcast_to(np.where(np.isfinite(values), values, np.nan), len(self.task.cases))

"""Result of a search for one goal.

Public names: `Optimum` and `optimum_of`.
"""

from collections.abc import Iterator
from dataclasses import field
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.explore.optimise.candidates import Candidate, Candidates
from solen.explore.optimise.evaluation import Evaluation, GoalResult
from solen.explore.optimise.retraced import Retraced, Sampled
from solen.explore.optimise.task import Task
from solen.explore.tolerance import Tolerances
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.spec import Design

LIMIT_FRACTION = 1e-3
"""Largest distance from a limit, as a fraction of the range, at which a free parameter is considered to reach it."""
INTERRUPTED = "interrupted: this is the best result so far; run the same command again to continue"


class FreeParameter(Result, eq=True):
    """A free parameter of a search.

    Attributes
    ----------
    key
        Key of the parameter.
    low, high
        Limits of the parameter.
    before, after
        Value in the initial design and in the result.
    """

    key: str
    low: float
    high: float
    before: float
    after: float


class Optimum(Result):
    """Result of a search.

    Attributes
    ----------
    name
        Name of the design.
    goal
        The goal of the search.
    free
        The free parameters.
    printed_by
        Process whose printed lens was traced in place of the designed lens, or None for the designed lens.
    before, after
        The initial design and the result, both traced with a small tolerance.
    claimed
        Goal of the result during the search.
    sampled_difference, u_sampled_difference
        Largest difference between the integrated and the sampled contrast of the result at a few angles, and its
        uncertainty; None for a network, which is traced again with other samples instead.
    robust
        Whether deviations were specified, in which case the goal is its worst value over them.
    evaluations, max_evaluations, traced
        Number of designs tried, its limit, and the number of responses that were traced rather than read from the
        store.
    interrupted
        Whether the search was stopped before its end.
    prints_before, prints_after
        Statistics of prints of the initial design and of the result with the same tolerances, or None if no prints were
        traced.
    design
        The resulting design.
    angle_deg, contrast_before, contrast_after
        Responses (2, A) without deviations and with those of the worst goal; (2, 0) for a network.
    history
        Best value of the goal up to each evaluation (E,); NaN until a design meets all conditions.
    """

    name: str
    goal: str
    free: tuple[FreeParameter, ...]
    printed_by: str | None
    before: GoalResult
    after: GoalResult
    claimed: float
    sampled_difference: float | None
    u_sampled_difference: float | None
    robust: bool
    evaluations: int
    max_evaluations: int
    traced: int
    interrupted: bool
    warnings: tuple[str, ...]
    design: Design = field(metadata=HIDDEN)
    angle_deg: FloatArray = field(metadata=HIDDEN)
    contrast_before: FloatArray = field(metadata=HIDDEN)
    contrast_after: FloatArray = field(metadata=HIDDEN)
    history: FloatArray = field(metadata=HIDDEN)
    prints_before: Tolerances | None = None
    prints_after: Tolerances | None = None
    simulated: bool = True

    def dataset_parts(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Return variables (contrast, best value), coordinates and attributes of a dataset."""
        coordinates = {
            "design": ["before", "after"],
            "case": ["nominal", "worst"],
            "angle_deg": self.angle_deg,
            "evaluation": np.arange(1, self.history.size + 1),
        }
        contrast = np.array([self.contrast_before, self.contrast_after])
        variables = {"contrast": (("design", "case", "angle_deg"), contrast), "best": ("evaluation", self.history)}
        return variables, coordinates, {"title": f"{self.name}: {self.goal}", "simulated": 1}


def optimum_of(candidates: Candidates, best: Candidate, known: int, *, interrupted: bool) -> Optimum:
    """Return the best candidate, traced again; ``known`` responses were in the store before the search."""
    evaluator, task = candidates.evaluator, candidates.evaluator.task
    traced = len(evaluator.store.points) - known
    design = task.design_at(best.point)
    before, after = Retraced.of(evaluator, task.design), Retraced.of(evaluator, design)
    sampled = Sampled.of(evaluator.variant(design).sensor())
    old, new = task.free_values(task.sensor), task.free_values(Sensor.of(design))
    goals = np.array([np.inf if candidate.violation else candidate.goals[0] for candidate in candidates.tried])
    history = np.minimum.accumulate(np.where(np.isnan(goals), np.inf, goals)) * candidates.scale[0]
    return Optimum(
        name=task.design.name,
        goal=task.names[0],
        free=tuple(
            FreeParameter(axis.key, low, high, old[axis.key], new[axis.key])
            for axis in task.free
            for low, high in [axis.values]
        ),
        printed_by=task.printed_by,
        before=before.evaluation.by_goal[0],
        after=after.evaluation.by_goal[0],
        claimed=after.claimed.by_goal[0].goal,
        sampled_difference=None if sampled is None else sampled.difference,
        u_sampled_difference=None if sampled is None else sampled.u_difference,
        robust=len(task.cases) > 1,
        evaluations=len(candidates.tried),
        max_evaluations=candidates.max_count,
        traced=traced,
        interrupted=interrupted,
        warnings=(
            *task.warnings,
            *after.warnings(),
            *(() if sampled is None else sampled.warnings()),
            *outside_warnings(task),
            *limit_warnings(task, design),
            *_warnings(before, after, task, interrupted=interrupted),
        ),
        design=design,
        angle_deg=np.array([] if task.sensor.is_network else after.design.motion.angles_deg()),
        contrast_before=_curves(before.evaluation, task),
        contrast_after=_curves(after.evaluation, task),
        history=np.where(np.isfinite(history), history, np.nan),
    )


def outside_warnings(task: Task) -> Iterator[str]:
    """Yield warnings about free parameters that are outside their limits in the initial design."""
    for key, value, (low, high) in _free_parameters(task, task.sensor):
        if not low <= value <= high:
            yield f"{key} of the design is {value:g}, outside {low:g} to {high:g}: the search cannot retain this value"


def limit_warnings(task: Task, design: Design) -> Iterator[str]:
    """Yield warnings about free parameters that reach their limits in a design."""
    for key, value, (low, high) in _free_parameters(task, Sensor.of(design)):
        limit = next((limit for limit in (low, high) if abs(value - limit) <= LIMIT_FRACTION * (high - low)), None)
        if limit is not None:
            yield f"{key} reaches its limit, {limit:g}; widen --free {key} if the part allows it"


def _free_parameters(task: Task, sensor: Sensor) -> Iterator[tuple[str, float, tuple[float, float]]]:
    """Yield key, value and limits of each free parameter."""
    values = task.free_values(sensor)
    for axis in task.free:
        low, high = axis.values
        yield axis.key, values[axis.key], (low, high)


def _warnings(before: Retraced, after: Retraced, task: Task, *, interrupted: bool) -> Iterator[str]:
    worse = task.signs[0] * (after.evaluation.by_goal[0].goal - before.evaluation.by_goal[0].goal) > 0.0
    if worse and all(before.evaluation.meets.values()):
        yield "traced with a smaller tolerance, the result is no better than the initial design"
    if interrupted:
        yield INTERRUPTED


def _curves(evaluation: Evaluation, task: Task) -> FloatArray:
    """Return the contrast of a design without deviations and with those of its worst goal; empty for a network."""
    if task.sensor.is_network:
        return np.empty((2, 0))
    worst = task.cases.index(evaluation.by_goal[0].worst_off)
    points = (evaluation.points[0], evaluation.points[worst])
    return np.array([point.response(np.arange(float(len(point.power)))).contrast for point in points])

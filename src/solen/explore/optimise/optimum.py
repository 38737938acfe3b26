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

AT_END = 1e-3
"""Distance from a limit of a free number, as a fraction of its range, within which it counts as having reached the
limit.
"""
INTERRUPTED = "interrupted: this is the best result so far; the same command continues from here"


class FreeNumber(Result, eq=True):
    """A free number of a search.

    Attributes
    ----------
    key
        Key of the number.
    low, high
        Limits of the number.
    before, after
        Its value in the initial design and in the result.
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
        The free numbers.
    printed_by
        Process whose printed lens was traced in place of the designed one, or None for the designed one.
    before, after
        The initial design and the result, both traced with a small tolerance.
    claimed
        Goal of the result during the search.
    sampled_difference, u_sampled_difference
        Largest difference of the result's contrast between integration and samples over its angles, and the uncertainty
        there; None for a network, which is traced again with other samples.
    robust
        Whether deviations were stated, in which case the goal is its worst value over them.
    evaluations, max_evaluations, traced
        Number of designs tried, its limit, and the number of responses that were traced rather than read from the
        store.
    interrupted
        Whether the search was stopped before its end.
    prints_before, prints_after
        Statistics of prints of the initial design and of the result with the same tolerances, or None if none were
        traced.
    design
        The resulting design.
    angle_deg, contrast_before, contrast_after
        Responses without deviations and with those of the worst goal, (2, A); (2, 0) for a network.
    history
        Best value so far by evaluation (E,); NaN before a design met all conditions.
    """

    name: str
    goal: str
    free: tuple[FreeNumber, ...]
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
        """Return the contrast by design, case and angle, and the best value by evaluation."""
        coordinates = {
            "design": ["before", "after"],
            "case": ["nothing off", "worst"],
            "angle_deg": self.angle_deg,
            "evaluation": np.arange(1, self.history.size + 1),
        }
        contrast = np.array([self.contrast_before, self.contrast_after])
        variables = {"contrast": (("design", "case", "angle_deg"), contrast), "best": ("evaluation", self.history)}
        return variables, coordinates, {"title": f"{self.name}: {self.goal}", "simulated": 1}


def optimum_of(candidates: Candidates, best: Candidate, known: int, *, interrupted: bool) -> Optimum:
    """Return the best candidate, traced again; ``known`` is the number of responses in the store before."""
    evaluator, task = candidates.evaluator, candidates.evaluator.task
    traced = len(evaluator.store.points) - known
    found = task.at(best.point)
    before, after = Retraced.of(evaluator, task.design), Retraced.of(evaluator, found)
    sampled = Sampled.of(evaluator.variant(found).sensor())
    was, now = task.stated(task.sensor), task.stated(Sensor.of(found))
    totals = np.array([one.goals[0] if one.violation == 0.0 else np.inf for one in candidates.tried])
    history = np.minimum.accumulate(np.where(np.isnan(totals), np.inf, totals)) * candidates.scale[0]
    return Optimum(
        name=task.design.name,
        goal=task.names[0],
        free=tuple(
            FreeNumber(one.key, low, high, was[one.key], now[one.key])
            for one in task.free
            for low, high in [one.values]
        ),
        printed_by=task.printed_by,
        before=before.evaluation.by_goal[0],
        after=after.evaluation.by_goal[0],
        claimed=after.claimed.by_goal[0].goal,
        sampled_difference=None if sampled is None else sampled.difference,
        u_sampled_difference=None if sampled is None else sampled.u_difference,
        robust=len(task.cases) > 1,
        evaluations=len(candidates.tried),
        max_evaluations=candidates.most,
        traced=traced,
        interrupted=interrupted,
        warnings=(
            *task.warnings,
            *after.warnings(),
            *(() if sampled is None else sampled.warnings()),
            *outside(task),
            *at_ends(task, found),
            *_warnings(before, after, task, interrupted=interrupted),
        ),
        design=found,
        angle_deg=np.array([] if task.sensor.is_network else after.design.motion.angles_deg()),
        contrast_before=_curves(before.evaluation, task),
        contrast_after=_curves(after.evaluation, task),
        history=np.where(np.isfinite(history), history, np.nan),
    )


def outside(task: Task) -> Iterator[str]:
    """Return warnings about free numbers that are outside their limits in the initial design."""
    was = task.stated(task.sensor)
    for one in task.free:
        low, high = one.values
        if not low <= was[one.key] <= high:
            ends = f"{low:g} to {high:g}"
            yield f"{one.key} of the design is {was[one.key]:g}, outside {ends}: the search cannot retain this value"


def at_ends(task: Task, found: Design) -> Iterator[str]:
    """Return warnings about free numbers that reached their limits in the result."""
    now = task.stated(Sensor.of(found))
    for one in task.free:
        low, high = one.values
        end = next((end for end in one.values if abs(now[one.key] - end) <= AT_END * (high - low)), None)
        if end is not None:
            yield f"{one.key} reaches its limit, {end:g}; widen --free {one.key} if the part allows it"


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
    chosen = (evaluation.points[0], evaluation.points[worst])
    return np.array([point.response(np.arange(float(len(point.power)))).contrast for point in chosen])

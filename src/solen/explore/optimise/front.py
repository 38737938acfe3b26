"""The Pareto front of two goals: designs of which none is better than another in both.

Each design of the front is optimal for some weights of the two goals. Each goal is first optimised alone, which gives
the ends of the front and the scales of the goals. Then the larger of the two weighted goals is minimised for weights in
steps from one end to the other. The best design for some weights is chosen from all candidates.

`search_front` searches for the front; `front_of` converts candidates to a `Front`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.explore.optimise.candidates import Candidate, Candidates, best_candidate
from solen.explore.optimise.optimum import INTERRUPTED, limit_warnings, outside_warnings
from solen.explore.optimise.retraced import Retraced, Sampled
from solen.explore.optimise.search import Trials, search
from solen.explore.optimise.task import Task
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.spec import Design

SINGLE_GOAL_WEIGHTS = (np.array([1.0, 0.0]), np.array([0.0, 1.0]))


class FrontDesign(Result):
    """One design of a front, traced with a small tolerance.

    Attributes
    ----------
    number
        Number of the design on the front, where 1 is best in the first goal; 0 for the initial design of the search.
    goals, u_goals
        Worst value of each goal over all cases (the design with and without deviations), and its uncertainty.
    claimed
        Worst value of each goal during the search.
    free
        Values of the free parameters, keyed by parameter.
    meets
        Whether each condition is met in all cases, keyed by condition.
    merits
        Merits of the design without deviations and their uncertainties, keyed by name.
    """

    number: int
    goals: tuple[float, ...]
    u_goals: tuple[float, ...]
    claimed: tuple[float, ...]
    free: dict[str, float]
    meets: dict[str, bool]
    merits: dict[str, float]
    design: Design = field(metadata=HIDDEN)


class Front(Result):
    """Designs of which none is better than another in both of two goals.

    Attributes
    ----------
    name
        Name of the design.
    goals
        The two goals.
    printed_by
        Process whose printed lens was traced in place of the designed lens, or None for the designed lens.
    before
        The initial design of the search.
    designs
        The designs of the front, sorted by the first goal with the best first.
    robust
        Whether deviations were specified, in which case each goal is its worst value over them.
    evaluations, max_evaluations, traced
        Number of designs tried, its limit, and the number of responses that were traced rather than read from the
        store.
    interrupted
        Whether the search was stopped before its end.
    """

    name: str
    goals: tuple[str, ...]
    printed_by: str | None
    before: FrontDesign
    designs: tuple[FrontDesign, ...]
    robust: bool
    evaluations: int
    max_evaluations: int
    traced: int
    interrupted: bool
    warnings: tuple[str, ...]
    simulated: bool = True

    def dataset_parts(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Return variables, coordinates and attributes of a dataset over ``design``, where 0 is the initial design."""
        designs = (self.before, *self.designs)
        coordinates = {"design": [design.number for design in designs], "goal": list(self.goals)}
        goals: dict[str, Any] = {
            name: (("design", "goal"), [getattr(design, name) for design in designs]) for name in ("goals", "u_goals")
        }
        columns = {
            key: ("design", [values[key] for values in rows])
            for rows in ([design.free for design in designs], [design.merits for design in designs])
            for key in rows[0]
        }
        return goals | columns, coordinates, {"title": f"Front of {self.name}", "simulated": 1}


def weights_of(designs: int) -> list[FloatArray]:
    """Return weights of both goals: the two ends first, then steps from one end to the other."""
    inner = np.linspace(0.0, 1.0, designs)[1:-1]
    return [*SINGLE_GOAL_WEIGHTS, *(np.array([1.0 - weight, weight]) for weight in inner.tolist())]


def search_front(candidates: Candidates, designs: int, seed: int) -> None:
    """Search for a front with a number of designs.

    The search for the first goal starts with samples of the box and has twice as many evaluations as later searches.
    """
    per_design = candidates.max_count // (designs + 1)
    for number, weights in enumerate(weights_of(designs)):
        ideal, size = (0.0, 1.0) if number < len(SINGLE_GOAL_WEIGHTS) else ideal_and_scale(candidates)
        objective = _objective(candidates, weights, ideal, size)
        count = per_design if number < designs - 1 else candidates.max_count - len(candidates.tried)
        first = candidates.evaluator.task.initial_point
        if number:
            first = best_candidate(candidates.tried, weights, ideal, size).point
        search(Trials(objective, count if number else 2 * per_design), first, (seed, number), sampled=not number)


def _objective(
    candidates: Candidates, weights: FloatArray, ideal: FloatArray | float, size: FloatArray | float
) -> Callable[[FloatArray], float]:
    return lambda point: candidates(point).objective(weights, ideal, size)


def ideal_and_scale(candidates: Candidates) -> tuple[FloatArray, FloatArray]:
    """Return the best value of each goal so far, and how much worse each goal is at the best value of the other."""
    known = candidates.feasible or candidates.tried
    goals = np.array([best_candidate(known, weights).goals for weights in SINGLE_GOAL_WEIGHTS])
    ideal = goals.min(axis=0)
    size = goals.max(axis=0) - ideal
    return ideal, np.where(size > 0.0, size, 1.0)


def front_of(candidates: Candidates, designs: int, known: int, *, interrupted: bool) -> Front:
    """Return the front of candidates with each design traced again; ``known`` responses were in the store before."""
    evaluator, task = candidates.evaluator, candidates.evaluator.task
    traced = len(evaluator.store.points) - known
    chosen = _chosen(candidates, designs)
    retraced = [Retraced.of(evaluator, task.design_at(candidate.point)) for candidate in chosen]
    kept = _nondominated(np.array([result.evaluation.goals for result in retraced]) / candidates.scale)
    warnings = [*task.warnings, *outside_warnings(task)]
    front: list[FrontDesign] = []
    for candidate, result, is_kept in zip(chosen, retraced, kept, strict=True):
        if is_kept:
            front.append(_design(candidates, len(front) + 1, candidate, result))
            warnings += [f"design {len(front)}: {text}" for text in _warnings(candidates, candidate, result)]
    if not all(kept):
        dominated = len(kept) - sum(kept)
        warnings.append(
            f"traced with a smaller tolerance, {dominated} of {len(kept)} designs are worse than another design in "
            "both goals, and are omitted"
        )
    return Front(
        name=task.design.name,
        goals=task.names,
        printed_by=task.printed_by,
        before=_design(candidates, 0, None, Retraced.of(evaluator, task.design)),
        designs=tuple(front),
        robust=len(task.cases) > 1,
        evaluations=len(candidates.tried),
        max_evaluations=candidates.max_count,
        traced=traced,
        interrupted=interrupted,
        warnings=(*warnings, *_limit_warnings(task, front), *([INTERRUPTED] if interrupted else [])),
    )


def _chosen(candidates: Candidates, designs: int) -> list[Candidate]:
    """Return the best feasible candidate for each of the weights, without duplicates, sorted by the first goal."""
    ideal, size = ideal_and_scale(candidates)
    best = [best_candidate(candidates.feasible, weights, ideal, size) for weights in weights_of(designs)]
    distinct = {candidate.point.tobytes(): candidate for candidate in best}
    return sorted(distinct.values(), key=lambda candidate: float(candidate.goals[0]))


def _nondominated(goals: FloatArray) -> list[bool]:
    """Return a mask of the designs, with goals (P, 2), that no other design beats in both goals."""
    return [not (goals < row).all(axis=1).any() for row in goals]


def _warnings(candidates: Candidates, candidate: Candidate, retraced: Retraced) -> Iterator[str]:
    yield from retraced.warnings()
    evaluator = candidates.evaluator
    sampled = Sampled.of(evaluator.variant(evaluator.task.design_at(candidate.point)).sensor())
    yield from () if sampled is None else sampled.warnings()


def _limit_warnings(task: Task, designs: Sequence[FrontDesign]) -> Iterator[str]:
    """Yield warnings about free parameters that reach their limits, each with the numbers of the designs."""
    by_text: dict[str, list[int]] = {}
    for design in designs:
        for text in limit_warnings(task, design.design):
            by_text.setdefault(text, []).append(design.number)
    for text, numbers in by_text.items():
        yield f"design{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}: {text}"


def _design(candidates: Candidates, number: int, candidate: Candidate | None, retraced: Retraced) -> FrontDesign:
    task, results = candidates.evaluator.task, retraced.evaluation.by_goal
    design = task.design if candidate is None else task.design_at(candidate.point)
    return FrontDesign(
        number=number,
        goals=tuple(result.goal for result in results),
        u_goals=tuple(result.u_goal for result in results),
        claimed=tuple(result.goal for result in retraced.claimed.by_goal),
        free=task.free_values(Sensor.of(design)),
        meets=retraced.evaluation.meets,
        merits=results[0].merits,
        design=design,
    )

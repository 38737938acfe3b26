"""The Pareto front of two goals: designs of which none is better in both.

Each design of the front is optimal for some weights of the two goals. Each goal is first optimised alone, which gives
the ends of the front and the units for weighting the goals. Then the larger of the two weighted goals is minimised, in
steps from one end to the other. All candidates count for every weight.

`search_front` searches for it; `front_of` converts candidates to a `Front`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.explore.optimise.candidates import Candidate, Candidates, least
from solen.explore.optimise.optimum import INTERRUPTED, at_ends, outside
from solen.explore.optimise.retraced import Retraced, Sampled
from solen.explore.optimise.search import Tried, search
from solen.explore.optimise.task import Task
from solen.results import HIDDEN, Result
from solen.sensor import Sensor
from solen.spec import Design

ENDS = (np.array([1.0, 0.0]), np.array([0.0, 1.0]))


class FrontDesign(Result):
    """One design of a front, traced with a small tolerance.

    Attributes
    ----------
    number
        Its number on the front, from the best of the first goal on; 0 for the initial design of the search.
    goals, u_goals
        Worst value of each goal over the design and its deviations, and its uncertainty.
    claimed
        Worst value of each goal during the search.
    free
        The free numbers by key.
    meets
        Whether all conditions hold, by condition.
    merits
        Merits of the design without deviations, with their uncertainties, by name.
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
    """Designs of which none is better in both of two goals.

    Attributes
    ----------
    name
        Name of the design.
    goals
        The two goals.
    printed_by
        Process whose printed lens was traced in place of the designed one, or None for the designed one.
    before
        The initial design of the search.
    designs
        The front, sorted by the first goal from the best on.
    robust
        Whether deviations were stated, in which case each goal is its worst value over them.
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
        """Return goals, free numbers and merits by ``design``, which is 0 for the initial design."""
        every = (self.before, *self.designs)
        coordinates = {"design": [one.number for one in every], "goal": list(self.goals)}
        variables: dict[str, Any] = {
            name: (("design", "goal"), [getattr(one, name) for one in every]) for name in ("goals", "u_goals")
        }
        numbers = {
            key: ("design", [values[key] for values in rows])
            for rows in ([one.free for one in every], [one.merits for one in every])
            for key in rows[0]
        }
        return variables | numbers, coordinates, {"title": f"Front of {self.name}", "simulated": 1}


def weights_of(designs: int) -> list[FloatArray]:
    """Return weights of both goals: the two ends first, then steps from one end to the other."""
    between = np.linspace(0.0, 1.0, designs)[1:-1]
    return [*ENDS, *(np.array([1.0 - share, share]) for share in between.tolist())]


def search_front(candidates: Candidates, designs: int, seed: int) -> None:
    """Search for a front with a number of designs; the first goal, which samples the box, has twice the share."""
    each = candidates.most // (designs + 1)
    for number, weights in enumerate(weights_of(designs)):
        ideal, size = (0.0, 1.0) if number < len(ENDS) else units(candidates)
        total = _total(candidates, weights, ideal, size)
        most = each if number < designs - 1 else candidates.most - len(candidates.tried)
        first = least(candidates.tried, weights, ideal, size).point if number else candidates.evaluator.task.begin
        search(Tried(total, most if number else 2 * each), first, (seed, number), sampled=not number)


def _total(
    candidates: Candidates, weights: FloatArray, ideal: FloatArray | float, size: FloatArray | float
) -> Callable[[FloatArray], float]:
    return lambda point: candidates(point).total(weights, ideal, size)


def units(candidates: Candidates) -> tuple[FloatArray, FloatArray]:
    """Return the best value of each goal so far, and its increase at the best value of the other goal."""
    known = candidates.feasible or candidates.tried
    goals = np.array([least(known, weights).goals for weights in ENDS])
    ideal = goals.min(axis=0)
    size = goals.max(axis=0) - ideal
    return ideal, np.where(size > 0.0, size, 1.0)


def front_of(candidates: Candidates, designs: int, known: int, *, interrupted: bool) -> Front:
    """Return the front of candidates with each design traced again; ``known`` counts responses stored before."""
    evaluator, task = candidates.evaluator, candidates.evaluator.task
    traced = len(evaluator.store.points) - known
    chosen = _chosen(candidates, designs)
    again = [Retraced.of(evaluator, task.at(one.point)) for one in chosen]
    kept = _not_worse(np.array([one.evaluation.goals for one in again]) / candidates.scale)
    warnings = [*task.warnings, *outside(task)]
    found: list[FrontDesign] = []
    for one, retraced, is_kept in zip(chosen, again, kept, strict=True):
        if is_kept:
            found.append(_design(candidates, len(found) + 1, one, retraced))
            warnings += [f"design {len(found)}: {text}" for text in _warnings(candidates, one, retraced)]
    if not all(kept):
        few = len(kept) - sum(kept)
        warnings.append(
            f"traced with a smaller tolerance, {few} of {len(kept)} designs are worse than another design in both goals"
        )
    return Front(
        name=task.design.name,
        goals=task.names,
        printed_by=task.printed_by,
        before=_design(candidates, 0, None, Retraced.of(evaluator, task.design)),
        designs=tuple(found),
        robust=len(task.cases) > 1,
        evaluations=len(candidates.tried),
        max_evaluations=candidates.most,
        traced=traced,
        interrupted=interrupted,
        warnings=(*warnings, *_at_ends(task, found), *([INTERRUPTED] if interrupted else [])),
    )


def _chosen(candidates: Candidates, designs: int) -> list[Candidate]:
    """Return the best feasible candidate for each of the weights, without duplicates, sorted by the first goal."""
    ideal, size = units(candidates)
    found = [least(candidates.feasible, weights, ideal, size) for weights in weights_of(designs)]
    best = {one.point.tobytes(): one for one in found}
    return sorted(best.values(), key=lambda one: float(one.goals[0]))


def _not_worse(goals: FloatArray) -> list[bool]:
    """Return a mask of designs (P, 2) that no other design beats in both goals."""
    return [not (goals < own).all(axis=1).any() for own in goals]


def _warnings(candidates: Candidates, candidate: Candidate, retraced: Retraced) -> Iterator[str]:
    yield from retraced.warnings()
    evaluator = candidates.evaluator
    sampled = Sampled.of(evaluator.variant(evaluator.task.at(candidate.point)).sensor())
    yield from () if sampled is None else sampled.warnings()


def _at_ends(task: Task, designs: Sequence[FrontDesign]) -> Iterator[str]:
    """Return warnings about free numbers that reached their limits, each with the designs concerned."""
    by_text: dict[str, list[int]] = {}
    for design in designs:
        for text in at_ends(task, design.design):
            by_text.setdefault(text, []).append(design.number)
    for text, numbers in by_text.items():
        yield f"design{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}: {text}"


def _design(candidates: Candidates, number: int, candidate: Candidate | None, retraced: Retraced) -> FrontDesign:
    task, results = candidates.evaluator.task, retraced.evaluation.by_goal
    design = task.design if candidate is None else task.at(candidate.point)
    return FrontDesign(
        number=number,
        goals=tuple(result.goal for result in results),
        u_goals=tuple(result.u_goal for result in results),
        claimed=tuple(one.goal for one in retraced.claimed.by_goal),
        free=task.stated(Sensor.of(design)),
        meets=retraced.evaluation.meets,
        merits=results[0].merits,
        design=design,
    )

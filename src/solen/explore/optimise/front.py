"""The front of two goals: designs of which none is better in both.

The idea: a design is best for some weights of the two goals. Each goal is first optimised alone, which gives the ends
of the front and the units in which the goals are weighted. Then the larger of the two weighted goals is minimised, in
steps from one end to the other. All candidates count for every weight.

The interface: `sought` searches; `front_of` a course returns a `Front`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.explore.optimise.course import Candidate, Course, least
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
    evaluations, most_evaluations, traced
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
    most_evaluations: int
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


def sought(course: Course, designs: int, seed: int) -> None:
    """Search for a front with a number of designs; the first goal, which samples the box, has twice the share."""
    each = course.most // (designs + 1)
    for number, weights in enumerate(weights_of(designs)):
        ideal, size = (0.0, 1.0) if number < len(ENDS) else units(course)
        total = _total(course, weights, ideal, size)
        most = each if number < designs - 1 else course.most - len(course.tried)
        first = least(course.tried, weights, ideal, size).point if number else course.judge.task.begin
        search(Tried(total, most if number else 2 * each), first, (seed, number), sampled=not number)


def _total(
    course: Course, weights: FloatArray, ideal: FloatArray | float, size: FloatArray | float
) -> Callable[[FloatArray], float]:
    return lambda point: course(point).total(weights, ideal, size)


def units(course: Course) -> tuple[FloatArray, FloatArray]:
    """Return the best value of each goal so far, and its increase at the best value of the other goal."""
    known = course.feasible or course.tried
    goals = np.array([least(known, weights).goals for weights in ENDS])
    ideal = goals.min(axis=0)
    size = goals.max(axis=0) - ideal
    return ideal, np.where(size > 0.0, size, 1.0)


def front_of(course: Course, designs: int, known: int, *, interrupted: bool) -> Front:
    """Return the front of a course with each design traced again; ``known`` counts responses stored before."""
    judge, task = course.judge, course.judge.task
    traced = len(judge.store.points) - known
    chosen = _chosen(course, designs)
    again = [Retraced.of(judge, task.at(one.point)) for one in chosen]
    kept = _not_worse(np.array([one.verdict.goals for one in again]) / course.scale)
    warnings = [*task.warnings, *outside(task)]
    found: list[FrontDesign] = []
    for one, retraced, is_kept in zip(chosen, again, kept, strict=True):
        if is_kept:
            found.append(_design(course, len(found) + 1, one, retraced))
            warnings += [f"design {len(found)}: {text}" for text in _doubts(course, one, retraced)]
    if not all(kept):
        few = len(kept) - sum(kept)
        warnings.append(
            f"traced with a smaller tolerance, {few} of {len(kept)} designs are worse than another in both goals"
        )
    return Front(
        name=task.design.name,
        goals=task.names,
        printed_by=task.printed_by,
        before=_design(course, 0, None, Retraced.of(judge, task.design)),
        designs=tuple(found),
        robust=len(task.cases) > 1,
        evaluations=len(course.tried),
        most_evaluations=course.most,
        traced=traced,
        interrupted=interrupted,
        warnings=(*warnings, *_at_ends(task, found), *([INTERRUPTED] if interrupted else [])),
    )


def _chosen(course: Course, designs: int) -> list[Candidate]:
    """Return the best feasible candidate for each of the weights, without duplicates, sorted by the first goal."""
    ideal, size = units(course)
    found = [least(course.feasible, weights, ideal, size) for weights in weights_of(designs)]
    best = {one.point.tobytes(): one for one in found}
    return sorted(best.values(), key=lambda one: float(one.goals[0]))


def _not_worse(goals: FloatArray) -> list[bool]:
    """Return a mask of designs (P, 2) that no other design beats in both goals."""
    return [not (goals < own).all(axis=1).any() for own in goals]


def _doubts(course: Course, candidate: Candidate, retraced: Retraced) -> Iterator[str]:
    yield from retraced.doubts()
    judge = course.judge
    sampled = Sampled.of(judge.variant(judge.task.at(candidate.point)).sensor())
    yield from () if sampled is None else sampled.doubts()


def _at_ends(task: Task, designs: Sequence[FrontDesign]) -> Iterator[str]:
    """Return warnings about free numbers that are at their limits, each with the designs concerned."""
    by_text: dict[str, list[int]] = {}
    for one in designs:
        for text in at_ends(task, one.design):
            by_text.setdefault(text, []).append(one.number)
    for text, numbers in by_text.items():
        yield f"design{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}: {text}"


def _design(course: Course, number: int, candidate: Candidate | None, retraced: Retraced) -> FrontDesign:
    task, judged = course.judge.task, retraced.verdict.by_goal
    design = task.design if candidate is None else task.at(candidate.point)
    return FrontDesign(
        number=number,
        goals=tuple(one.goal for one in judged),
        u_goals=tuple(one.u_goal for one in judged),
        claimed=tuple(one.goal for one in retraced.claimed.by_goal),
        free=task.stated(Sensor.of(design)),
        meets=retraced.verdict.meets,
        merits=judged[0].merits,
        design=design,
    )

"""Candidates of a search, each with its goals and its violation of the limits.

Goals are divided by their values for the initial design and minimised.

`Candidates` is called with points; `Candidates.feasible` contains the candidates that meet every limit,
`Candidates.nondominated` the best of them; `least` selects the best for given weights.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.explore.optimise.evaluation import Evaluator, GoalResult
from solen.progress import Progress
from solen.spec import Design

UNMET = 1e3
"""Objective of a candidate without a response."""
PENALTY = 30.0
"""Penalty weight: the penalty for missing a limit by 100 %."""
SECOND = 0.01
"""Weight of the goals that are not the maximum; it decides between candidates with the same maximum."""


class Candidate(NamedTuple):
    """A point (N,), its goals (G,), NaN if one does not exist, and its violation, infinite without a response."""

    point: FloatArray
    goals: FloatArray
    violation: float

    def total(self, weights: FloatArray, ideal: FloatArray | float = 0.0, size: FloatArray | float = 1.0) -> float:
        """Return one objective for several goals: the largest weighted goal (Chebyshev), reaching concave fronts."""
        goals = (self.goals - ideal) / size
        if np.isnan(goals).any() or not np.isfinite(self.violation):
            return UNMET
        if goals.size == 1:
            return float(goals[0]) + PENALTY * self.violation
        weighted = goals[weights > 0.0] * weights[weights > 0.0]
        return float(weighted.max()) + SECOND * float(goals.sum()) + PENALTY * self.violation


class NondominatedDesign(NamedTuple):
    """A design that meets every limit and is not dominated by any design tried so far.

    Parameters
    ----------
    number
        Its number among all designs tried, from 1.
    design
        The design.
    by_goal
        Its results during the search, by goal.
    """

    number: int
    design: Design
    by_goal: tuple[GoalResult, ...]


Keep = Callable[[Sequence[NondominatedDesign]], object]
"""Called with the best designs so far, sorted by the first goal, whenever a further one is added."""


class Candidates:
    """Candidates in the order in which they were tried.

    Parameters
    ----------
    evaluator
        Evaluator of the candidates.
    begun
        Goals of the initial design.
    most, progress
        Number of candidates, and a function called with the completed fraction, up to 1.
    keep
        Function called with the best designs so far.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        begun: FloatArray,
        most: int,
        progress: Progress | None = None,
        keep: Keep | None = None,
    ) -> None:
        self.evaluator, self.most, self.progress, self.keep = evaluator, most, progress, keep
        self.nondominated: list[tuple[Candidate, NondominatedDesign]] = []
        self.tried: list[Candidate] = []
        self.scale = np.array(evaluator.task.signs) * np.where(begun == 0.0, 1.0, np.abs(begun))

    def __call__(self, point: FloatArray) -> Candidate:
        """Evaluate the candidate at a point and store it."""
        nothing = np.full(self.scale.size, np.nan)
        try:
            design = self.evaluator.task.at(point)
            evaluation = self.evaluator.of(design)
        except SolenError:
            evaluation = None
        candidate = (
            Candidate(point, nothing, np.inf)
            if evaluation is None
            else Candidate(point, evaluation.goals / self.scale, evaluation.violation)
        )
        self.tried.append(candidate)
        if evaluation is not None and candidate.violation == 0.0:
            self._insert(candidate, NondominatedDesign(len(self.tried), design, evaluation.by_goal))
        if self.progress is not None:
            self.progress(len(self.tried) / self.most)
        return candidate

    def _insert(self, candidate: Candidate, new: NondominatedDesign) -> None:
        """Add a candidate unless another is as good in every goal, and remove the candidates that it dominates."""
        if any((one.goals <= candidate.goals).all() for one, _ in self.nondominated):
            return
        left = [one for one in self.nondominated if not (candidate.goals <= one[0].goals).all()]
        self.nondominated = sorted([*left, (candidate, new)], key=lambda one: float(one[0].goals[0]))
        if self.keep is not None:
            self.keep([one for _, one in self.nondominated])

    @property
    def feasible(self) -> list[Candidate]:
        """Candidates that meet every limit."""
        return [one for one in self.tried if one.violation == 0.0]

    def check_feasible(self) -> None:
        """Raise `SpecError` if no candidate meets every limit; it names those that the nearest one misses."""
        if self.feasible:
            return
        nearest = self.tried[int(np.argmin([one.violation for one in self.tried]))]
        design = self.evaluator.task.at(nearest.point)
        evaluation = self.evaluator.of(design)
        missed = [] if evaluation is None else [text for text, met in evaluation.meets.items() if not met]
        limit = (
            "none of the designs tried meets every condition; the closest design does not "
            f"meet {', '.join(missed) or 'a response'}"
        )
        raise SpecError("--subject-to", limit=limit, remedy="relax the condition, or free more parameters")


def least(
    candidates: Sequence[Candidate],
    weights: FloatArray,
    ideal: FloatArray | float = 0.0,
    size: FloatArray | float = 1.0,
) -> Candidate:
    """Return the best candidate for weights of the goals; of several equal ones, the first."""
    totals = [candidate.total(weights, ideal, size) for candidate in candidates]
    return candidates[int(np.argmin(totals))]

"""Candidates of a search, each with its goals and its violation of the conditions.

Goals are divided by their values for the initial design and minimised.

`Candidates` is called with points. `Candidates.feasible` contains the candidates that meet every condition, and
`Candidates.nondominated` those that no other one dominates; `best_candidate` selects the best for given weights.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.explore.optimise.evaluation import Evaluator, GoalResult
from solen.progress import Progress
from solen.spec import Design

NO_RESPONSE = 1e3
"""Objective of a candidate without a response."""
PENALTY = 30.0
"""Weight of the violation: the penalty if a limit is missed by 100 %."""
SUM_WEIGHT = 0.01
"""Weight of the sum of the goals; it decides between candidates with the same largest weighted goal."""


class Candidate(NamedTuple):
    """A point (N,), its goals (G,), NaN if undefined, and its violation, infinite without a response."""

    point: FloatArray
    goals: FloatArray
    violation: float

    def objective(self, weights: FloatArray, ideal: FloatArray | float = 0.0, size: FloatArray | float = 1.0) -> float:
        """Return a single objective: the largest weighted goal (Chebyshev), which also reaches concave fronts."""
        goals = (self.goals - ideal) / size
        if np.isnan(goals).any() or not np.isfinite(self.violation):
            return NO_RESPONSE
        if goals.size == 1:
            return float(goals[0]) + PENALTY * self.violation
        weighted = goals[weights > 0.0] * weights[weights > 0.0]
        return float(weighted.max()) + SUM_WEIGHT * float(goals.sum()) + PENALTY * self.violation


class NondominatedDesign(NamedTuple):
    """A design that meets every condition and is not dominated by any design tried so far.

    Parameters
    ----------
    number
        Number of the design in the order of evaluation, from 1.
    design
        The design.
    by_goal
        Result of the search for each goal.
    """

    number: int
    design: Design
    by_goal: tuple[GoalResult, ...]


Keep = Callable[[Sequence[NondominatedDesign]], object]
"""Function that is called with the nondominated designs so far, sorted by the first goal, when one is added."""


class Candidates:
    """Candidates in the order of evaluation.

    Parameters
    ----------
    evaluator
        Evaluator of the candidates.
    initial
        Goals of the initial design.
    max_count, progress
        Number of candidates, and a function called with the completed fraction, up to 1.
    keep
        Function called with the nondominated designs so far.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        initial: FloatArray,
        max_count: int,
        progress: Progress | None = None,
        keep: Keep | None = None,
    ) -> None:
        self.evaluator, self.max_count, self.progress, self.keep = evaluator, max_count, progress, keep
        self.nondominated: list[tuple[Candidate, NondominatedDesign]] = []
        self.tried: list[Candidate] = []
        self.scale = np.array(evaluator.task.signs) * np.where(initial == 0.0, 1.0, np.abs(initial))

    def __call__(self, point: FloatArray) -> Candidate:
        """Evaluate the candidate at a point and store it."""
        try:
            design = self.evaluator.task.design_at(point)
            evaluation = self.evaluator.of(design)
        except SolenError:
            evaluation = None
        candidate = (
            Candidate(point, np.full(self.scale.size, np.nan), np.inf)
            if evaluation is None
            else Candidate(point, evaluation.goals / self.scale, evaluation.violation)
        )
        self.tried.append(candidate)
        if evaluation is not None and candidate.violation == 0.0:
            self._insert(candidate, NondominatedDesign(len(self.tried), design, evaluation.by_goal))
        if self.progress is not None:
            self.progress(len(self.tried) / self.max_count)
        return candidate

    def _insert(self, candidate: Candidate, new: NondominatedDesign) -> None:
        """Add a candidate unless another is as good in every goal, and remove the candidates that it dominates."""
        if any((other.goals <= candidate.goals).all() for other, _ in self.nondominated):
            return
        others = [pair for pair in self.nondominated if not (candidate.goals <= pair[0].goals).all()]
        self.nondominated = sorted([*others, (candidate, new)], key=lambda pair: float(pair[0].goals[0]))
        if self.keep is not None:
            self.keep([design for _, design in self.nondominated])

    @property
    def feasible(self) -> list[Candidate]:
        """Candidates that meet every condition."""
        return [candidate for candidate in self.tried if candidate.violation == 0.0]

    def check_feasible(self) -> None:
        """Raise `SpecError` if no candidate meets every condition; its message lists those that the best one misses."""
        if self.feasible:
            return
        nearest = self.tried[int(np.argmin([candidate.violation for candidate in self.tried]))]
        design = self.evaluator.task.design_at(nearest.point)
        evaluation = self.evaluator.of(design)
        missed = [] if evaluation is None else [text for text, met in evaluation.meets.items() if not met]
        closest = f"does not meet {', '.join(missed)}" if missed else "has no response"
        limit = f"none of the designs tried meets every condition; the closest design {closest}"
        remedy = "relax the condition, or free more parameters with --free"
        raise SpecError("--subject-to", limit=limit, remedy=remedy)


def best_candidate(
    candidates: Sequence[Candidate],
    weights: FloatArray,
    ideal: FloatArray | float = 0.0,
    size: FloatArray | float = 1.0,
) -> Candidate:
    """Return the best candidate for weights of the goals; the first if several are equal."""
    objectives = [candidate.objective(weights, ideal, size) for candidate in candidates]
    return candidates[int(np.argmin(objectives))]

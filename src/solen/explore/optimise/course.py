"""Course of a search: every candidate with its goals and by how much it misses its limits.

Values of goals are to be small, and in units of that of the design which the search begins with.

The interface: `Course` takes points; `Course.feasible` are those that meet everything, `Course.grown` the best of
them; `least` of some.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError, SpecError
from solen.explore.optimise.judge import Judge, Judged
from solen.progress import Progress
from solen.spec import Design

UNMET = 1e3
"""Value of a candidate without a response."""
PENALTY = 30.0
"""Weight of a limit missed by all of its size."""
SECOND = 0.01
"""Weight of all goals beside the one that counts, so that of equals the better in the other is taken."""


class Candidate(NamedTuple):
    """A point (N,), its goals (G,), NaN where one does not exist, and its violation, infinite without a response."""

    point: FloatArray
    goals: FloatArray
    violation: float

    def total(self, weights: FloatArray, ideal: FloatArray | float = 0.0, size: FloatArray | float = 1.0) -> float:
        """One value of several goals: the largest by weights, Chebyshev's norm, which also reaches a hollow front."""
        goals = (self.goals - ideal) / size
        if np.isnan(goals).any() or not np.isfinite(self.violation):
            return UNMET
        if goals.size == 1:
            return float(goals[0]) + PENALTY * self.violation
        weighted = goals[weights > 0.0] * weights[weights > 0.0]
        return float(weighted.max()) + SECOND * float(goals.sum()) + PENALTY * self.violation


class Grown(NamedTuple):
    """A design that meets every limit, and to which none tried so far is equal or better in every goal.

    Parameters
    ----------
    number
        Which one it was of all that were tried, from 1.
    design
        The design.
    by_goal
        What the search saw of it, by goal.
    """

    number: int
    design: Design
    by_goal: tuple[Judged, ...]


Keep = Callable[[Sequence[Grown]], object]
"""Called with the best designs so far, those of the best first goal first, whenever there is a further one."""


class Course:
    """Candidates in the order in which they were tried.

    Parameters
    ----------
    judge
        Judges them.
    begun
        Goals of the design that the search begins with.
    most, progress
        Number of candidates, and what is called with the share done, up to 1.
    keep
        What is called with the best designs so far.
    """

    def __init__(
        self, judge: Judge, begun: FloatArray, most: int, progress: Progress | None = None, keep: Keep | None = None
    ) -> None:
        self.judge, self.most, self.progress, self.keep = judge, most, progress, keep
        self.grown: list[tuple[Candidate, Grown]] = []
        self.tried: list[Candidate] = []
        self.scale = np.array(judge.task.signs) * np.where(begun == 0.0, 1.0, np.abs(begun))

    def __call__(self, point: FloatArray) -> Candidate:
        """Candidate at a point, judged and kept."""
        nothing = np.full(self.scale.size, np.nan)
        try:
            design = self.judge.task.at(point)
            verdict = self.judge.of(design)
        except SolenError:
            verdict = None
        candidate = (
            Candidate(point, nothing, np.inf)
            if verdict is None
            else Candidate(point, verdict.goals / self.scale, verdict.violation)
        )
        self.tried.append(candidate)
        if verdict is not None and candidate.violation == 0.0:
            self._grow(candidate, Grown(len(self.tried), design, verdict.by_goal))
        if self.progress is not None:
            self.progress(len(self.tried) / self.most)
        return candidate

    def _grow(self, candidate: Candidate, new: Grown) -> None:
        """Keep a candidate unless another is as good in every goal, and those that it does not surpass."""
        if any((one.goals <= candidate.goals).all() for one, _ in self.grown):
            return
        left = [one for one in self.grown if not (candidate.goals <= one[0].goals).all()]
        self.grown = sorted([*left, (candidate, new)], key=lambda one: float(one[0].goals[0]))
        if self.keep is not None:
            self.keep([one for _, one in self.grown])

    @property
    def feasible(self) -> list[Candidate]:
        """Candidates that meet every limit."""
        return [one for one in self.tried if one.violation == 0.0]

    def check_feasible(self) -> None:
        """`SpecError` with what the nearest candidate misses where none meets every limit."""
        if self.feasible:
            return
        nearest = self.tried[int(np.argmin([one.violation for one in self.tried]))]
        design = self.judge.task.at(nearest.point)
        verdict = self.judge.of(design)
        missed = [] if verdict is None else [text for text, met in verdict.meets.items() if not met]
        limit = f"no design tried meets every condition; the nearest misses {', '.join(missed) or 'a response'}"
        raise SpecError("--subject-to", limit=limit, remedy="loosen it, or free more")


def least(
    candidates: Sequence[Candidate],
    weights: FloatArray,
    ideal: FloatArray | float = 0.0,
    size: FloatArray | float = 1.0,
) -> Candidate:
    """Best candidate by weights of the goals; the first of equals."""
    totals = [one.total(weights, ideal, size) for one in candidates]
    return candidates[int(np.argmin(totals))]

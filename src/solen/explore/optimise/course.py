"""Course of a search: every candidate with its goals and by how much it misses its limits.

Values of goals are to be small, and in units of that of the design which the search begins with.

The interface: `Course` takes points; `Course.feasible` are those that meet everything; `least` of some.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray, Progress
from solen.errors import SolenError, SpecError
from solen.explore.optimise.judge import Judge

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
    """

    def __init__(self, judge: Judge, begun: FloatArray, most: int, progress: Progress | None = None) -> None:
        self.judge, self.most, self.progress = judge, most, progress
        self.tried: list[Candidate] = []
        self.scale = np.array(judge.task.signs) * np.where(begun == 0.0, 1.0, np.abs(begun))

    def __call__(self, point: FloatArray) -> Candidate:
        """Candidate at a point, judged and kept."""
        nothing = np.full(self.scale.size, np.nan)
        try:
            verdict = self.judge.of(self.judge.task.at(point))
        except SolenError:
            verdict = None
        candidate = (
            Candidate(point, nothing, np.inf)
            if verdict is None
            else Candidate(point, verdict.goals / self.scale, verdict.violation)
        )
        self.tried.append(candidate)
        if self.progress is not None:
            self.progress(len(self.tried) / self.most)
        return candidate

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
    """Best of some candidates by weights of the goals; of equals the first."""
    totals = [one.total(weights, ideal, size) for one in candidates]
    return candidates[int(np.argmin(totals))]

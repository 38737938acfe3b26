"""Search in a box of N parameters scaled to 0 to 1: samples first, then CMA-ES with restarts from the best point.

CMA-ES: N. Hansen & A. Ostermeier, Evolutionary Computation 9, 159 (2001), from the package ``cma``. Unlike gradient
methods, it tolerates noise and minimax objectives. All random numbers depend on a seed, which makes a search
repeatable.

Public name: `search`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray
from solen.explore.sobol import sobol
from solen.extras import need

SAMPLES_PER_PARAMETER, SAMPLE_FRACTION = 4, 0.25
"""Number of samples per free parameter, and their largest fraction of all evaluations."""
FIRST_STEP = 0.2
"""Standard deviation of the first generation, as a fraction of the box."""


@dataclass
class Trials:
    """Points tried so far with their values.

    Attributes
    ----------
    value
        Function of a point (N,) to be minimised.
    max_count
        Largest number of evaluations.
    points, values
        Points and their values, in the order of evaluation.
    """

    value: Callable[[FloatArray], float]
    max_count: int
    points: list[FloatArray] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    @property
    def left(self) -> int:
        """Number of evaluations that are left."""
        return self.max_count - len(self.values)

    @property
    def best(self) -> FloatArray:
        """Best point so far."""
        return self.points[int(np.argmin(self.values))]

    def __call__(self, point: Sequence[float]) -> float:
        """Evaluate a point and store it."""
        self.points.append(np.clip(np.asarray(point, dtype=float), 0.0, 1.0))
        self.values.append(self.value(self.points[-1]))
        return self.values[-1]


def search(trials: Trials, first: FloatArray, seed: int | Sequence[int], *, sampled: bool = True) -> None:
    """Search from a first point and, if requested, from samples of the box, until no evaluation is left.

    Raises
    ------
    OutputError
        If the package ``cma`` is not installed.
    """
    need("cma", what="solen explore optimise", doing="the search")
    import cma

    rng = np.random.default_rng(seed)
    trials(first.tolist())
    samples = min(SAMPLES_PER_PARAMETER * first.size, int(SAMPLE_FRACTION * trials.max_count)) if sampled else 0
    if samples > 0:
        for point in sobol(first.size, samples, rng).tolist():
            trials(point)
    population = 4 + int(3 * np.log(first.size))
    while trials.left >= population:
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population,
            "seed": int(rng.integers(1, 2**31)),
            "verbose": -9,
            "maxfevals": trials.left,
            "tolfun": 1e-9,
        }
        unused = [0.5] * (first.size == 1)  # CMA-ES requires two parameters: add one without effect
        strategy = cma.CMAEvolutionStrategy([*trials.best.tolist(), *unused], FIRST_STEP, options)
        while not strategy.stop() and trials.left >= population:
            points = strategy.ask()
            strategy.tell(points, [trials(point[: first.size]) for point in points])
        population *= 2

"""Search in a box of N numbers scaled to 0 to 1: samples first, then CMA-ES with restarts from the best.

CMA-ES: N. Hansen & A. Ostermeier, Evolutionary Computation 9, 159 (2001), from the package ``cma``. Unlike gradients,
it tolerates a minimax and noise. All random numbers are drawn with a seed, which makes a search repeatable.

Public name: `search`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from solen.arrays import FloatArray
from solen.explore.sobol import sobol
from solen.extras import need

STARTS_A_NUMBER, STARTS_SHARE = 4, 0.25
"""Number of samples per free number, and their largest fraction of all evaluations."""
FIRST_STEP = 0.2
"""Standard deviation of the first generation, as a fraction of the box."""


@dataclass
class Tried:
    """Points tried so far with their values, which are to be minimised.

    Attributes
    ----------
    value
        Function of a point (N,).
    most
        Largest number of evaluations.
    points, values
        Points and their values, in the order of evaluation.
    """

    value: Callable[[FloatArray], float]
    most: int
    points: list[FloatArray] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    @property
    def left(self) -> int:
        """Number of evaluations left."""
        return self.most - len(self.values)

    @property
    def best(self) -> FloatArray:
        """Best point so far."""
        return self.points[int(np.argmin(self.values))]

    def __call__(self, point: Sequence[float]) -> float:
        """Evaluate a point and store it."""
        self.points.append(np.clip(np.asarray(point, dtype=float), 0.0, 1.0))
        self.values.append(self.value(self.points[-1]))
        return self.values[-1]


def search(tried: Tried, first: FloatArray, seed: int | Sequence[int], *, sampled: bool = True) -> None:
    """Search from a first point and, if requested, from samples of the box, until no evaluation is left.

    Raises
    ------
    OutputError
        If the package ``cma`` is not installed.
    """
    need("cma", what="solen explore optimise", doing="the search")
    import cma

    rng = np.random.default_rng(seed)
    tried(first.tolist())
    starts = min(STARTS_A_NUMBER * first.size, int(STARTS_SHARE * tried.most)) if sampled else 0
    if starts > 0:
        for point in sobol(first.size, starts, rng).tolist():
            tried(point)
    size = 4 + int(3 * np.log(first.size))
    while tried.left >= size:
        options = {
            "bounds": [0.0, 1.0],
            "popsize": size,
            "seed": int(rng.integers(1, 2**31)),
            "verbose": -9,
            "maxfevals": tried.left,
            "tolfun": 1e-9,
        }
        idle = [0.5] * (first.size == 1)  # the package needs two numbers: add one without effect
        strategy = cma.CMAEvolutionStrategy([*tried.best.tolist(), *idle], FIRST_STEP, options)
        while not strategy.stop() and tried.left >= size:
            asked = strategy.ask()
            strategy.tell(asked, [tried(point[: first.size]) for point in asked])
        size *= 2

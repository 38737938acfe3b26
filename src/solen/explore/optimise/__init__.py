"""Inverse design: design parameters that optimise a figure of merit within limits and under deviations.

Every candidate is traced as designed and with its deviations: its goal is the worst value over these cases, and all of
them must meet the conditions. Two goals give a Pareto front: designs of which none is better than another in both.
Since a search exploits tracing errors, its results are traced again, with a smaller tolerance and by sampling.

`solen.explore.optimise.options` contains the options of a search, and `solen.explore.optimise.task` checks them.
`solen.explore.optimise.evaluation` evaluates a design, `solen.explore.optimise.candidates` stores the candidates, and
`solen.explore.optimise.search` is the algorithm. `solen.explore.optimise.optimum` and `solen.explore.optimise.front`
are the results, checked by retracing; `solen.explore.optimise.prints` adds prints of the result and of the initial
design. `solen.explore.optimise.straightness` gives the options of a search for a straighter response.
"""

from solen.explore.optimise.candidates import NondominatedDesign
from solen.explore.optimise.evaluation import GoalResult
from solen.explore.optimise.front import Front, FrontDesign
from solen.explore.optimise.optimum import FreeParameter, Optimum
from solen.explore.optimise.options import OptimiseOptions
from solen.explore.optimise.prints import check_prints, with_prints
from solen.explore.optimise.run import optimise
from solen.explore.optimise.straightness import straightness_options

__all__ = [
    "FreeParameter",
    "Front",
    "FrontDesign",
    "GoalResult",
    "NondominatedDesign",
    "OptimiseOptions",
    "Optimum",
    "check_prints",
    "optimise",
    "straightness_options",
    "with_prints",
]

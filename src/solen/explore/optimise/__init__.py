"""Inverse design: design parameters that optimise a merit within limits and under deviations.

Every candidate is traced as designed and with its deviations: its objective is the worst value among these, and the
conditions must hold for all of them. Two objectives give a front of designs of which none is better in both. Since a
search exploits errors of its tracing, its results are traced again, with a smaller tolerance and by sampling.

`solen.explore.optimise.options` contains the options of a search, and `solen.explore.optimise.task` checks them.
`solen.explore.optimise.evaluation` evaluates a design, `solen.explore.optimise.candidates` stores the candidates, and
`solen.explore.optimise.search` is the algorithm. `solen.explore.optimise.optimum` and `solen.explore.optimise.front`
are the results, checked by retracing; `solen.explore.optimise.prints` adds prints of the result and of the initial
design. `solen.explore.optimise.straightness` sets up the search for a user who only wants a straighter response.
"""

from solen.explore.optimise.candidates import NondominatedDesign
from solen.explore.optimise.evaluation import GoalResult
from solen.explore.optimise.front import Front, FrontDesign
from solen.explore.optimise.optimum import FreeNumber, Optimum
from solen.explore.optimise.options import OptimiseOptions
from solen.explore.optimise.prints import check_prints, with_prints
from solen.explore.optimise.run import optimise
from solen.explore.optimise.straightness import straightness_options

__all__ = [
    "FreeNumber",
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

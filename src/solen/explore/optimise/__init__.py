"""Inverse design: numbers of a design that make a merit as good as it can be, within limits and under deviations.

Every candidate is traced as designed and with its deviations: the goal is its worst value among these, and conditions
hold for all of them. Two goals have a front of designs, of which none is better in both. A search exploits whatever its
tracing leaves open, so its results are traced again, more finely and by samples.

`solen.explore.optimise.options` is what may be asked, `solen.explore.optimise.task` checks it;
`solen.explore.optimise.judge` judges a design, `solen.explore.optimise.course` keeps what a search has tried,
`solen.explore.optimise.search` is the algorithm; `solen.explore.optimise.optimum` and `solen.explore.optimise.front`
are the results, with what tracing them again says; `solen.explore.optimise.prints` adds prints of a result and of the
design before. `solen.explore.optimise.straighter` sets up the search where a user
only wants a straighter response.
"""

from solen.explore.optimise.course import Grown
from solen.explore.optimise.front import Front, FrontDesign
from solen.explore.optimise.judge import Judged
from solen.explore.optimise.optimum import FreeNumber, Optimum
from solen.explore.optimise.options import OptimiseOptions
from solen.explore.optimise.prints import check_prints, with_prints
from solen.explore.optimise.run import optimise
from solen.explore.optimise.straighter import straighter

__all__ = [
    "FreeNumber",
    "Front",
    "FrontDesign",
    "Grown",
    "Judged",
    "OptimiseOptions",
    "Optimum",
    "check_prints",
    "optimise",
    "straighter",
    "with_prints",
]

"""Searches with all stages together: sweeps, tolerances, inverse design, and drawings tuned print by print.

`sweep` traces a design over values of its numbers, `tolerance` prints whose numbers vary, and `optimise` searches for
numbers; all judge by `solen.explore.merits` and keep what they traced in a `Store`. `tune` takes a measured print and
the log of those before, and gives a `TunedPrint`: the drawing that follows, and the next print as it is predicted.
"""

from solen.explore.optimise import OptimiseOptions, Optimum, optimise
from solen.explore.store import Store
from solen.explore.sweep import Sweep, SweepOptions, sweep
from solen.explore.tolerance import ToleranceOptions, Tolerances, tolerance
from solen.explore.tuning import TunedPrint, TuneOptions, check_tunable, tune
from solen.explore.tuning_log import TuningLog, log_text, read_log

__all__ = [
    "OptimiseOptions",
    "Optimum",
    "Store",
    "Sweep",
    "SweepOptions",
    "ToleranceOptions",
    "Tolerances",
    "TuneOptions",
    "TunedPrint",
    "TuningLog",
    "check_tunable",
    "log_text",
    "optimise",
    "read_log",
    "sweep",
    "tolerance",
    "tune",
]

"""Sweeps, tolerance analysis and optimisation of designs, and tuning of a drawing print by print.

`sweep` traces a design over values of its parameters, `tolerance` traces prints whose parameters vary, and `optimise`
searches for the best values; all use the figures of merit of `solen.explore.merits` and cache traces in a `Store`.
`tune` takes a measured print and the log of earlier ones, and returns a `TunedPrint`: the next drawing, and the
prediction of its print.
"""

from solen.explore.optimise import Front, OptimiseOptions, Optimum, optimise
from solen.explore.store import Store
from solen.explore.sweep import SweepOptions, sweep
from solen.explore.swept import Sweep
from solen.explore.tolerance import ToleranceOptions, Tolerances, tolerance
from solen.explore.tuned_print import TunedPrint, TuneOptions
from solen.explore.tuning import check_tunable, tune
from solen.explore.tuning_log import TuningLog, log_text, read_log

__all__ = [
    "Front",
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

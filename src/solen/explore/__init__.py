"""Searches with all stages together: drawings that print as designed, tuned print by print.

`tune` takes a measured print and the log of those before, and gives a `TunedPrint`: the drawing that follows, and the
next print as it is predicted.
"""

from solen.explore.tuning import TunedPrint, TuneOptions, tune
from solen.explore.tuning_log import TuningLog, log_text, read_log

__all__ = ["TuneOptions", "TunedPrint", "TuningLog", "log_text", "read_log", "tune"]

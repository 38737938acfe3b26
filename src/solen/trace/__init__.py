"""Tracing: a readable reference that is the truth, a compiled engine held to it, and adaptive integration on top."""

from solen.trace.adaptive import Integral, integrate
from solen.trace.engine import trace
from solen.trace.reference import trace_reference
from solen.trace.result import Crossed, Detected, Ledger, Limits, Mode, Path, Trace

__all__ = [
    "Crossed",
    "Detected",
    "Integral",
    "Ledger",
    "Limits",
    "Mode",
    "Path",
    "Trace",
    "integrate",
    "trace",
    "trace_reference",
]

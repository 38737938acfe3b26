"""Tracing: a readable reference tracer, a compiled engine that must agree with it, and adaptive integration."""

from solen.trace.adaptive import integrate, integrate_many
from solen.trace.convergence import Convergence, Series, convergence
from solen.trace.dataset import save_netcdf, to_dataset
from solen.trace.derivative import Derivative, Slope, derivative
from solen.trace.engine import trace
from solen.trace.many import trace_many
from solen.trace.options import TraceOptions, trace_with
from solen.trace.reference import trace_reference
from solen.trace.result import Crossed, Detected, Ledger, Limits, Mode, Path, Trace
from solen.trace.round_robin import RoundRobin, trace_round_robin

__all__ = [
    "Convergence",
    "Crossed",
    "Derivative",
    "Detected",
    "Ledger",
    "Limits",
    "Mode",
    "Path",
    "RoundRobin",
    "Series",
    "Slope",
    "Trace",
    "TraceOptions",
    "convergence",
    "derivative",
    "integrate",
    "integrate_many",
    "save_netcdf",
    "to_dataset",
    "trace",
    "trace_many",
    "trace_reference",
    "trace_round_robin",
    "trace_with",
]

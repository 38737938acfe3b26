"""Tracing: a readable reference that is the truth, and a compiled engine that is held to it."""

from solen.trace.engine import trace
from solen.trace.reference import trace_reference
from solen.trace.result import Crossed, Detected, Ledger, Limits, Mode, Path, Trace

__all__ = ["Crossed", "Detected", "Ledger", "Limits", "Mode", "Path", "Trace", "trace", "trace_reference"]

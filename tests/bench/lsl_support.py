"""A stand-in for the library of the Lab Streaming Layer, which records what it receives."""

import sys
from types import SimpleNamespace
from typing import Any

import pytest


def recorded_streams(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Replace the library; return descriptions of streams, channel labels, and samples with times, in their order."""
    entries: list[Any] = []

    class Element:
        def append_child(self, name: str) -> "Element":  # noqa: ARG002
            return self

        def append_child_value(self, name: str, value: str) -> None:
            entries.append((name, value))

    class Info:
        def __init__(self, *description: Any) -> None:
            entries.append(description)

        def desc(self) -> Element:
            return Element()

    class Stream:
        def __init__(self, info: Info) -> None:
            assert isinstance(info, Info)

        def push_sample(self, values: list[float], time_s: float) -> None:
            entries.append((values, time_s))

    constants = {"IRREGULAR_RATE": 0.0, "cf_double64": 2, "__spec__": object()}
    fake = SimpleNamespace(StreamInfo=Info, StreamOutlet=Stream, local_clock=lambda: 7.5, **constants)
    monkeypatch.setitem(sys.modules, "pylsl", fake)
    return entries

"""A stand-in for the library of the Lab Streaming Layer, which keeps what it is given."""

import sys
from types import SimpleNamespace
from typing import Any

import pytest


def kept_streams(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Descriptions of streams, labels of their channels and samples with their stamps, in their order."""
    told: list[Any] = []

    class Element:
        def append_child(self, name: str) -> "Element":  # noqa: ARG002
            return self

        def append_child_value(self, name: str, value: str) -> None:
            told.append((name, value))

    class Info:
        def __init__(self, *given: Any) -> None:
            told.append(given)

        def desc(self) -> Element:
            return Element()

    class Stream:
        def __init__(self, info: Info) -> None:
            assert isinstance(info, Info)

        def push_sample(self, values: list[float], at_s: float) -> None:
            told.append((values, at_s))

    numbers = {"IRREGULAR_RATE": 0.0, "cf_double64": 2, "__spec__": object()}
    fake = SimpleNamespace(StreamInfo=Info, StreamOutlet=Stream, local_clock=lambda: 7.5, **numbers)
    monkeypatch.setitem(sys.modules, "pylsl", fake)
    return told

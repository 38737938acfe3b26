"""Comparison of results bit by bit; NaN equals NaN."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np


def bits(value: Any) -> Any:
    """Return nested results, arrays and numbers in a form in which ``==`` compares every bit."""
    if dataclasses.is_dataclass(value):
        return {field.name: bits(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return (value.shape, str(value.dtype), value.tobytes())
    if isinstance(value, Mapping):
        return {name: bits(item) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [bits(item) for item in value]
    return value.hex() if isinstance(value, float) else value

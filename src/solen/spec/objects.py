"""Conversion of JSON objects to dataclasses, with every field checked against its type.

An object that can be of several kinds, such as a curve, has a ``kind`` key that selects the class, and the fields of
that class. Unknown keys are rejected, and the error gives their location.
"""

import dataclasses
import json
import typing
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.errors import DataError

CURVES: dict[str, type[Curve]] = {
    "segment": Segment,
    "arc": Arc,
    "parabola": Parabola,
    "cartesian-oval": CartesianOval,
    "conic": Conic,
    "bezier": Bezier,
    "spline": Spline,
}

T = TypeVar("T")


def parse_json(text: str, where: str, remedy: str = "") -> Any:
    """Return the content of a JSON document; raise `DataError` if it is not valid JSON (NaN is not)."""

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not a valid JSON number")

    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise DataError(where, limit=f"is not valid JSON: {str(error)[:100]}", remedy=remedy) from None


def build_kind(data: dict[str, Any], kinds: dict[str, type[T]], where: str) -> T:
    """Build an object of the class that the ``kind`` key selects."""
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise DataError(f"{where}: kind", value=kind, limit=f"must be one of {', '.join(kinds)}")
    return build(kinds[kind], {key: value for key, value in data.items() if key != "kind"}, where)


def build(cls: type[T], data: dict[str, Any], where: str) -> T:
    """Build an object of a dataclass, with every field checked against its type."""
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]  # every class here is a dataclass
    required = {f.name for f in fields if f.default is dataclasses.MISSING}
    check_keys(data, {field.name for field in fields}, required, where)
    hints = typing.get_type_hints(cls)
    return cls(**{key: value_of(hints[key], value, f"{where}: {key}") for key, value in data.items()})


def value_of(hint: Any, value: Any, where: str) -> Any:
    """Return a value checked against a type; an instance of the type is returned unchanged."""
    if isinstance(value, Curve | BaseModel):
        return value
    inner = [
        part for part in (hint, *typing.get_args(hint)) if isinstance(part, type) and dataclasses.is_dataclass(part)
    ]
    if typing.get_origin(hint) is tuple and inner and isinstance(value, list):
        return tuple(value_of(inner[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    if inner and isinstance(value, dict):
        kinds = {cls.kind: cls for cls in inner if hasattr(cls, "kind")}
        return build_kind(value, kinds, where) if kinds else build(inner[0], value, where)
    if inner and value is not None:
        raise DataError(where, value=value, limit="must be an object")
    try:
        adapter = TypeAdapter(hint, config=ConfigDict(strict=True, allow_inf_nan=False))
        return adapter.validate_json(json.dumps(value))
    except ValidationError as error:
        raise DataError(where, value=value, limit=error.errors()[0]["msg"].lower()) from None


def check_keys(data: dict[str, Any], known: set[str], required: set[str], where: str) -> None:
    """Raise `DataError` if a key is unknown or missing."""
    for key in data:
        if key not in known:
            raise DataError(f"{where}: {key}", limit=f"unknown key; the known keys are {', '.join(sorted(known))}")
    for key in sorted(required):
        if key not in data:
            raise DataError(f"{where}: {key}", limit="is missing")

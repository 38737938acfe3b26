"""Typed results, which every stage returns, and their conversion to JSON, tables, xarray and notebooks.

A result is a frozen dataclass whose names state units and uncertainties; it is converted only for display or storage.
JSON contains its fields and the properties marked `reported`, in their order, so no command builds a dictionary itself.
Names follow docs/conventions.md: ``slope_V_per_deg`` is a value with its unit, ``u_slope_V_per_deg`` its standard
uncertainty, ``interval95_slope_V_per_deg`` its 95 % interval.

Public names: `Result`, `plain` and `schema_of`.
"""

import dataclasses
import datetime as dt
import enum
import functools
import html
import inspect
import math
import re
import types
import typing
from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from solen.errors import FrozenError, OutputError
from solen.extras import need

if typing.TYPE_CHECKING:
    import xarray

HIDDEN: Mapping[str, Any] = types.MappingProxyType({"reported": False})
"""Metadata of a field that JSON omits: ``scene: Scene = field(metadata=HIDDEN)``."""
_SHOWN_ENTRIES = 4  # entries of a long list in a repr
_SHOWN_FIELDS = 14


if typing.TYPE_CHECKING:
    reported = property  # type checkers infer types through a plain property only
    reported_once = functools.cached_property
else:

    class reported(property):  # noqa: N801  used as a decorator, as `property` is
        """A property that is reported with the fields in JSON, tables and reprs."""

    class reported_once(functools.cached_property):  # noqa: N801
        """A reported property, computed on first use and cached."""


UNCHANGED_KEYS = {"options", "sources"}
"""Fields whose inner keys are defined elsewhere, and are therefore not converted."""


def in_unit(data: dict[str, Any], unit: str, before: str = "V") -> dict[str, Any]:
    """Return data with a unit in its keys replaced with another: for V and pF, ``range_V`` becomes ``range_pF``."""
    if unit == before:
        return data
    return rekeyed(data, re.compile(rf"(?<=_){as_key(before)}(?=\d?(?:_|$))"), as_key(unit))


def rekeyed(data: dict[str, Any], part: re.Pattern[str], text: str) -> dict[str, Any]:
    """Return plain data in which part of each key is replaced."""

    def inner(value: Any) -> Any:
        if isinstance(value, list):
            return [inner(item) for item in value]
        return rekeyed(value, part, text) if isinstance(value, dict) else value

    return {part.sub(text, key): value if key in UNCHANGED_KEYS else inner(value) for key, value in data.items()}


def as_key(unit: str) -> str:
    """Return the spelling of a unit in a key."""
    return re.sub(r"\W+", "_", unit).strip("_")


@typing.dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(dataclasses.field,))
class Result:
    """Base class of typed results; derived classes become frozen dataclasses.

    Results contain arrays and therefore compare by identity; a class of plain values may compare by value:
    ``class NewDesign(Result, eq=True)``.
    """

    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]

    def __init_subclass__(cls, eq: bool = False, kw_only: bool = False, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        dataclasses.dataclass(frozen=True, eq=eq, repr=False, kw_only=kw_only)(cls)
        del cls.__setattr__, cls.__delattr__  # replaced by the methods below

    def __setattr__(self, name: str, value: Any) -> None:
        remedy = f"dataclasses.replace(result, {name}={_short(value)}) makes a changed copy"
        raise FrozenError(f"{type(self).__name__}.{name}", limit="cannot be changed", remedy=remedy)

    def __delattr__(self, name: str) -> None:
        raise FrozenError(f"{type(self).__name__}.{name}", limit="cannot be changed")

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data for JSON: lists for arrays, None for values that are not finite."""
        return {name: plain(value) for name, value in entries(self)}

    def to_dataset(self) -> "xarray.Dataset":
        """Return the arrays and numbers of the result as an xarray dataset; this requires the extra ``netcdf``.

        Unless the class of the result defines something else, the first array field is the coordinate of
        one-dimensional arrays of its length; other arrays have their own dimensions. Strings, numbers and flags become
        attributes.

        Raises
        ------
        OutputError
            If the result itself contains no arrays, or xarray is not installed.
        """
        need("xarray", what="to_dataset", doing="a dataset")
        import xarray

        parts = self.dataset_parts()
        if not parts[0]:
            limit, remedy = "contains no arrays of its own", "use to_dict, or to_dataset of one of its parts"
            raise OutputError(type(self).__name__, limit=limit, remedy=remedy)
        return xarray.Dataset(*parts)

    def dataset_parts(self) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Return variables, coordinates and attributes of the dataset."""
        values = dict(entries(self))
        arrays = {name: np.asarray(value) for name, value in values.items() if isinstance(value, np.ndarray)}
        axis = next((name for name, array in arrays.items() if array.ndim == 1), None)
        length = arrays[axis].shape[0] if axis is not None else -1
        variables: dict[str, tuple[tuple[str, ...], Any]] = {}
        for name, array in arrays.items():
            dimensions = tuple(
                str(axis) if size == length else f"{name}_{axis_number}" for axis_number, size in enumerate(array.shape)
            )
            variables[name] = (
                dimensions if len(set(dimensions)) == array.ndim else _own_dimensions(name, array.ndim),
                array,
            )
        scalar_values = {
            name: value for name, value in values.items() if isinstance(value, str | int | float | np.generic)
        }
        attributes = {
            name: int(value) if isinstance(value, bool | np.bool_) else value for name, value in scalar_values.items()
        }
        return variables, {}, attributes

    def __repr__(self) -> str:
        """Return each value with its name on a line; long arrays are described by their size."""
        lines = [f"  {name} = {value}" for name, value in _summary(self)]
        return "\n".join([type(self).__name__, *lines])

    def _repr_html_(self) -> str:
        """Return the values as an HTML table, for notebooks."""
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in _summary(self)
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


R = typing.TypeVar("R", bound=Result, covariant=True)


@dataclasses.dataclass(frozen=True, eq=False)
class Outcome(typing.Generic[R]):
    """Outcome of a command: its result, and the written files, keyed by content ("figure", "out")."""

    result: R
    files: Mapping[str, Path] = dataclasses.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, with the files under ``files``."""
        return self.result.to_dict() | {"files": plain(self.files)}


def entries(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the reported names and values of a dataclass: its public fields, then its `reported` properties."""
    for field in dataclasses.fields(value):
        if not field.name.startswith("_") and field.metadata.get("reported", True):
            yield field.name, getattr(value, field.name)
    for name in _reported(type(value)):
        yield name, getattr(value, name)


def scalars(value: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the names and values of all scalars of a dataclass; those of nested dataclasses as ``deviation.rms_um``."""
    for name, entry in entries(value):
        if dataclasses.is_dataclass(entry):
            yield from scalars(entry, f"{prefix}{name}.")
        elif isinstance(entry, str | int | float | np.generic | Path | None):
            yield f"{prefix}{name}", entry


@functools.singledispatch
def plain(value: Any) -> Any:
    """Return a value as plain data for JSON: lists, dictionaries, strings, finite numbers, booleans and None."""
    if dataclasses.is_dataclass(value):
        return {name: plain(item) for name, item in entries(value)}
    if hasattr(value, "model_dump"):
        return plain(value.model_dump())
    raise TypeError(f"{type(value).__name__} cannot be converted to JSON: hide the field or report a part of it")


@plain.register
def _(value: bool | None) -> Any:
    return value


@plain.register
def _(value: str | Path) -> str:
    return str(value)


@plain.register
def _(value: enum.Enum) -> Any:
    return plain(value.value)


@plain.register
def _(value: int) -> int:
    return int(value)


@plain.register
def _(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


@plain.register
def _(value: np.ndarray) -> Any:
    return plain(value.tolist())


@plain.register
def _(value: np.generic) -> Any:
    return plain(value.item())


@plain.register
def _(value: dt.date) -> str:
    return value.isoformat()


@plain.register(Mapping)
def _(value: Mapping[Any, Any]) -> dict[str, Any]:
    return {str(key): plain(item) for key, item in value.items()}


@plain.register(Sequence)
@plain.register(Set)
def _(value: Sequence[Any]) -> list[Any]:
    return [plain(item) for item in value]


def schema_of(kind: Any) -> dict[str, Any]:
    """Return the JSON Schema of a type as converted by `plain`; the docstring of a dataclass describes its fields."""
    origin, parameters = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return schema_of(parameters[0])
    if origin is typing.Literal:
        return {"enum": list(parameters)}
    if origin in {typing.Union, types.UnionType}:
        return {"anyOf": [schema_of(item) for item in parameters]}
    return _class_schema(origin or kind, parameters) if isinstance(origin or kind, type) else {}


_JSON_TYPES: tuple[tuple[type | tuple[type, ...], Any], ...] = (
    (types.NoneType, "null"),
    (bool, "boolean"),
    (int, "integer"),
    ((str, Path, dt.date), "string"),
    ((float, np.floating), ["number", "null"]),
    (np.ndarray, "array"),
)


def _class_schema(kind: type, parameters: tuple[Any, ...]) -> dict[str, Any]:
    """Return the schema of a generic class with its type arguments."""
    for base, name in _JSON_TYPES:
        if issubclass(kind, base):
            return {"type": name}
    if inspect.isabstract(kind) and (issubclass(kind, Result) or hasattr(kind, "model_json_schema")):
        return {"anyOf": [schema_of(leaf) for leaf in kind.__subclasses__()]}
    if issubclass(kind, Mapping):
        return {"type": "object"} | ({"additionalProperties": schema_of(parameters[1])} if len(parameters) == 2 else {})
    if dataclasses.is_dataclass(kind):
        return _object_schema(kind)
    if hasattr(kind, "model_json_schema"):
        schema = kind.model_json_schema(mode="serialization")
        return typing.cast("dict[str, Any]", _inlined(schema, schema.get("$defs", {})))
    if issubclass(kind, Sequence | Set):
        alike = len(parameters) == 1 or parameters[1:] == (...,)
        return {"type": "array"} | ({"items": schema_of(parameters[0])} if alike else {})
    return {}


def _inlined(schema: Any, definitions: Mapping[str, Any]) -> Any:
    """Return a schema with its definitions inlined, so that it can be part of another."""
    if isinstance(schema, list):
        return [_inlined(part, definitions) for part in schema]
    if not isinstance(schema, dict):
        return schema
    referred = definitions[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else {}
    merged = {**referred, **schema}
    return {key: _inlined(part, definitions) for key, part in merged.items() if key not in {"$ref", "$defs"}}


def _object_schema(kind: type) -> dict[str, Any]:
    hints = typing.get_type_hints(kind, include_extras=True)
    kinds = {
        field.name: hints[field.name]
        for field in dataclasses.fields(kind)
        if not field.name.startswith("_") and field.metadata.get("reported", True)
    }
    for name in _reported(kind):
        attribute = getattr(kind, name)  # a subclass may replace the property by a value
        getter = getattr(attribute, "fget", None) or getattr(attribute, "func", None)
        kinds[name] = typing.get_type_hints(getter).get("return", Any) if getter is not None else Any
    descriptions = described(kind)
    properties = {
        name: schema_of(kind) | ({"description": descriptions[name]} if name in descriptions else {})
        for name, kind in kinds.items()
    }
    schema: dict[str, Any] = {"type": "object", "properties": properties, "required": list(properties)}
    text = inspect.getdoc(kind) if kind.__doc__ else None
    return schema | ({"title": kind.__name__, "description": _summary_line(text)} if text else {})


def _summary_line(text: str) -> str:
    """Return the first paragraph of a docstring as one line."""
    return " ".join(text.partition("\n\n")[0].split())


def described(kind: type) -> dict[str, str]:
    """Return descriptions of the fields of a dataclass, from the Attributes of its docstring and its properties."""
    descriptions: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        names: list[str] = []
        for line in (base.__doc__ or "").partition("Attributes\n")[2].splitlines()[1:]:
            text = line.strip()
            if text and len(line) - len(line.lstrip()) <= 4:
                names = [name.strip() for name in text.split(",")]
            elif text:
                descriptions |= {name: f"{descriptions.get(name, '')} {text}".strip() for name in names}
    for name in _reported(kind):
        descriptions[name] = _summary_line(inspect.getdoc(getattr(kind, name)) or "")
    return descriptions


def _reported(kind: type) -> list[str]:
    """Return the names of the reported properties of a type, inherited ones first."""
    names: dict[str, None] = {}
    for base in reversed(kind.__mro__):
        names |= dict.fromkeys(
            name for name, value in vars(base).items() if isinstance(value, reported | reported_once)
        )
    return list(names)


def _own_dimensions(name: str, dimensions: int) -> tuple[str, ...]:
    return tuple(f"{name}_{axis_number}" for axis_number in range(dimensions))


def _summary(result: Any) -> list[tuple[str, str]]:
    rows = [(name, _short(value)) for name, value in entries(result)]
    omitted = len(rows) - _SHOWN_FIELDS
    return rows if omitted <= 1 else [*rows[:_SHOWN_FIELDS], ("...", f"{omitted} more")]


def _short(value: Any) -> str:
    """Return a value in abbreviated form."""
    if isinstance(value, np.ndarray):
        if value.size == 0 or value.dtype.kind not in "fiu":
            return f"array {value.shape}"
        finite = value[np.isfinite(value)]
        return f"array {value.shape}" + (f", {_short(finite.min())} to {_short(finite.max())}" if finite.size else "")
    if isinstance(value, bool | np.bool_):
        return str(bool(value))
    if isinstance(value, float | np.floating):
        return f"{float(value):.6g}"
    if isinstance(value, str | int | np.integer | Path) or value is None:
        return str(value)
    if isinstance(value, Mapping):
        return f"{type(value).__name__} of {', '.join(str(key) for key in value)}"[:100]
    if isinstance(value, Sequence | Set):
        texts = [_short(item) for item in list(value)[:_SHOWN_ENTRIES]]
        return ", ".join(texts)[:100] + (f", ... ({len(value)})" if len(value) > _SHOWN_ENTRIES else "")
    name = getattr(value, "name", None)
    return name if isinstance(name, str) and name else type(value).__name__

"""Strict tables: pydantic models of TOML files that report each error in one line, with a remedy.

A file is a tree of tables, and each table is one frozen model. An unknown key is rejected with the nearest known name,
a reserved key with "is not yet supported"; numbers must be finite and are never converted from strings or booleans.
pydantic finds the problems; this module reports the dotted key, the value, the limit and the remedy.

Public names: `Strict`, `Number`, `Positive`, `NotNegative` and `Text`. A validator of several keys raises `refused`;
`reported_as` annotates a single field. `parse_toml`, `migrated` and `error_context` work with any TOML file that
contains ``schema = <version>``.
"""

import difflib
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import UnionType
from typing import Annotated, Any, ClassVar, TypeVar, Union, get_args, get_origin

from annotated_types import Ge, Le
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError, PydanticUndefined

from solen.errors import FrozenError, SolenError, SpecError

Document = dict[str, Any]
Migrations = Mapping[int, Callable[[Document], Document]]

_LIMITS = {
    "greater_than": "must be greater than {gt:.15g}",
    "greater_than_equal": "must be at least {ge:.15g}",
    "less_than": "must be less than {lt:.15g}",
    "less_than_equal": "must be at most {le:.15g}",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be an integer",
    "string_type": "must be a string",
    "string_unicode": "must be a string without lone surrogates",
    "literal_error": "must be {expected}",
    "tuple_type": "must be a list",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
    "missing": "is missing",
    "extra_forbidden": "unknown name",
    "unexpected_keyword_argument": "unknown name",
}
T = TypeVar("T")
_BOUNDS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
_MAX_VALUE_LENGTH = 60  # characters of a rejected value in an error message


def refused(key: str, limit: str, *, value: object = None, remedy: str = "") -> PydanticCustomError:
    """Return the error that a validator raises: the invalid key of its table, the value, the limit and the remedy."""
    return PydanticCustomError("refused", "{limit}", {"key": key, "value": value, "limit": limit, "remedy": remedy})


def choices(names: Iterable[str]) -> str:
    """Return two or more names as 'a', 'b' or 'c', for a message."""
    *others, last = map(repr, names)
    return f"{', '.join(others)} or {last}"


def repeated(values: Iterable[T]) -> T | None:
    """Return the first value that occurs more than once; None if there is none."""
    return next((value for value, count in Counter(values).items() if count > 1), None)


def reported_as(limit: str) -> WrapValidator:
    """Return a field annotation that reports any problem of a compound value with one message, in the user's terms."""

    def check(value: object, handler: ValidatorFunctionWrapHandler) -> object:
        try:
            return handler(value)
        except ValidationError:
            raise refused("", limit, value=value) from None

    return WrapValidator(check)


def _one_line(text: str) -> str:
    if not (text.strip() and text.isprintable()):
        raise refused("", "must be one line of printable characters and must not be empty", value=text)
    return text


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Text = Annotated[str, AfterValidator(_one_line)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
"""A finite option value, which the command line may pass as a string; files use `Number`."""
Above0 = Annotated[Finite, Field(gt=0)]
NotBelow0 = Annotated[Finite, Field(ge=0)]
MIN_NM, MAX_NM = 100.0, 20_000.0
"""Range of wavelengths accepted as an option; a smaller value is probably in µm."""


def _check_nm(wavelength_nm: float) -> float:
    if not MIN_NM <= wavelength_nm <= MAX_NM:
        from_um = 1e3 * wavelength_nm
        remedy = f"did you mean {from_um:g}?" if MIN_NM <= from_um <= MAX_NM else ""
        raise refused("", f"must be {MIN_NM:g} to {MAX_NM:g}, in nm", value=wavelength_nm, remedy=remedy)
    return wavelength_nm


Wavelength = Annotated[float, AfterValidator(_check_nm), Ge(MIN_NM), Le(MAX_NM)]
"""A wavelength in nm, as an option value."""


class Strict(BaseModel):
    """A table of a file: frozen, without unknown keys, with one-line errors.

    A derived class defines its `table` (the prefix of its keys in messages), the `error` class that it raises, and the
    `reserved` key names. Use the constructor, not pydantic's ``model_validate``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    table: ClassVar[str] = ""
    error: ClassVar[type[SolenError]] = SpecError
    reserved: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise _file_error(error, type(self)) from None

    # Prevents pydantic from calling this constructor for nested tables: the outermost table reports every problem.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __setattr__(self, name: str, value: Any) -> None:
        if name in type(self).model_fields:
            of_design = f'design.set({{"{_dotted(self.table, [name])}": {value!r}}})'
            call = of_design if self.error is SpecError else f".model_copy(update={{{name!r}: {value!r}}})"
            raise _frozen(self, name, value, f"make a changed copy with {call}")
        super().__setattr__(name, value)


class Options(BaseModel):
    """Options of a stage: frozen, validated, used directly by its function and its command.

    The type of a field defines its choices (`Literal`) or limits (`Field(gt=0)`), and the string below the field
    describes it; the help shows that string with the limits. Strings are converted to numbers, because the command
    line passes strings.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise option_refusal(error) from None

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Add the limits of each field to its description."""
        for field in cls.model_fields.values():
            field.description = " ".join((field.description or "").split()) or None
            limits = _limits_in_words((field.annotation, *field.metadata))
            if limits and field.description and not field.description.endswith(limits):
                field.description = f"{field.description} {limits}"

    def __setattr__(self, name: str, value: Any) -> None:
        raise _frozen(self, name, value, f"make new options with {type(self).__name__}({name}={value!r})")


def _limits_in_words(parts: Iterable[Any]) -> str:
    """Return the limits in a type and its metadata in words, ``Above 0, at most 90.``; empty if there are none."""
    bounds = _bounds(parts)
    if "ge" in bounds and "le" in bounds:
        return f"From {bounds['ge']:g} to {bounds['le']:g}."
    words = ", ".join(f"{_BOUNDS[name]} {bounds[name]:g}" for name in _BOUNDS if name in bounds)
    return f"{words[0].upper()}{words[1:]}." if words else ""


def _bounds(parts: Iterable[Any]) -> dict[str, float]:
    """Return the bounds in type metadata, nested to any depth, keyed by pydantic's names."""
    bounds: dict[str, float] = {}
    for part in parts:
        bounds |= {name: getattr(part, name) for name in _BOUNDS if isinstance(getattr(part, name, None), float | int)}
        inside = part.metadata if isinstance(part, FieldInfo) else (*get_args(part), *getattr(part, "__metadata__", ()))
        bounds |= _bounds(inside)
    return bounds


def _frozen(table: BaseModel, name: str, value: object, remedy: str) -> FrozenError:
    return FrozenError(f"{type(table).__name__}.{name}", value=value, limit="cannot be changed", remedy=remedy)


def option_refusal(error: ValueError, *, command_line: bool = False) -> SpecError:
    """Return the first error in the options as one line.

    An option is named as typed on the command line, ``--u-T``, or as in Python, ``u_T``.
    """
    if not isinstance(error, ValidationError):
        return SpecError("options", limit=str(error))
    first = error.errors(include_url=False)[0]
    name, ctx = ".".join(part for part in first["loc"] if isinstance(part, str)), first.get("ctx", {})
    value, remedy = None if first["type"] == "missing" else first["input"], ""
    if first["type"] == "refused":
        name = ".".join(filter(None, (name, ctx["key"])))
        value, limit, remedy = ctx["value"], ctx["limit"], ctx["remedy"]
    else:
        kind = first["type"].replace("_parsing", "_type")
        limit = _LIMITS[kind].format(**ctx) if kind in _LIMITS else first["msg"]
    shown = _shown(value) if value is not None else None
    return SpecError(f"--{name.replace('_', '-')}" if command_line else name, value=shown, limit=limit, remedy=remedy)


def nearest(word: str, names: Iterable[str]) -> str | None:
    """Return the name nearest to a misspelt word, or None if no name is similar."""
    by_lower = {name.lower(): name for name in names}
    return next((by_lower[near] for near in difflib.get_close_matches(word.lower(), by_lower, n=1)), None)


def _dotted(prefix: str, parts: Iterable[int | str]) -> str:
    name = prefix
    for part in parts:
        if isinstance(part, int):
            name += f"[{part}]"
        elif part:
            name += f".{part}" if name else part
    return name


def _tables(model: type[Strict]) -> dict[str, type[Strict]]:
    """Return the tables directly inside a table, including optional ones, by key."""
    tables = {key: _table(_alternatives(field.annotation)) for key, field in model.model_fields.items()}
    return {key: table for key, table in tables.items() if table}


def _lists(model: type[Strict]) -> dict[str, type[Strict]]:
    """Return the lists of tables directly inside a table, by key."""
    tables = {
        key: _table(get_args(kind))
        for key, field in model.model_fields.items()
        for kind in _alternatives(field.annotation)
        if get_origin(kind) is tuple
    }
    return {key: table for key, table in tables.items() if table}


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    """Return the types that a field accepts: the members of a union, or the type itself."""
    return get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)


def _table(kinds: Iterable[Any]) -> type[Strict] | None:
    """Return the table class among several types, or None if there is none."""
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Strict)), None)


def _owner(model: type[Strict], loc: tuple[int | str, ...]) -> tuple[type[Strict], tuple[int | str, ...]]:
    """Return the innermost table that contains a location, and the remainder of the location inside that table."""
    while len(loc) > 1:
        if inner := _tables(model).get(str(loc[0])):
            model, loc = inner, loc[1:]
        elif len(loc) > 2 and isinstance(loc[1], int) and (inner := _lists(model).get(str(loc[0]))):
            model, loc = inner, loc[2:]
        else:
            break
    return model, loc


def _shown(value: object) -> object:
    """Return a value as an error message shows it; a long value is shortened."""
    text = value if isinstance(value, str) else str(value)
    return value if len(text) <= _MAX_VALUE_LENGTH else f"{text[: _MAX_VALUE_LENGTH - 3]}..."


def _unknown(what: str, key: str, owner: type[Strict], root: type[Strict]) -> tuple[str, str]:
    """Return the limit and the remedy for an unknown key."""
    if key in owner.reserved:
        return "is not yet supported", f"omit {key}"
    stem = what.removesuffix(key)
    elsewhere = [_dotted(root.table, (t, key)) for t, inner in _tables(root).items() if key in inner.model_fields]
    near = nearest(key, owner.model_fields)
    if elsewhere or near:
        return "unknown key", f"did you mean {elsewhere[0] if elsewhere else f'{stem}{near}'}?"
    return "unknown key", f"the keys of this table are {', '.join(owner.model_fields)}"


def _problem(problem: ErrorDetails, root: type[Strict]) -> tuple[str, object, str, str]:
    """Return the key, value, limit and remedy for a problem reported by pydantic."""
    kind, ctx = problem["type"], problem.get("ctx", {})
    what = _dotted(root.table, problem["loc"])
    owner, rest = _owner(root, problem["loc"])
    field = owner.model_fields.get(str(rest[0])) if rest else None
    if kind == "refused":
        remedy = ctx["remedy"] or ("" if ctx["key"] else _default(field))  # with a key, the field is its table
        return _dotted(what, [ctx["key"]]), ctx["value"], ctx["limit"], remedy
    if kind == "extra_forbidden":
        return what, None, *_unknown(what, str(rest[-1]), owner, root)
    if kind == "missing":
        return what, None, "is missing", f"add it: {field.description if field else ''}"
    if kind == "model_type":
        if isinstance(problem["input"], list):
            lists = [
                _dotted(t, (key,))
                for t, inner in _tables(root).items()
                for key in _lists(inner)
                if key in _plurals(what)
            ]
            remedy = f", or [[{lists[0]}]] for several" if lists else ""
            return what, None, "must be a single table", f"write [{what}]{remedy}"
        return what, problem["input"], "must be a table", f"write [{what}] and its keys below"
    if kind == "tuple_type" and len(problem["loc"]) == 1 and str(problem["loc"][0]) in _lists(root):
        return what, problem["input"], "must be a list of tables", f"write [[{what}]]"
    limit = _LIMITS[kind].format(**ctx) if kind in _LIMITS else problem["msg"]
    return what, problem["input"], limit, _default(field)


def _plurals(word: str) -> tuple[str, ...]:
    return word, f"{word}s", f"{word}es"


def _default(field: FieldInfo | None) -> str:
    """Return a remedy that gives the default of a field, or an empty string if it has none."""
    default = None if field is None or field.is_required() else field.default
    if default is None or default is PydanticUndefined:
        return ""
    return f"omit it for the default, {list(default) if isinstance(default, tuple) else repr(default)}"


def _file_error(error: ValidationError, root: type[Strict]) -> SolenError:
    """Return an error with the first problem and the number of further ones.

    Unknown keys come first, because they often explain missing ones.
    """
    problems = sorted(error.errors(include_url=False), key=lambda problem: problem["type"] != "extra_forbidden")
    what, value, limit, remedy = _problem(problems[0], root)
    if more := len(problems) - 1:
        remedy = "; ".join(filter(None, (remedy, f"and {more} more problem{'s' if more > 1 else ''}")))
    return root.error(what, value=_shown(value) if value is not None else None, limit=limit, remedy=remedy)


@contextmanager
def error_context(where: str) -> Iterator[None]:
    """Prefix errors raised inside with the file or key concerned: ``resin.toml: index.n``."""
    try:
        yield
    except SolenError as error:
        what = f"{where}: {error.what}"
        raise type(error)(what, value=error.value, limit=error.limit, remedy=error.remedy) from None


def parse_toml(text: str, what: str, error: type[SolenError]) -> Document:
    """Return the tables of a TOML document; raise ``error`` with line and column if it is not TOML."""
    try:
        return tomllib.loads(f"{text}\n")  # without the newline, an error in the last line has no line number
    except (ValueError, RecursionError) as bad:  # a ValueError may also be an integer with too many digits
        raise error(what, limit=f"is not valid TOML: {bad}", remedy="correct that line") from None


def migrated(data: Document, what: str, *, current: int, migrations: Migrations, error: type[SolenError]) -> Document:
    """Migrate a file's tables to the current schema, version by version, and remove ``schema``.

    Parameters
    ----------
    data
        The tables as read, including ``schema``.
    what
        Name of the file in error messages.
    current
        The current schema version.
    migrations
        Functions that convert tables to the next version, by old version.
    error
        Error class to raise if ``schema`` is missing, is not a version, or is newer than ``current``.
    """
    data = dict(data)
    version = data.pop("schema", None)
    if version is None:
        raise error(what, limit="schema is missing", remedy=f"add the line schema = {current} at the top of the file")
    if type(version) is not int or version < 1:
        raise error(f"{what}: schema", value=version, limit="must be an integer, at least 1")
    if version > current:
        raise error(
            f"{what}: schema",
            value=version,
            limit=f"was written by a newer solen; this version reads schema {current} and older",
            remedy="update solen",
        )
    for old in range(version, current):
        data = migrations[old](data)
    return data

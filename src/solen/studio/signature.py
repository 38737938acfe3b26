"""Parameters of a command's function: their types, and their form on a command line."""

import inspect
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from solen.errors import SpecError
from solen.spec.strict import Options, option_refusal


@dataclass(frozen=True)
class Parameter:
    """A parameter of a command's function."""

    name: str
    hint: Any
    signature: inspect.Parameter

    @property
    def kind(self) -> Any:
        """Kind of argument."""
        return self.signature.kind

    @property
    def default(self) -> Any:
        """Its default."""
        return self.signature.default

    @property
    def is_required(self) -> bool:
        """Whether it must be stated."""
        return self.default is inspect.Parameter.empty and self.kind is not inspect.Parameter.VAR_POSITIONAL

    @property
    def is_positional(self) -> bool:
        """Whether a command line states it without its name."""
        return self.kind in {inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.VAR_POSITIONAL}

    @property
    def is_many(self) -> bool:
        """Whether it accepts several values."""
        return self.kind is inspect.Parameter.VAR_POSITIONAL or any(
            typing.get_origin(one) in {list, tuple} for one in _inside(self.hint)
        )

    @property
    def is_path(self) -> bool:
        """Whether it is a path, or several paths."""
        return any(one is Path for one in _inside(self.hint))

    @property
    def options(self) -> type[Options] | None:
        """Its class of options, if it is a group of options."""
        for one in _inside(self.hint):
            if isinstance(one, type) and issubclass(one, Options):
                return one
        return None

    @property
    def option(self) -> tuple[str, str]:
        """Return the option on a command line, and the negative form of a flag."""
        own, negative = option_name(self.name), f"--no-{self.name}"
        for note in getattr(self.hint, "__metadata__", ()):
            named = [one for one in getattr(note, "name", None) or () if one.startswith("--")]
            own = named[0] if named else own
            negative = next(iter(getattr(note, "negative", None) or ()), negative)
        return own, negative

    def converted(self, value: Any) -> Any:
        """Convert a value from a page for the function; raise `SpecError` if it is invalid."""
        try:
            return TypeAdapter(self.hint).validate_python(value)
        except ValidationError as bad:
            refused = option_refusal(bad)
            raise SpecError(self.name, value=refused.value, limit=refused.limit, remedy=refused.remedy) from None


def parameters_of(function: Callable[..., Any]) -> dict[str, Parameter]:
    """Return the parameters of a function by name."""
    hints = typing.get_type_hints(function, include_extras=True)
    return {
        name: Parameter(name, hints[name], parameter)
        for name, parameter in inspect.signature(function).parameters.items()
    }


def option_name(field: str) -> str:
    """Return the name of an option on the command line, from its field."""
    return f"--{field.strip('_').replace('_', '-')}"


def is_fixed(hint: Any) -> bool:
    """Return whether a type is a tuple with a fixed number of values."""
    return any(typing.get_origin(one) is tuple and ... not in typing.get_args(one) for one in _inside(hint))


def _inside(hint: Any) -> Iterator[Any]:
    """Yield a type and all types nested in it."""
    yield hint
    if origin := typing.get_origin(hint):
        yield origin
    for arg in typing.get_args(hint):
        yield from _inside(arg)


def described(function: Callable[..., Any]) -> dict[str, str]:
    """Return the parameter descriptions from the function's docstring."""
    words: dict[str, str] = {}
    names: list[str] = []
    text = (inspect.getdoc(function) or "").partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    for line in text.splitlines():
        if line.startswith(" "):
            words |= {name: f"{words.get(name, '')} {line.strip()}".strip() for name in names}
        else:
            names = [name.strip() for name in line.split(",")]
    return words

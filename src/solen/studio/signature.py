"""Parameters of the function of a command: their types, and their form on a command line."""

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
    """A parameter of the function of a command."""

    name: str
    hint: Any
    signature: inspect.Parameter

    @property
    def kind(self) -> Any:
        """Kind of argument."""
        return self.signature.kind

    @property
    def default(self) -> Any:
        """The default value."""
        return self.signature.default

    @property
    def is_required(self) -> bool:
        """Whether it must be specified."""
        return self.default is inspect.Parameter.empty and self.kind is not inspect.Parameter.VAR_POSITIONAL

    @property
    def is_positional(self) -> bool:
        """Whether it is positional on a command line."""
        return self.kind in {inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.VAR_POSITIONAL}

    @property
    def is_many(self) -> bool:
        """Whether it accepts several values."""
        return self.kind is inspect.Parameter.VAR_POSITIONAL or any(
            typing.get_origin(item) in {list, tuple} for item in _inside(self.hint)
        )

    @property
    def is_path(self) -> bool:
        """Whether it is a path, or several paths."""
        return any(item is Path for item in _inside(self.hint))

    @property
    def options(self) -> type[Options] | None:
        """The class of options, if the parameter is a group of options."""
        for item in _inside(self.hint):
            if isinstance(item, type) and issubclass(item, Options):
                return item
        return None

    @property
    def option(self) -> tuple[str, str]:
        """The option on a command line, and the negative form of a flag."""
        option, negative = option_name(self.name), f"--no-{self.name}"
        for annotation in getattr(self.hint, "__metadata__", ()):
            names = [item for item in getattr(annotation, "name", None) or () if item.startswith("--")]
            option = names[0] if names else option
            negative = next(iter(getattr(annotation, "negative", None) or ()), negative)
        return option, negative

    def converted(self, value: Any) -> Any:
        """Return a value from a page, converted for the function; raise `SpecError` if it is invalid."""
        try:
            return TypeAdapter(self.hint).validate_python(value)
        except ValidationError as bad:
            error = option_refusal(bad)
            raise SpecError(self.name, value=error.value, limit=error.limit, remedy=error.remedy) from None


def parameters_of(function: Callable[..., Any]) -> dict[str, Parameter]:
    """Return the parameters of a function, keyed by name."""
    hints = typing.get_type_hints(function, include_extras=True)
    return {
        name: Parameter(name, hints[name], parameter)
        for name, parameter in inspect.signature(function).parameters.items()
    }


def option_name(field: str) -> str:
    """Return the command line option for a field."""
    return f"--{field.strip('_').replace('_', '-')}"


def is_fixed(hint: Any) -> bool:
    """Return whether a type is a tuple with a fixed number of values."""
    return any(typing.get_origin(item) is tuple and ... not in typing.get_args(item) for item in _inside(hint))


def _inside(hint: Any) -> Iterator[Any]:
    """Yield a type and all types nested in it."""
    yield hint
    if origin := typing.get_origin(hint):
        yield origin
    for arg in typing.get_args(hint):
        yield from _inside(arg)


def described(function: Callable[..., Any]) -> dict[str, str]:
    """Return the descriptions of the parameters from the docstring of a function."""
    descriptions: dict[str, str] = {}
    names: list[str] = []
    text = (inspect.getdoc(function) or "").partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    for line in text.splitlines():
        if line.startswith(" "):
            descriptions |= {name: f"{descriptions.get(name, '')} {line.strip()}".strip() for name in names}
        else:
            names = [name.strip() for name in line.split(",")]
    return descriptions

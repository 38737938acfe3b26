"""A call to a command's function: run as a job, and written out as a command line and a script."""

import importlib
import inspect
import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from solen.files import write_text
from solen.results import Outcome
from solen.spec.strict import Options
from solen.studio.jobs import SendNews
from solen.studio.signature import Parameter, is_fixed, option_name, parameters_of

Shown = Callable[[str, Any], Sequence[str]]
"""Function that returns the lines a command prints for a result, given the command's name."""


@dataclass(frozen=True)
class Call:
    """A call of a command's function.

    Attributes
    ----------
    name
        The command without ``solen``.
    function
        Its function.
    values
        The stated values, by parameter, in the order of the function.
    live
        Parameters that accept an observer of the run, with the class that makes it from a `SendNews`: ``module:name``.
    """

    name: str
    function: Callable[..., Outcome[Any]]
    values: Mapping[str, Any]
    live: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of the function by name."""
        return parameters_of(self.function)

    def run(self, send_news: SendNews) -> Outcome[Any]:
        """Call the function; report its progress and live values."""
        given = dict(self.values)
        for name, where in self.live.items():
            module, _, factory = where.partition(":")
            given[name] = getattr(importlib.import_module(module), factory)(send_news)
        if "progress" in self.parameters:
            given["progress"] = lambda share: send_news(share=share)
        first, keywords = self._split(given)
        return self.function(*first, **keywords)

    def _split(self, given: Mapping[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        first: list[Any] = []
        keywords: dict[str, Any] = {}
        for name, value in given.items():
            kind = self.parameters[name].kind
            if kind is inspect.Parameter.VAR_POSITIONAL:
                first += value
            elif kind is inspect.Parameter.POSITIONAL_ONLY:
                first.append(value)
            else:
                keywords[name] = value
        return first, keywords

    @property
    def shell(self) -> str:
        """The same call as a command line."""
        words = ["solen", *self.name.split()]
        for name, value in self.values.items():
            parameter = self.parameters[name]
            if isinstance(value, Options):
                for key, one in stated(value).items():
                    annotation = type(value).model_fields[key].annotation
                    words += option_words(option_name(key), f"--no-{key}", one, fixed=is_fixed(annotation))
            elif parameter.is_positional:
                words += [str(one) for one in (value if isinstance(value, list) else [value])]
            else:
                words += option_words(*parameter.option, value)
        return shlex.join(words)

    @property
    def python(self) -> str:
        """The same call as a Python script."""
        imports = {f"from {self.function.__module__} import {self.function.__name__}"}
        first, keywords = self._split({name: value for name, value in self.values.items() if stated_in_python(value)})
        for value in keywords.values():
            if isinstance(value, Options):
                imports.add(f"from {type(value).__module__} import {type(value).__name__}")
        arguments = [*map(_written, first), *(f"{name}={_written(value)}" for name, value in keywords.items())]
        if any("Path(" in argument for argument in arguments):
            imports.add("from pathlib import Path")
        call = [f"found = {self.function.__name__}(", *(f"    {argument}," for argument in arguments), ")"]
        return "\n".join([*sorted(imports), "", *call, "print(found.result)"])


def perform(
    send_news: SendNews,
    call: Call,
    shown: Shown | None,
    about: Mapping[str, Any] | None = None,
    kept: Path | None = None,
) -> Mapping[str, Any]:
    """Run a command as the work of a job; return its printed lines, its result as ``--json`` states it, and its files.

    The job, which ``about`` describes, is also written to ``kept``, from where `solen.studio.workspace` shows it again
    later.
    """
    outcome = call.run(send_news)
    lines = list(shown(call.name, outcome.result)) if shown is not None else []
    files = {name: str(path) for name, path in outcome.files.items()}
    news = {"lines": lines, "result": outcome.to_dict(), "files": files}
    if kept is not None:
        write_text(kept, json.dumps({"name": call.name, "about": about, "news": news}, allow_nan=False))
    return news


def option_words(option: str, negative: str, value: Any, *, fixed: bool = False) -> list[str]:
    """Return the words of a command line for an option; a ``fixed`` number of values is written once."""
    if isinstance(value, bool):
        return [option if value else negative.replace("_", "-")]
    if fixed and isinstance(value, tuple):
        return [option, *map(str, value)]
    if isinstance(value, list | tuple):
        several = [[option, str(one)] for one in value]
        return [word for words in several for word in words]
    return [option, str(value)]


def stated(options: Options) -> dict[str, Any]:
    """Return the values of options that are stated."""
    return {key: getattr(options, key) for key in type(options).model_fields if key in options.model_fields_set}


def stated_in_python(value: Any) -> bool:
    """Return whether a script states a value: not for options that all have their defaults."""
    return not isinstance(value, Options) or bool(stated(value))


def _written(value: Any) -> str:
    if isinstance(value, Options):
        inside = ", ".join(f"{key}={_written(one)}" for key, one in stated(value).items())
        return f"{type(value).__name__}({inside})"
    if isinstance(value, Path):
        return f"Path({str(value)!r})"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return repr(value)
